//! What images took.

use crate::render::Work;

/// What a frame took.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub struct FrameStats {
    /// Milliseconds from the pose being known to the finished image.
    pub ms: f64,
    /// Rays cast.
    pub rays: u64,
    /// Samples taken.
    pub samples: u64,
    /// Pixels taken over from the last frame.
    pub reused: u64,
}

impl FrameStats {
    /// Of an image that took `ms` milliseconds and this work.
    pub fn new(ms: f64, work: &Work) -> Self {
        Self { ms, rays: work.rays, samples: work.samples, reused: work.reused }
    }
}
