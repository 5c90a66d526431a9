//! Streams of random numbers, drawn from the seed.

use crate::math::hash;

/// A separate stream of random numbers.
pub(crate) struct Stream {
    seed: u64,
    next: u64,
}

impl Stream {
    pub(crate) fn new(seed: u64, stream: u64) -> Self {
        Self { seed: hash::bits(seed, 0xC010_0000 + stream), next: 0 }
    }

    pub(crate) fn within(&mut self, lo: f64, hi: f64) -> f64 {
        self.next += 1;
        lo + (hi - lo) * hash::uniform(self.seed, self.next)
    }
}
