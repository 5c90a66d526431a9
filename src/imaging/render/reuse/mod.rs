//! Frame-to-frame acceleration (the paper's section 2.2) that is never wrong.
//!
//! The camera moves little between pictures, so most of what a ray passes was seen to be empty in the last one.
//! `known` returns which part of each new ray is proven to be empty, for any motion with six degrees of freedom.
//! Everything else is traced again. `prove` finds along each ray what the next picture may rely on. `paper` has the
//! paper's own rule, a guess that is limited to what is proven.
//!
//! Rays leave out only samples of opacity 0, and all samples stay at the same positions. A picture is therefore the
//! same bit for bit with and without reuse.

pub(crate) mod known;
pub(crate) mod paper;
pub(crate) mod prove;

use glam::{DVec3, Vec3};

use super::accelerations::Accelerations;
use super::begin::{Begin, FromScratch};
use super::caster::ImageRequest;
use super::classify::{ByDensity, ByValue, Classifier};
use super::leap::chosen::ChosenRadius;
use super::leap::{BrickWalls, EmptyRadius, Leaper, SLACK, Surroundings};
use super::march::Ray;
use super::memory::MemoryPart;
use super::quality::{Classification, Quality, Settings};
use super::renderer::Renderer;
use super::sampler::{Nearest, Trilinear};
use super::skip::Leap;
use super::{Frame, View, Work};
use crate::space::PreparedVolume;
use known::{Bounds, Empty, Known, Reprojection};
use paper::Trace;
use prove::Pyramid;

/// When pictures are rendered without using the last one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refresh {
    /// Renders every Nth picture from scratch (the paper's key frames).
    KeyFrames(u32),
    /// Renders one Nth of each picture from scratch, a different part each time, so that no single picture pays for all.
    Staggered(u32),
}

impl Refresh {
    /// True if picture `n` is rendered from scratch.
    fn is_key_frame(self, n: u32) -> bool {
        matches!(self, Self::KeyFrames(every) if n.is_multiple_of(every.max(1)))
    }

    /// True if picture `n` renders its coarse block number `block` from scratch.
    fn is_stale(self, n: u32, block: usize) -> bool {
        matches!(self, Self::Staggered(parts) if block as u32 % parts.max(1) == n % parts.max(1))
    }
}

/// Voxels that pictures are rendered from, with the clearance that proves their emptiness.
pub trait VoxelStorage: Send + Sync {
    /// The type that returns the clearance around a position.
    type Radius<'a>: EmptyRadius
    where
        Self: 'a;

    /// Returns the volume that rays are cast in.
    fn volume(&self) -> &PreparedVolume;

    /// Returns the source of clearance.
    fn empty_radius(&self) -> Self::Radius<'_>;

    /// Renders a picture.
    fn image<B: Begin>(
        &self,
        view: &View,
        settings: &Settings,
        begin: &B,
        kept: &mut [B::Kept],
        frame: &mut Frame,
    ) -> Work;

    /// Returns the memory in addition to the 16-bit voxels, by purpose.
    fn parts(&self) -> Vec<(MemoryPart, usize)>;
}

/// Renders every picture independently.
pub(crate) struct Plain<S> {
    storage: S,
    settings: Settings,
}

impl<S: VoxelStorage> Plain<S> {
    /// Renders `storage` with `settings`.
    pub(crate) fn new(storage: S, settings: Settings) -> Self {
        Self { storage, settings }
    }
}

impl<S: VoxelStorage> Renderer for Plain<S> {
    fn render(&mut self, view: &View, frame: &mut Frame) -> Work {
        let mut kept = vec![(); view.width() * view.height()];
        self.storage.image(view, &self.settings, &FromScratch, &mut kept, frame)
    }

    fn parts(&self) -> Vec<(MemoryPart, usize)> {
        self.storage.parts()
    }
}

/// The 16-bit voxels, with the wall's distance per brick.
pub struct WordStorage {
    volume: PreparedVolume,
    /// Proves reuse if the leaping method has no distances that can.
    bricks: Option<BrickWalls>,
    /// `None` selects the compile-time combination of flags and computed regressions.
    accelerations: Option<Accelerations>,
}

impl WordStorage {
    /// Prepares `volume`.
    pub fn new(volume: &PreparedVolume) -> Self {
        Self { volume: volume.clone(), bricks: Some(BrickWalls::new(volume)), accelerations: None }
    }

    /// Casts rays through `volume` with `accelerations`, which must be made for it. `reuses` is true if the last
    /// picture may be used.
    pub fn accelerated(volume: &PreparedVolume, accelerations: Accelerations, reuses: bool) -> Self {
        let knows = matches!(accelerations.leaper, Leaper::Bricks(_) | Leaper::Voxels(_));
        let bricks = (reuses && !knows).then(|| BrickWalls::new(volume));
        Self { volume: volume.clone(), bricks, accelerations: Some(accelerations) }
    }
}

impl VoxelStorage for WordStorage {
    type Radius<'a> = ChosenRadius<'a, Surroundings<'a>>;

    fn volume(&self) -> &PreparedVolume {
        &self.volume
    }

    fn empty_radius(&self) -> Self::Radius<'_> {
        let own = self.bricks.as_ref().map(|bricks| Surroundings { volume: &self.volume, bricks });
        let leaper = self.accelerations.as_ref().map_or(&Leaper::Flag, |a| &a.leaper);
        leaper.radius(&self.volume, own)
    }

    fn image<B: Begin>(
        &self,
        view: &View,
        settings: &Settings,
        begin: &B,
        kept: &mut [B::Kept],
        frame: &mut Frame,
    ) -> Work {
        let request = ImageRequest { volume: &self.volume, view, settings };
        let Some(accelerations) = &self.accelerations else { return request.plain(begin, kept, frame) };
        let flags = (Leap::<true>::new(&self.volume), Leap::<false>::new(&self.volume));
        if settings.quality == Quality::Low {
            accelerations.image(&request, Nearest::new(&self.volume), flags, begin, kept, frame)
        } else {
            accelerations.image(&request, Trilinear::new(&self.volume), flags, begin, kept, frame)
        }
    }

    fn parts(&self) -> Vec<(MemoryPart, usize)> {
        let proof = self.bricks.iter().map(|b| (MemoryPart::BrickDistances, b.bytes()));
        let flags = (MemoryPart::Flags, self.volume.bytes());
        [flags].into_iter().chain(proof).chain(self.accelerations.iter().flat_map(Accelerations::parts)).collect()
    }
}

/// A method of reuse: what it stores for each pixel, and where it lets a ray start.
pub trait Rule: Copy + Default + Empty + Send + Sync {
    /// Returns the largest distance at which a ray may start, mm.
    fn begin(known: &Known<Self>, motion: &Reprojection, x: usize, y: usize, ray: &Ray) -> f32;
    /// Records how far the pyramid is empty, mm.
    fn keep_empty(&mut self, mm: f32);
    /// Records where the ray first met something, mm.
    fn keep_first(&mut self, mm: f32);
}

/// Six degrees of freedom: a ray starts where the proof ends.
impl Rule for f32 {
    #[inline(always)]
    fn begin(_: &Known<Self>, _: &Reprojection, _: usize, _: usize, _: &Ray) -> f32 {
        Self::INFINITY
    }

    #[inline(always)]
    fn keep_empty(&mut self, mm: f32) {
        *self = self.max(mm);
    }

    fn keep_first(&mut self, _: f32) {}
}

/// The paper's rule.
impl Rule for Trace {
    fn begin(known: &Known<Self>, motion: &Reprojection, x: usize, y: usize, ray: &Ray) -> f32 {
        paper::guess(known, motion, x, y, ray)
    }

    fn keep_empty(&mut self, mm: f32) {
        self.empty_mm = self.empty_mm.max(mm);
    }

    fn keep_first(&mut self, mm: f32) {
        // The nearest of the pixel's rays.
        self.first_mm = if self.first_mm == 0.0 { mm } else { self.first_mm.min(mm) };
    }
}

/// Renders with the help of the last picture.
pub struct Reusing<S, R> {
    storage: S,
    settings: Settings,
    refresh: Refresh,
    known: Option<Known<R>>,
    /// Memory of the picture before that, to be filled again.
    spare: (Vec<R>, Vec<f32>, Vec<f32>),
    pictures: u32,
}

impl<S: VoxelStorage, R: Rule> Reusing<S, R> {
    /// Renders `storage` with `settings`.
    pub fn new(storage: S, settings: Settings, refresh: Refresh) -> Self {
        Self { storage, settings, refresh, known: None, spare: (Vec::new(), Vec::new(), Vec::new()), pictures: 0 }
    }

    fn reach(&self) -> f32 {
        match self.settings.classification {
            Classification::Value => ByValue::REACH,
            Classification::Filtered => ByDensity::REACH,
        }
    }
}

impl<S: VoxelStorage, R: Rule> Renderer for Reusing<S, R> {
    fn render(&mut self, view: &View, frame: &mut Frame) -> Work {
        let volume = self.storage.volume();
        // Pixels of other cameras are not pyramids: nothing is proven about them.
        let Some(pyramid) = Pyramid::new(volume, view, self.settings.samples_per_pixel, self.reach()) else {
            self.known = None;
            let mut kept = vec![(); view.width() * view.height()];
            return self.storage.image(view, &self.settings, &FromScratch, &mut kept, frame);
        };
        let free = free_mm(volume, &self.storage.empty_radius(), view.position(), self.reach());
        let (mut kept, coarse, mm) = std::mem::take(&mut self.spare);
        kept.resize(view.width() * view.height(), R::default());
        let known = self.known.take();
        let (n, refresh) = (self.pictures, self.refresh);
        let last = known.as_ref().filter(|_| !refresh.is_key_frame(n)).and_then(|known| {
            let motion = Reprojection::new(&known.view, view)?;
            let bounds = Bounds::new(known, &motion, free, |block| refresh.is_stale(n, block), mm);
            Some((known, motion, bounds))
        });
        let clear = self.storage.empty_radius();
        let begin = FromLast {
            clear,
            pyramid,
            forward: view.forward().as_vec3(),
            free: free as f32,
            last: last.as_ref().map(|(k, m, b)| (*k, m, b)),
        };
        let work = self.storage.image(view, &self.settings, &begin, &mut kept, frame);
        let mm = last.map_or_else(Vec::new, |(_, _, bounds)| bounds.into_mm());
        let (spare, _) = known.map_or_else(Default::default, Known::into_parts);
        self.known = Some(Known::new(view.clone(), kept, coarse));
        self.spare = (spare, Vec::new(), mm);
        self.pictures = self.pictures.wrapping_add(1);
        work
    }

    fn parts(&self) -> Vec<(MemoryPart, usize)> {
        let spare = self.spare.0.capacity() * size_of::<R>() + self.spare.2.capacity() * size_of::<f32>();
        let mut parts = self.storage.parts();
        parts.push((MemoryPart::FrameCache, self.known.as_ref().map_or(0, Known::bytes) + spare));
        parts
    }
}

/// Returns how far samples are empty in all directions around a position, mm.
fn free_mm(volume: &PreparedVolume, clear: &impl EmptyRadius, world: DVec3, reach: f32) -> f64 {
    let grid = volume.voxels().grid();
    let q = grid.voxel(world) + DVec3::ONE;
    let inside = (0..3).all(|a| q[a] > 0.0 && q[a] < (grid.dims()[a] + 1) as f64);
    if !inside {
        return 0.0;
    }
    let free = clear.around(Vec3::new(q.x as f32, q.y as f32, q.z as f32)) - reach - SLACK;
    f64::from(free.max(0.0)) * prove::mm_per_voxel(volume)
}

/// Starts rays where the last picture allows.
struct FromLast<'a, C, R> {
    clear: C,
    pyramid: Pyramid,
    forward: Vec3,
    /// How far it is empty in all directions around the camera, mm.
    free: f32,
    last: Option<(&'a Known<R>, &'a Reprojection, &'a Bounds)>,
}

impl<C: EmptyRadius, R: Rule> FromLast<'_, C, R> {
    /// Returns the proven bound of a pixel, mm, and the distance at which the rule lets its ray start, mm.
    #[inline(always)]
    fn reported(&self, x: usize, y: usize, ray: &Ray) -> (f32, f32) {
        match self.last {
            Some((known, motion, bounds)) => (bounds.at(x, y), R::begin(known, motion, x, y, ray)),
            None => (self.free, f32::INFINITY),
        }
    }
}

impl<C: EmptyRadius, R: Rule> Begin for FromLast<'_, C, R> {
    type Kept = R;

    #[inline(always)]
    fn begin(&self, x: usize, y: usize, ray: &Ray, kept: &mut R) -> (u32, bool) {
        if !ray.inside {
            return (0, false);
        }
        let (proven, wished) = self.reported(x, y, ray);
        let from = proven.min(wished.max(self.free));
        let cos = ray.direction.dot(self.forward).max(1e-6);
        let empty = self.pyramid.empty_mm(&self.clear, ray, cos, from);
        kept.keep_empty(empty.max(proven.min(ray.mm(ray.count))));
        // Samples nearer than that are empty. A hundredth of a step is more than the rounding.
        let n = ((empty - ray.start_mm) * ray.per_mm - 0.01).floor() + 1.0;
        (n.max(0.0) as u32, from > self.free)
    }

    #[inline(always)]
    fn seen(&self, x: usize, y: usize, ray: &Ray, first: u32, kept: &mut R) -> bool {
        let mm = ray.mm(first);
        kept.keep_first(mm);
        match self.last {
            Some((known, motion, _)) if first < ray.count => {
                let wished = R::begin(known, motion, x, y, ray);
                wished.is_finite() && wished > mm
            }
            _ => false,
        }
    }
}

#[cfg(test)]
mod tests;
