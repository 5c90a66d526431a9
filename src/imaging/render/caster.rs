//! The ray caster of the paper's section 2.2: radiance L and opacity A along each ray, front to back,
//!
//! L ← L + (1 − A)·C and (1 − A) ← (1 − A)(1 − a), C the colour weighted by its opacity a,
//!
//! until 1 − A drops below the camera's sensitivity. The background is black, so the pixel is L.

use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;

use super::begin::{Begin, FromScratch};
use super::camera::{CameraRay, View};
use super::classify::{ByDensity, ByValue, Classifier};
use super::frame::{Frame, Work};
use super::light::{Light, Lighting};
use super::march::{Ray, Step};
use super::quality::{Classification, Quality, Settings};
use super::sampler::{Nearest, Sampler, Trilinear};
use super::shaders::headlight::Headlight;
use super::shaders::{Shader, SurfacePoint, shown};
use super::skip::{Everything, Leap, Skipper};
use super::transfer::Ramp;
use crate::error::Result;
use crate::progress::Progress;
use crate::space::PreparedVolume;
use crate::space::ray::Bundle;

/// Rows of a task and of a tile.
pub(super) const TILE_ROWS: usize = 16;
/// Columns of a tile: neighbouring rays visit the same voxels while they are in the cache.
const TILE_COLUMNS: usize = 32;
/// Side of the squares of pixels whose depths are found together.
const BUNDLE: usize = 8;

/// Renders `view` of `volume` into `frame`, resizing it if needed, on all of rayon's threads.
///
/// The bytes are the same for every number of threads.
pub fn render(volume: &PreparedVolume, view: &View, settings: &Settings, frame: &mut Frame) -> Work {
    let request = ImageRequest { volume, view, settings };
    if settings.quality == Quality::Reference {
        let high = Trilinear::new(volume);
        let mut kept = vec![(); view.width() * view.height()];
        return match settings.classification {
            Classification::Value => request.image(&high, &Everything, &ByValue, &FromScratch, &mut kept, frame),
            Classification::Filtered => request.image(&high, &Everything, &ByDensity, &FromScratch, &mut kept, frame),
        };
    }
    request.plain(&FromScratch, &mut vec![(); view.width() * view.height()], frame)
}

/// The inputs of a picture.
#[derive(Clone, Copy)]
pub struct ImageRequest<'a> {
    /// The volume to show.
    pub volume: &'a PreparedVolume,
    /// The camera and its pixels.
    pub view: &'a View,
    /// The quality and the settings that go with it.
    pub settings: &'a Settings,
}

/// A ray caster assembled from its parts.
struct Caster<'a, S, K, C, B> {
    request: ImageRequest<'a>,
    sampler: &'a S,
    skipper: &'a K,
    classifier: &'a C,
    begin: &'a B,
    headlight: Headlight,
    /// The effects that the light adds to the headlight.
    lighting: Option<Lighting<'a>>,
    /// The shader that replaces the headlight.
    shader: Option<Arc<dyn Shader>>,
    ramp: Ramp,
    step: Step,
    samples_per_pixel: u32,
}

impl ImageRequest<'_> {
    /// Renders the picture from the 16-bit voxels and the flags.
    pub fn plain<B: Begin>(&self, begin: &B, kept: &mut [B::Kept], frame: &mut Frame) -> Work {
        let (high, low) = (Trilinear::new(self.volume), Nearest::new(self.volume));
        let (voxels, bricks) = (Leap::<true>::new(self.volume), Leap::<false>::new(self.volume));
        // Without a bit per voxel, sampling is faster than checking 27 voxels.
        let bits = self.volume.flags().has_bits();
        match (self.settings.quality, self.settings.classification) {
            (Quality::Low, Classification::Value) if bits => self.image(&low, &voxels, &ByValue, begin, kept, frame),
            (Quality::Low, Classification::Value) => self.image(&low, &bricks, &ByValue, begin, kept, frame),
            (Quality::Low, Classification::Filtered) => self.image(&low, &bricks, &ByDensity, begin, kept, frame),
            (_, Classification::Value) if bits => self.image(&high, &voxels, &ByValue, begin, kept, frame),
            (_, Classification::Value) => self.image(&high, &bricks, &ByValue, begin, kept, frame),
            (_, Classification::Filtered) => self.image(&high, &bricks, &ByDensity, begin, kept, frame),
        }
    }

    /// Casts the whole picture with the given parts. `kept` has one entry per pixel.
    pub fn image<S: Sampler, K: Skipper, C: Classifier, B: Begin>(
        &self,
        sampler: &S,
        skipper: &K,
        classifier: &C,
        begin: &B,
        kept: &mut [B::Kept],
        frame: &mut Frame,
    ) -> Work {
        let Self { volume, view, settings } = *self;
        volume.fill_flags();
        let step = Step::new(volume, settings.step_power);
        let caster = Caster {
            request: *self,
            sampler,
            skipper,
            classifier,
            begin,
            headlight: Headlight::new(volume),
            lighting: (settings.light != Light::HEADLIGHT)
                .then(|| Lighting::new(settings.light, volume, view.position())),
            shader: settings.shader.own(),
            ramp: Ramp::new(volume.transfer(), step.power),
            step,
            samples_per_pixel: settings.samples_per_pixel.max(1),
        };
        frame.resize(view.width(), view.height());
        fill_depth(volume, view, frame);
        let pixels = frame.buffers().0;
        let band = TILE_ROWS * view.width();
        let bands = pixels.par_chunks_mut(band).zip(kept.par_chunks_mut(band)).enumerate().map(|(n, (band, kept))| {
            let mut work = Work::default();
            tiles(view.width(), n, band, kept, |x, y, out, kept| *out = caster.pixel(x, y, kept, &mut work));
            work
        });
        bands.reduce(Work::default, |a, b| a + b)
    }
}

/// Fills `depth` with the exact distance to the wall for every pixel of `view`, mm, row by row: infinite where there is
/// no wall. `depth` has as many entries as the view has pixels.
///
/// # Errors
/// Returns status 4 if cancelled.
pub fn depths(volume: &PreparedVolume, view: &View, depth: &mut [f32], progress: &Progress) -> Result<()> {
    crossings(volume, view, depth, progress, |hit| hit.map_or(f32::INFINITY, |(_, t)| t as f32))
}

/// Fills `out` with what `of` makes of every pixel's ray and the exact distance to the wall along it, mm, row by row: `None` where there is
/// no wall.
///
/// # Errors
/// Returns status 4 if cancelled.
#[doc(hidden)]
pub fn crossings<T: Send>(
    volume: &PreparedVolume,
    view: &View,
    out: &mut [T],
    progress: &Progress,
    of: impl Fn(Option<(CameraRay, f64)>) -> T + Sync,
) -> Result<()> {
    let width = view.width();
    out.par_chunks_mut(BUNDLE * width).enumerate().try_for_each(|(n, band)| {
        progress.check()?;
        let rows = band.len() / width;
        let mut rays = Vec::with_capacity(BUNDLE * BUNDLE);
        for left in (0..width).step_by(BUNDLE) {
            let columns = left..(left + BUNDLE).min(width);
            let pixels = || (0..rows).flat_map(|y| columns.clone().map(move |x| (x, y)));
            rays.clear();
            rays.extend(pixels().map(|(x, y)| view.ray(x, n * BUNDLE + y)));
            let bundle = Bundle::new(volume, rays.iter().flatten().map(|r| (r.origin, r.direction)));
            for ((x, y), ray) in pixels().zip(&rays) {
                let hit = ray.and_then(|ray| Some((ray, bundle.first_crossing((ray.origin, ray.direction))?)));
                band[y * width + x] = of(hit);
            }
        }
        Ok(())
    })
}

/// Fills the frame's depth, if it has any.
pub(super) fn fill_depth(volume: &PreparedVolume, view: &View, frame: &mut Frame) {
    if let Some(depth) = frame.buffers().1 {
        // Nobody cancels it.
        let _ = depths(volume, view, depth, &Progress::new());
    }
}

/// Calls `each` for every pixel of the `n`-th band of rows and its entry in `beside`, tile by tile.
fn tiles<T, U>(
    width: usize,
    n: usize,
    band: &mut [T],
    beside: &mut [U],
    mut each: impl FnMut(usize, usize, &mut T, &mut U),
) {
    for left in (0..width).step_by(TILE_COLUMNS) {
        let right = (left + TILE_COLUMNS).min(width);
        let rows = band.chunks_exact_mut(width).zip(beside.chunks_exact_mut(width));
        for (row, (pixels, beside)) in rows.enumerate() {
            let pixels = pixels[left..right].iter_mut().zip(&mut beside[left..right]);
            for (x, (out, beside)) in (left..right).zip(pixels) {
                each(x, n * TILE_ROWS + row, out, beside);
            }
        }
    }
}

/// Returns where ray `n` of `count` passes through a pixel, each coordinate from 0 to 1.
///
/// A single ray passes through the centre. Several use the points of a golden-ratio lattice, which are evenly spread
/// for every count.
pub(super) fn within_pixel(n: u32, count: u32) -> (f64, f64) {
    if count == 1 {
        return (0.5, 0.5);
    }
    let n = f64::from(n) + 0.5;
    (n / f64::from(count), (n * 0.618_033_988_749_894_9).fract())
}

impl<S: Sampler, K: Skipper, C: Classifier, B: Begin> Caster<'_, S, K, C, B> {
    fn pixel(&self, x: usize, y: usize, kept: &mut B::Kept, work: &mut Work) -> [u8; 3] {
        let ImageRequest { volume, view, .. } = self.request;
        let mut light = Vec3::ZERO;
        *kept = B::Kept::default();
        for n in 0..self.samples_per_pixel {
            let (u, v) = within_pixel(n, self.samples_per_pixel);
            let Some(CameraRay { origin, direction }) = view.ray_at(x as f64 + u, y as f64 + v) else { continue };
            work.rays += 1;
            if let Some(ray) = Ray::new(volume, origin, direction, self.step) {
                let (start, reused) = self.begin.begin(x, y, &ray, kept);
                work.reused += u64::from(reused);
                let (radiance, first) = self.cast(&ray, start, &mut work.samples);
                work.misled += u64::from(self.begin.seen(x, y, &ray, first, kept));
                light += radiance;
            }
        }
        (light / self.samples_per_pixel as f32).to_array().map(|c| (c * 255.0 + 0.5) as u8)
    }

    /// Returns the radiance that arrives along a ray from sample `n` on, and the first sample that was not empty (the
    /// ray's count if there was none).
    #[inline(always)]
    fn cast(&self, ray: &Ray, mut n: u32, samples: &mut u64) -> (Vec3, u32) {
        let (mut light, mut through) = (Vec3::ZERO, 1.0f32);
        let mut first = ray.count;
        if n >= ray.count {
            return (light, first);
        }
        let mut walk = self.skipper.start(ray, n);
        loop {
            n = self.skipper.next(&mut walk, ray, n);
            if n >= ray.count {
                break;
            }
            *samples += 1;
            let q = ray.at(n);
            let (hu, gradient) = self.classifier.look(self.sampler, q);
            let a = self.ramp.opacity(hu);
            if a > 0.0 {
                first = first.min(n);
                // The flag takes precedence over a gradient that was free to compute: inside solid tissue that gradient is noise.
                let gradient = match gradient {
                    Some(gradient) if !self.sampler.is_within_tissue(q) => gradient,
                    Some(_) => Vec3::ZERO,
                    None => self.sampler.gradient(q),
                };
                let colour = match (&self.shader, &self.lighting) {
                    (None, None) => self.headlight.colour(hu, gradient, ray.direction),
                    (None, Some(lighting)) => self.lit(lighting, ray, n, hu, gradient),
                    (Some(shader), _) => self.shaded(&**shader, ray, n, hu, gradient),
                };
                light += colour * (through * a);
                through *= 1.0 - a;
                if through < self.request.settings.sensitivity {
                    break;
                }
            }
            n += 1;
        }
        (light, first)
    }

    /// Returns the colour of sample `n` of a ray in a light other than the headlight.
    fn lit(&self, lighting: &Lighting<'_>, ray: &Ray, n: u32, hu: f32, gradient: Vec3) -> Vec3 {
        let distance = ray.start_mm + n as f32 / ray.per_mm;
        let q = ray.at(n);
        let gradient = self.headlight.world_gradient(gradient);
        let facing = self.headlight.facing(gradient, ray.direction);
        self.headlight.tissue(hu) * lighting.brightness(facing, distance, gradient, q)
    }

    /// Returns the colour that a custom shader gives to sample `n` of a ray.
    #[cold]
    fn shaded(&self, shader: &dyn Shader, ray: &Ray, n: u32, hu: f32, gradient: Vec3) -> Vec3 {
        let distance = ray.start_mm + n as f32 / ray.per_mm;
        let gradient = self.headlight.world_gradient(gradient);
        let camera = self.request.view.position();
        shown(shader.colour(&SurfacePoint::new(camera, ray.direction, distance, hu, gradient)))
    }
}

#[cfg(test)]
#[path = "caster_tests.rs"]
mod tests;
