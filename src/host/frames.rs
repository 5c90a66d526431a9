//! Time and work of rendered images.

use crate::render::Work;

/// Time and work of one frame.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub struct FrameStats {
    /// Milliseconds from the known pose to the finished image.
    pub ms: f64,
    /// Rays cast.
    pub rays: u64,
    /// Samples taken.
    pub samples: u64,
    /// Pixels reused from the last frame.
    pub reused: u64,
}

impl FrameStats {
    /// Creates the statistics of an image from its time, ms, and its work.
    pub fn new(ms: f64, work: &Work) -> Self {
        Self { ms, rays: work.rays, samples: work.samples, reused: work.reused }
    }
}
