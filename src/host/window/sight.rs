//! The image of a flight for a window: coarse while it moves, finer and finer when it stands still, and never traced
//! again while it is the same.

use std::time::{Duration, Instant};

use super::refine::{Order, Refiner, Traced, Use, WakeUp};
use super::resolution::Resolution;
use crate::app::FlightApp;
use crate::components::camera::Pose;
use crate::components::output::Picture;
use crate::error::Result;
use crate::host::headless::FrameStats;
use crate::render::{Frame, Quality, Space};

/// Closer than this is the same place, mm.
const SAME_MM: f64 = 4e-3;
/// A camera at rest for so long gets finer images.
const REFINE_AFTER: Duration = Duration::from_millis(180);

/// What an image was made of: nothing has to be traced again as long as it is the same.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Shown {
    pose: Pose,
    size: (usize, usize),
    window: (usize, usize),
    quality: Quality,
}

impl Shown {
    /// Whether it shows what `pose` sees in a window.
    fn shows(&self, pose: &Pose, window: (usize, usize), quality: Quality) -> bool {
        self.window == window && self.quality == quality && same(&self.pose, pose)
    }
}

/// What the operator sees.
pub struct Sight {
    resolution: Resolution,
    shown: Option<Shown>,
    /// The image of a camera at rest, finer than the flight's own.
    fine: Option<Frame>,
    refiner: Refiner,
    moved: Instant,
    frames: Vec<FrameStats>,
    to_save: Vec<Traced>,
}

impl Sight {
    /// No image yet. `wake` is called from another thread when a finer one is there.
    ///
    /// # Errors
    /// Status 1 when the system gives no threads.
    pub fn new(space: Space, wake: WakeUp) -> Result<Self> {
        Ok(Self {
            resolution: Resolution::default(),
            shown: None,
            fine: None,
            refiner: Refiner::new(space, wake)?,
            moved: Instant::now(),
            frames: Vec::new(),
            to_save: Vec::new(),
        })
    }

    /// What the images took.
    pub fn frames(&self) -> &[FrameStats] {
        &self.frames
    }

    /// The image as it was last traced.
    pub fn image<'a>(&'a self, flight: &'a FlightApp) -> Option<&'a Frame> {
        self.shown?;
        self.fine.as_ref().or_else(|| flight.camera::<Picture>().map(|p| &p.frame))
    }

    /// Pixels of the image.
    pub fn size(&self) -> (usize, usize) {
        self.shown.map_or((0, 0), |s| s.size)
    }

    /// Whether the image is that of a camera at rest.
    pub fn is_still(&self) -> bool {
        self.fine.is_some()
    }

    /// When a finer image is to be begun; none if there is none to come, or one is under way.
    pub fn next(&self, window: (usize, usize)) -> Option<Instant> {
        self.shown
            .filter(|s| !self.refiner.is_busy() && Resolution::finer(s.size, window).is_some())
            .map(|_| self.moved + REFINE_AFTER)
    }

    /// Traces an image to be saved, of the given size, in the background.
    pub fn order_to_save(&mut self, flight: &FlightApp, (width, height): (usize, usize)) {
        if let Some(order) = Order::of(flight, (width.max(1), height.max(1)), Use::Save) {
            self.refiner.begin(order);
        }
    }

    /// Images that are ready to be saved.
    pub fn take_to_save(&mut self) -> Vec<Traced> {
        std::mem::take(&mut self.to_save)
    }

    /// Images to be saved, waiting for those under way.
    pub fn all_to_save(&mut self) -> Vec<Traced> {
        while let Some(traced) = self.refiner.wait() {
            self.to_save.extend(traced.ok().filter(|t| t.order.what_for == Use::Save));
        }
        self.take_to_save()
    }

    /// Changes between high and low detail; the new one.
    pub fn switch_detail(&mut self, flight: &mut FlightApp) -> Option<Quality> {
        let mut picture = flight.camera_mut::<Picture>()?;
        let quality = if picture.settings.quality == Quality::Low { Quality::High } else { Quality::Low };
        picture.settings.quality = quality;
        self.resolution.forget();
        Some(quality)
    }

    /// Sees to it that there is an image for a window of the given size; whether it is another than before.
    ///
    /// # Errors
    /// Status 1 when an image cannot be made: a fault of the program.
    pub fn trace(&mut self, flight: &mut FlightApp, window: (usize, usize), now: Instant) -> Result<bool> {
        let mut finer = self.collect(flight, window)?;
        if window.0 == 0 || window.1 == 0 {
            return Ok(false);
        }
        let pose = flight.pose();
        let Some(quality) = quality_of(flight) else { return Ok(false) };
        match self.shown.filter(|s| s.shows(&pose, window, quality)) {
            None => {
                self.moved = now;
                self.fine = None;
                let size = self.resolution.moving(window);
                let ms = self.trace_now(flight, size);
                self.resolution.measured(size.0 * size.1, ms);
                self.shown = Some(Shown { pose, size, window, quality });
                finer = true;
            }
            Some(shown) if now >= self.moved + REFINE_AFTER && !self.refiner.is_busy() => {
                let next = Resolution::finer(shown.size, window);
                if let Some(order) = next.and_then(|size| Order::of(flight, size, Use::Show)) {
                    self.refiner.begin(order);
                }
            }
            Some(_) => {}
        }
        Ok(finer)
    }

    /// Traces the flight's own picture; how long that took, ms.
    fn trace_now(&mut self, flight: &mut FlightApp, (width, height): (usize, usize)) -> f64 {
        if let Some(mut picture) = flight.camera_mut::<Picture>() {
            picture.frame.resize(width, height);
        }
        let begun = Instant::now();
        flight.frame();
        let ms = begun.elapsed().as_secs_f64() * 1e3;
        if let Some(w) = flight.camera::<Picture>().map(|p| p.work) {
            self.count(FrameStats { ms, rays: w.rays, samples: w.samples, reused: w.reused });
        }
        ms
    }

    /// Takes the images that were traced in the background; whether one is to be shown.
    fn collect(&mut self, flight: &FlightApp, window: (usize, usize)) -> Result<bool> {
        let mut finer = false;
        while let Some(traced) = self.refiner.take() {
            let traced = traced?;
            if traced.order.what_for == Use::Save {
                self.to_save.push(traced);
                continue;
            }
            let order = traced.order;
            // The camera may have moved on meanwhile.
            let here = flight.pose();
            let quality = order.settings.quality;
            if quality_of(flight) != Some(quality) || !same(&order.pose, &here) {
                continue;
            }
            if let Some(shown) = self.shown.as_mut().filter(|s| s.shows(&here, window, quality)) {
                shown.size = order.size;
                self.fine = Some(traced.frame);
                self.count(traced.stats);
                finer = true;
            }
        }
        Ok(finer)
    }

    fn count(&mut self, stats: FrameStats) {
        self.frames.push(stats);
    }
}

/// The detail of a flight's images.
pub fn quality_of(flight: &FlightApp) -> Option<Quality> {
    flight.camera::<Picture>().map(|p| p.settings.quality)
}

/// Whether two poses make the same image, as far as one can see.
fn same(a: &Pose, b: &Pose) -> bool {
    let near = |a: glam::DVec3, b: glam::DVec3, by: f64| a.distance(b) < by;
    near(a.position, b.position, SAME_MM)
        && near(a.attitude.forward, b.attitude.forward, 1e-5)
        && near(a.attitude.up, b.attitude.up, 1e-5)
}
