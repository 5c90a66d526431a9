//! Live coverage: what a flight has seen of the wall so far, patch by patch.
//!
//! The same test as [`Wall::seen`](super::Wall::seen), done as the views come and for one triangle of each patch (its middle),
//! which stands for the others: the error is that of a sample of the wall every 2 mm. Of a block of 8 mm, three patches are tested
//! first. If all are hidden, as those of another loop of the colon are, the block is tested again with other patches once the
//! camera has moved by a share of its distance; so is a hidden patch of a block in view. Near blocks are tested whole. A view takes
//! several steps of the flight, each with a bounded amount of work, and views are queued; if more than a few wait, the oldest are
//! skipped. A patch is in view of dozens of views, so all of this costs little: `report coverage` compares it with the measurement
//! afterwards.

use std::sync::Arc;

use bevy_ecs::prelude::*;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::sight::{Eye, REACH, Sightline};
use super::stretches::{INTO_GAS_MM, STRETCH_MM, stretches};
use super::wall::Wall;
use crate::dynamics::Attitude;
use crate::error::Result;
use crate::fields::Lumen;
use crate::fields::lumen::CoarseAlong;
use crate::progress::Progress;
use crate::render::camera::{Camera, Perspective};
use crate::render::{CameraModel, Origins};
use crate::space::PreparedVolume;
use crate::volume::Volume;

/// A hidden patch or block is tested again when the camera has moved by this share of its distance.
const AGAIN: f32 = 0.03;
/// Number of patches of a block that are tested before it counts as hidden.
const PROBES: usize = 3;
/// A ray costs as much as this many tests of whether a patch is in the picture.
const RAY: u32 = 100;
/// Distance within which a block never counts as hidden by its probes, mm: from nearby, a patch is in view of a few views only.
const CLOSE_MM: f32 = 25.0;
/// Maximum number of queued views: some mm of a flight.
const WAITING: usize = 12;

/// A place along the colon counts as passed, and what was not seen of its wall as missed, when the camera has come this near along the
/// colon and has flown on so far, mm.
const NEAR_MM: f64 = 40.0;
const PASSED_MM: f32 = 60.0;
/// Time for which missed wall stays painted after it was seen after all, s.
const FADES_S: f32 = 3.0;

/// Returns the camera by which the coverage of pictures of a model is measured: a square one. Lines of sight come from one point, so a model
/// whose rays do not counts as perspective.
///
/// # Errors
/// Returns status 2 if the model has no camera with this view angle.
pub fn sight_camera(model: CameraModel, fov_degrees: f64) -> Result<Arc<dyn Camera>> {
    let camera = model.camera(fov_degrees, 1.0)?;
    Ok(if camera.origins() == Origins::One { camera } else { Arc::new(Perspective::new(fov_degrees)?) })
}

/// A wall, and the part of it that was seen so far.
#[derive(Component, Clone, Debug)]
pub struct LiveCoverage {
    wall: Arc<Wall>,
    gas: Arc<Lumen>,
    /// The gas that is flown while this is watched: the same, unless another scan is shown in its place.
    pub(super) flown: Arc<Lumen>,
    /// The scan whose wall this is, if it is not the one that is flown through.
    pub(super) beside: Option<PreparedVolume>,
    camera: Arc<dyn Camera>,
    model: CameraModel,
    fov_degrees: f64,
    /// Centroid and normal of each patch's middle, mm from the wall's origin.
    middles: Vec<[Vec3; 2]>,
    /// Area of each patch, mm².
    mm2: Vec<f32>,
    /// The segment that each patch belongs to.
    segments: Vec<u16>,
    /// When each patch was first seen, s: infinite until then, and minus infinity if it was not missed before.
    seen_s: Vec<f32>,
    /// The value of [`odometer_mm`](Self::odometer_mm) from which each patch is tested again.
    due_mm: Vec<f32>,
    /// The same for each block.
    block_due_mm: Vec<f32>,
    /// The coarse map of the ways through the gas: wall of another loop may be nearer than wall at the camera's place.
    along: Arc<CoarseAlong>,
    /// The stretch of the colon that each block belongs to.
    stretches: Vec<u32>,
    /// The first stretch of each segment.
    first_stretch: Vec<u32>,
    /// [`flown_mm`](Self::flown_mm) when the camera first came near each stretch; infinite until then.
    near_mm: Vec<f32>,
    /// True once the flight is over: what was not seen until then is missed.
    is_over: bool,
    /// The number of unseen patches of each block.
    left: Vec<u32>,
    /// What belongs to each segment.
    shares: Vec<Share>,
    /// Number of views taken.
    taken: usize,
    /// Length of the line through all views, mm.
    odometer_mm: f32,
    /// The same for the trail and the views before it.
    flown_mm: f32,
    /// Number of views taken in addition to the trail.
    pub(super) looked: usize,
    /// Where the last view was, world mm.
    pub(super) last: Option<DVec3>,
    /// Time that the flight's clock has not counted, s.
    pub(super) rested_s: f32,
    /// The view that is being processed.
    now: Option<Looking>,
}

/// A segment's wall.
#[derive(Clone, Copy, Debug, Default)]
struct Share {
    mm2: f64,
    seen_mm2: f64,
    visited: bool,
}

/// A view that is being processed.
#[derive(Clone, Debug)]
struct Looking {
    eye: Eye,
    seconds: f32,
    block: usize,
    /// How many tests of the current block are done: first the probes, then patch by patch.
    asked: usize,
    /// Whether any of its patches was in the picture, and whether one was seen.
    tried: bool,
    free: bool,
    blocked: f64,
}

impl LiveCoverage {
    /// Begins with nothing seen of the wall of some gas in `volume`, in square pictures with a view angle of 90°.
    ///
    /// # Errors
    /// Returns status 4 if interrupted or if the wall has more vertices than 32 bits can count.
    pub fn of(volume: &PreparedVolume, gas: &Arc<Lumen>, progress: &Progress) -> Result<Self> {
        Self::in_voxels(volume.voxels(), volume.transfer().iso(), gas, progress)
    }

    /// The same for gas found in a volume, whose wall is at `iso` HU.
    pub(super) fn in_voxels(volume: &Volume, iso: f64, gas: &Arc<Lumen>, progress: &Progress) -> Result<Self> {
        let all: Vec<usize> = (0..gas.segments.len()).collect();
        let wall = Wall::of(volume, gas, &all, iso, progress)?;
        let along = CoarseAlong::new(gas, progress)?;
        Self::new(Arc::new(wall), Arc::clone(gas), along)
    }

    /// Begins with nothing seen of a wall of some gas.
    fn new(wall: Arc<Wall>, gas: Arc<Lumen>, along: CoarseAlong) -> Result<Self> {
        let patches = wall.patch_count();
        let each = || (0..patches).into_par_iter();
        let middles = each().map(|p| wall.middle(p)).map(|face| [face.centroid, face.normal]);
        let middles: Vec<[Vec3; 2]> = middles.collect();
        let mm2: Vec<f32> = each().map(|p| wall.triangles_of(p).map(|n| wall.face(n).mm2).sum()).collect();
        let segment = |p: usize| {
            let [centroid, normal] = middles[p];
            gas.segment_at(wall.origin + centroid.as_dvec3() + normal.as_dvec3() * INTO_GAS_MM)
        };
        // The gas before a few patches is too thin: they count with those before them.
        let mut last = 0;
        let segments: Vec<u16> = (0..patches)
            .map(|p| {
                last = segment(p).map_or(last, |s| s.min(usize::from(u16::MAX)) as u16);
                last
            })
            .collect();
        let mut shares = vec![Share::default(); segments.iter().max().map_or(0, |&s| usize::from(s) + 1)];
        segments.iter().zip(&mm2).for_each(|(&s, &mm2)| shares[usize::from(s)].mm2 += f64::from(mm2));
        let left = (0..wall.block_count()).map(|b| wall.patches_of(b).len() as u32).collect();
        let (stretches, first_stretch) = stretches(&wall, &gas, &along);
        let stretch_count = first_stretch.last().map_or(0, |&n| n as usize);
        Ok(Self {
            camera: Arc::new(Perspective::new(90.0)?),
            model: CameraModel::default(),
            fov_degrees: 90.0,
            middles,
            mm2,
            segments,
            seen_s: vec![f32::INFINITY; patches],
            due_mm: vec![0.0; patches],
            block_due_mm: vec![0.0; wall.block_count()],
            along: Arc::new(along),
            stretches,
            first_stretch,
            near_mm: vec![f32::INFINITY; stretch_count],
            is_over: false,
            left,
            shares,
            taken: 0,
            odometer_mm: 0.0,
            flown_mm: 0.0,
            looked: 0,
            last: None,
            rested_s: 0.0,
            now: None,
            wall,
            flown: Arc::clone(&gas),
            beside: None,
            gas,
        })
    }

    /// Sets the view angle of the views from now on, degrees. An invalid angle is ignored.
    pub fn set_fov(&mut self, degrees: f64) {
        if degrees != self.fov_degrees
            && let Ok(camera) = sight_camera(self.model, degrees)
        {
            (self.camera, self.fov_degrees) = (camera, degrees);
        }
    }

    /// Sets the camera model and the view angle of the views from now on, degrees. A camera that cannot be made is ignored.
    pub fn set_camera(&mut self, model: CameraModel, degrees: f64) {
        if let Ok(camera) = sight_camera(model, degrees) {
            (self.camera, self.model, self.fov_degrees) = (camera, model, degrees);
        }
    }

    /// Continues with the views of a flight (world position, mm, and attitude) at a time of the flight, s. `work` is the maximum
    /// number of tests of whether a patch is in the picture.
    ///
    /// The next view is taken whenever one is done, unless too many wait.
    pub fn watch(&mut self, volume: &PreparedVolume, views: &[(DVec3, Attitude)], seconds: f64, work: u32) {
        let volume = &self.scan(volume).clone();
        let mut left = work;
        loop {
            if self.now.is_none() {
                self.take(views, (self.taken + 1).max(views.len().saturating_sub(WAITING)), seconds);
            }
            if self.now.is_none() || !self.go_on(volume, &mut left) {
                return;
            }
        }
    }

    /// Takes all views that have not been taken, one by one.
    ///
    /// # Errors
    /// Returns status 4 if interrupted: then it has taken some of them.
    pub fn catch_up(
        &mut self,
        volume: &PreparedVolume,
        views: &[(DVec3, Attitude)],
        seconds: f64,
        progress: &Progress,
    ) -> Result<()> {
        let volume = &self.scan(volume).clone();
        while self.taken < views.len() || self.now.is_some() {
            progress.check()?;
            if self.now.is_none() {
                self.take(views, self.taken + 1, seconds);
            }
            let mut unbounded = u32::MAX;
            self.go_on(volume, &mut unbounded);
        }
        Ok(())
    }

    /// Begins with the last view before `end`, if it has not been taken.
    fn take(&mut self, views: &[(DVec3, Attitude)], end: usize, seconds: f64) {
        if end <= self.taken || end > views.len() {
            return;
        }
        for n in self.taken.max(1)..end {
            let mm = views[n].0.distance(views[n - 1].0);
            self.moved(mm);
            self.flew(mm);
        }
        self.taken = end;
        self.begin(&views[end - 1], seconds);
    }

    /// Counts a distance moved by the camera, mm.
    pub(super) fn moved(&mut self, mm: f64) {
        let mm = mm as f32;
        self.odometer_mm += if mm.is_finite() { mm } else { 0.0 };
    }

    /// Counts a distance flown, mm.
    pub(super) fn flew(&mut self, mm: f64) {
        let mm = mm as f32;
        self.flown_mm += if mm.is_finite() { mm } else { 0.0 };
    }

    /// True once a view of the trail was taken.
    pub(super) fn has_flown(&self) -> bool {
        self.taken > 0
    }

    /// Returns the same wall with nothing seen of it.
    #[must_use]
    pub fn afresh(&self) -> Self {
        let mut anew = self.clone();
        anew.seen_s.fill(f32::INFINITY);
        anew.due_mm.fill(0.0);
        anew.block_due_mm.fill(0.0);
        anew.near_mm.fill(f32::INFINITY);
        for (b, left) in anew.left.iter_mut().enumerate() {
            *left = self.wall.patches_of(b).len() as u32;
        }
        for share in &mut anew.shares {
            *share = Share { mm2: share.mm2, ..Share::default() };
        }
        (anew.taken, anew.looked, anew.odometer_mm, anew.flown_mm) = (0, 0, 0.0, 0.0);
        (anew.last, anew.now) = (None, None);
        anew
    }

    /// Begins with a view.
    pub(super) fn begin(&mut self, view: &(DVec3, Attitude), seconds: f64) {
        if let Some(share) = self.gas.segment_at(view.0).and_then(|s| self.shares.get_mut(s)) {
            share.visited = true;
        }
        self.come_near(view.0);
        let eye = Eye::new(view, self.wall.origin);
        self.last = eye.as_ref().map(|eye| eye.world).or(self.last);
        self.now = eye.map(|eye| Looking {
            eye,
            seconds: seconds as f32 + self.rested_s,
            block: 0,
            asked: 0,
            tried: false,
            free: false,
            blocked: f64::INFINITY,
        });
    }

    /// Notes that the camera has come near a place along the colon (world, mm).
    fn come_near(&mut self, place: DVec3) {
        let Some((segment, mm)) = self.along.of(place).filter(|_| place.is_finite()) else { return };
        let Some(&[first, end]) = self.first_stretch.get(segment..segment + 2) else { return };
        let stretch = |mm: f64| first + ((mm.max(0.0) / STRETCH_MM) as u32).min(end - first);
        let near = stretch(mm - NEAR_MM)..(stretch(mm + NEAR_MM) + 1).min(end);
        for n in near {
            let reading = &mut self.near_mm[n as usize];
            *reading = reading.min(self.flown_mm);
        }
    }

    /// Finishes the current view.
    pub(super) fn finish(&mut self, volume: &PreparedVolume) {
        let mut unbounded = u32::MAX;
        while !self.go_on(volume, &mut unbounded) {
            unbounded = u32::MAX;
        }
    }

    /// Continues with the current view. Returns true if it is done, and false if the work ran out first.
    fn go_on(&mut self, volume: &PreparedVolume, work: &mut u32) -> bool {
        let Some(mut now) = self.now.take() else { return true };
        let wall = Arc::clone(&self.wall);
        let line = Sightline::new(&wall, volume, &*self.camera);
        while now.block < wall.block_count() {
            let b = now.block;
            if now.asked == 0 {
                *work = work.saturating_sub(1);
                let is_over = self.left[b] == 0 || self.block_due_mm[b] > self.odometer_mm;
                let squared = if is_over { f32::INFINITY } else { line.square_to_block(b, &now.eye) };
                if squared > REACH * REACH || !line.may_see_block(b, &now.eye)[0] {
                    now.block += 1;
                    continue;
                }
            }
            let patches = wall.patches_of(b);
            let count = patches.len();
            while now.asked < PROBES + count {
                if *work == 0 {
                    self.now = Some(now);
                    return false;
                }
                let n = now.asked;
                now.asked += 1;
                // Other probes each time.
                let p = patches.start
                    + if n < PROBES {
                        ((self.taken + self.looked) * 7 + n * count / PROBES) % count
                    } else {
                        n - PROBES
                    };
                if n == PROBES && now.tried && !now.free {
                    let far = line.square_to_block(b, &now.eye).sqrt();
                    if far > CLOSE_MM {
                        self.block_due_mm[b] = self.odometer_mm + AGAIN * far;
                        break;
                    }
                }
                if self.seen_s[p] < f32::INFINITY || self.due_mm[p] > self.odometer_mm {
                    continue;
                }
                *work = work.saturating_sub(1);
                let [centroid, normal] = self.middles[p];
                if !line.is_in_picture(centroid, normal, &now.eye, true) {
                    continue;
                }
                *work = work.saturating_sub(RAY);
                now.tried = true;
                if line.is_free(centroid, &now.eye, &mut now.blocked) {
                    now.free = true;
                    self.seen_s[p] = if self.is_passed(b) { now.seconds } else { f32::NEG_INFINITY };
                    self.left[b] -= 1;
                    self.shares[usize::from(self.segments[p])].seen_mm2 += f64::from(self.mm2[p]);
                } else {
                    self.due_mm[p] = self.odometer_mm + AGAIN * centroid.distance(now.eye.at);
                }
            }
            (now.block, now.asked, now.tried, now.free) = (b + 1, 0, false, false);
        }
        true
    }

    /// Returns the share of the wall that was seen, of the segments that were visited, 0 to 1.
    pub fn share(&self) -> f64 {
        let visited = || self.shares.iter().filter(|s| s.visited);
        let all: f64 = visited().map(|s| s.mm2).sum();
        if all > 0.0 { (visited().map(|s| s.seen_mm2).sum::<f64>() / all).clamp(0.0, 1.0) } else { 0.0 }
    }

    /// True if more views than a flight's steps still take wait for their turn.
    pub fn lags(&self, views: &[(DVec3, Attitude)]) -> bool {
        views.len() > self.taken + WAITING
    }

    /// True if it is the wall of this gas.
    pub fn is_of(&self, gas: &Arc<Lumen>) -> bool {
        Arc::ptr_eq(&self.gas, gas)
    }

    /// Returns the gas whose wall it is.
    pub fn gas(&self) -> &Arc<Lumen> {
        &self.gas
    }

    /// Returns the wall of some segments.
    pub fn wall_of(&self, segments: &[usize]) -> Wall {
        if self.segments.iter().all(|&s| segments.contains(&usize::from(s))) {
            return Wall::clone(&self.wall);
        }
        let mut keeps = vec![false; self.wall.len()];
        for p in (0..self.wall.patch_count()).filter(|&p| segments.contains(&usize::from(self.segments[p]))) {
            keeps[self.wall.triangles_of(p)].fill(true);
        }
        self.wall.part(|n| keeps[n]).0
    }

    /// Returns the wall.
    pub fn wall(&self) -> &Wall {
        &self.wall
    }

    /// Returns the wall with shared ownership.
    pub(super) fn shared_wall(&self) -> &Arc<Wall> {
        &self.wall
    }

    /// Returns the view angle of the views, degrees.
    pub(super) fn fov_degrees(&self) -> f64 {
        self.fov_degrees
    }

    /// Returns the camera of the views.
    pub fn camera(&self) -> &dyn Camera {
        &*self.camera
    }

    /// Sets whether the flight is over: then none of the wall lies ahead.
    pub fn set_over(&mut self, is_over: bool) {
        self.is_over = is_over;
    }

    /// Returns, for each triangle of the wall, whether it was missed: it was not seen, and the flight has passed it. None is missed in
    /// segments that were not visited.
    pub fn missed(&self) -> Vec<bool> {
        let mut missed = vec![false; self.wall.len()];
        for b in (0..self.wall.block_count()).filter(|&b| self.is_passed(b)) {
            for p in self.wall.patches_of(b).filter(|&p| self.is_missing(p)) {
                missed[self.wall.triangles_of(p)].fill(true);
            }
        }
        missed
    }

    /// Returns the share of the area of some triangles that was seen, 0 to 1.
    pub fn share_of(&self, triangles: &[u32]) -> f64 {
        let mm2 = |of: &dyn Fn(usize) -> bool| -> f64 {
            let of = triangles.iter().map(|&t| t as usize).filter(|&t| t < self.wall.len() && of(t));
            of.map(|t| self.wall.mm2_at(t)).sum()
        };
        let all = mm2(&|_| true);
        let patch = |t: usize| self.wall.patches.partition_point(|p| p.first as usize <= t) - 1;
        if all > 0.0 { mm2(&|t| self.seen_s[patch(t)] < f32::INFINITY) / all } else { 0.0 }
    }

    /// Returns centroid (mm from the wall's origin) and normal of a patch's middle.
    pub(super) fn middle(&self, patch: usize) -> [Vec3; 2] {
        self.middles[patch]
    }

    /// Returns the middle of each patch, world mm.
    pub fn middles(&self) -> impl Iterator<Item = DVec3> {
        self.middles.iter().map(|m| self.wall.origin + m[0].as_dvec3())
    }

    /// Sums the area of the patches and what was seen of it, mm², by bins: `bins` has the bin of each patch, and one beyond `count` counts
    /// nowhere.
    pub fn seen_by(&self, bins: &[u8], count: usize) -> Vec<[f64; 2]> {
        let mut sums = vec![[0.0; 2]; count];
        for ((bin, mm2), seen_s) in bins.iter().zip(&self.mm2).zip(&self.seen_s) {
            if let Some([all, seen]) = sums.get_mut(usize::from(*bin)) {
                *all += f64::from(*mm2);
                *seen += if *seen_s < f32::INFINITY { f64::from(*mm2) } else { 0.0 };
            }
        }
        sums
    }

    /// True if all patches of a block were seen.
    pub(super) fn is_all_seen(&self, block: usize) -> bool {
        self.left[block] == 0
    }

    /// True if a patch was not seen, of a segment that was visited.
    pub(super) fn is_missing(&self, patch: usize) -> bool {
        self.seen_s[patch] == f32::INFINITY && self.shares[usize::from(self.segments[patch])].visited
    }

    /// True if the flight has flown so far since it came near a block that the unseen part of the block counts as missed.
    fn is_passed(&self, block: usize) -> bool {
        self.is_over || self.flown_mm - self.near_mm[self.stretches[block] as usize] > PASSED_MM
    }

    /// Returns how much a patch of a block is painted over a picture at a time of the flight, s: 1 once the flight has passed it and has
    /// not seen it, and less and less for 3 s from when it was seen after all, so that it can be looked at.
    pub(super) fn paint(&self, block: usize, patch: usize, seconds: f32) -> f32 {
        match self.seen_s[patch] {
            f32::INFINITY => f32::from(u8::from(self.is_passed(block))),
            seen => (1.0 - (seconds + self.rested_s - seen).max(0.0) / FADES_S).clamp(0.0, 1.0),
        }
    }

    /// Returns the size in memory with the wall, bytes.
    pub fn bytes(&self) -> usize {
        self.wall.bytes()
            + size_of_val(self.middles.as_slice())
            + size_of_val(self.mm2.as_slice())
            + size_of_val(self.segments.as_slice())
            + 2 * size_of_val(self.seen_s.as_slice())
            + size_of_val(self.left.as_slice())
            + size_of_val(self.block_due_mm.as_slice())
            + size_of_val(self.stretches.as_slice())
            + self.along.bytes()
    }
}
