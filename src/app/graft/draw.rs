//! Numbers drawn from a seed.

use glam::DVec3;

use crate::math::hash;

/// A stream of random numbers. Streams of one seed are independent of each other.
#[derive(Clone, Debug)]
pub(super) struct Draw {
    seed: u64,
    next: u64,
}

impl Draw {
    pub(super) fn new(seed: u64, stream: u64) -> Self {
        Self { seed: hash::bits(hash::bits(seed, 0x62AF), stream), next: 0 }
    }

    /// Draws a number from `lo` to `hi`.
    pub(super) fn within(&mut self, lo: f64, hi: f64) -> f64 {
        self.next += 1;
        lo + (hi - lo) * hash::uniform(self.seed, self.next)
    }

    /// Draws a number below `count`, which is not 0.
    pub(super) fn below(&mut self, count: usize) -> usize {
        (self.within(0.0, count as f64) as usize).min(count - 1)
    }

    /// Draws a direction, evenly over the sphere.
    pub(super) fn direction(&mut self) -> DVec3 {
        let z = self.within(-1.0, 1.0);
        let (sin, cos) = self.within(0.0, std::f64::consts::TAU).sin_cos();
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * cos, r * sin, z)
    }
}
