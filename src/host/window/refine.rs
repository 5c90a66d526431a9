//! Traces images besides the flight: the fine image of a camera at rest, and screenshots, which may take longer than the
//! operator wants to wait for an answer to a key.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Instant;

use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::app::FlightApp;
use crate::components::camera::Pose;
use crate::components::output::Picture;
use crate::error::{Error, Result};
use crate::host::headless::FrameStats;
use crate::render::{Frame, Settings, Space, View, render};

/// What an image is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Use {
    /// To be shown.
    Show,
    /// To be saved.
    Save,
}

/// An image to be traced.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Order {
    /// Whence.
    pub pose: Pose,
    /// Pixels.
    pub size: (usize, usize),
    /// View angle over the shorter side, degrees.
    pub fov_degrees: f64,
    /// How.
    pub settings: Settings,
    /// What for.
    pub what_for: Use,
}

impl Order {
    /// The image of a flight's camera as it is now, in another size.
    pub fn of(flight: &FlightApp, size: (usize, usize), what_for: Use) -> Option<Self> {
        let picture = flight.camera::<Picture>()?;
        let (fov_degrees, settings) = (picture.fov_degrees, picture.settings);
        Some(Self { pose: flight.pose(), size, fov_degrees, settings, what_for })
    }

    fn trace(&self, space: &Space) -> Result<Traced> {
        let begun = Instant::now();
        let (a, (width, height)) = (self.pose.attitude, self.size);
        let view = View::new(self.pose.position, a.forward, a.up, self.fov_degrees, width, height)?;
        let mut frame = Frame::new(width, height, false);
        let w = render(space, &view, &self.settings, &mut frame);
        let ms = begun.elapsed().as_secs_f64() * 1e3;
        let stats = FrameStats { ms, rays: w.rays, samples: w.samples, reused: w.reused };
        Ok(Traced { order: *self, frame, stats })
    }
}

/// A traced image.
pub struct Traced {
    /// What was ordered.
    pub order: Order,
    /// The image.
    pub frame: Frame,
    /// What it took.
    pub stats: FrameStats,
}

/// Traces images in the background.
pub struct Refiner {
    /// Threads of their own: in the common pool, images of the flight would have to wait for these.
    pool: ThreadPool,
    space: Space,
    wake: WakeUp,
    sender: Sender<(Use, Result<Traced>)>,
    receiver: Receiver<(Use, Result<Traced>)>,
    showing: usize,
    saving: usize,
}

/// A [`Refiner`]'s thread calls this after each image.
pub type WakeUp = Arc<dyn Fn() + Send + Sync>;

impl Refiner {
    /// Traces in `space`, and calls `wake` when an image is there.
    ///
    /// # Errors
    /// Status 1 when the system gives no threads.
    pub fn new(space: Space, wake: WakeUp) -> Result<Self> {
        let pool = ThreadPoolBuilder::new()
            .num_threads(rayon::current_num_threads())
            .thread_name(|n| format!("refine {n}"))
            .build()
            .map_err(|e| Error::fault("threads", e.to_string(), "use fewer --threads"))?;
        let (sender, receiver) = channel();
        Ok(Self { pool, space, wake, sender, receiver, showing: 0, saving: 0 })
    }

    /// Whether an image to be shown is being traced.
    pub fn is_busy(&self) -> bool {
        self.showing > 0
    }

    /// Begins an image.
    pub fn begin(&mut self, order: Order) {
        let (space, sender, wake) = (self.space.clone(), self.sender.clone(), Arc::clone(&self.wake));
        *self.count(order.what_for) += 1;
        self.pool.spawn(move || {
            // Whoever ordered it may have gone.
            let _ = sender.send((order.what_for, order.trace(&space)));
            wake();
        });
    }

    fn count(&mut self, what_for: Use) -> &mut usize {
        match what_for {
            Use::Show => &mut self.showing,
            Use::Save => &mut self.saving,
        }
    }

    /// An image that has become ready since the last call.
    pub fn take(&mut self) -> Option<Result<Traced>> {
        let (what_for, traced) = self.receiver.try_recv().ok()?;
        *self.count(what_for) -= 1;
        Some(traced)
    }

    /// Waits for the next image if one that is to be saved is still to come.
    pub fn wait(&mut self) -> Option<Result<Traced>> {
        if self.saving == 0 {
            return None;
        }
        let (what_for, traced) = self.receiver.recv().ok()?;
        *self.count(what_for) -= 1;
        Some(traced)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::Attitude;
    use crate::render::{Quality, Wall};
    use crate::volume::{Grid, Volume};
    use glam::{DMat3, DVec3};

    #[test]
    fn the_same_image_as_in_the_foreground() {
        let grid = Grid::new([16, 16, 16], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let data = (0..16 * 16 * 16).map(|n| if n % 16 < 4 { 100 } else { -1000 }).collect();
        let space = Space::new(Arc::new(Volume::new(grid, data)), Wall::default());
        let order = Order {
            pose: Pose { position: DVec3::splat(8.0), attitude: Attitude::new(DVec3::NEG_X, DVec3::Z) },
            size: (30, 20),
            fov_degrees: 90.0,
            settings: Settings::new(Quality::High),
            what_for: Use::Save,
        };
        let mut refiner = Refiner::new(space.clone(), Arc::new(|| {})).unwrap();
        assert!(refiner.wait().is_none(), "nothing was ordered");
        refiner.begin(order);
        assert!(!refiner.is_busy(), "nothing is to be shown");
        let traced = refiner.wait().unwrap().unwrap();
        assert_eq!(traced.frame, order.trace(&space).unwrap().frame);
        assert_eq!(traced.stats.rays, 600);
        assert!(refiner.take().is_none() && refiner.wait().is_none());
    }
}
