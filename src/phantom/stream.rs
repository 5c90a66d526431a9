//! Streams of random numbers, drawn from the seed.

use crate::math::hash::Stream;

/// Returns a separate stream of random numbers.
pub(crate) fn stream(seed: u64, stream: u64) -> Stream {
    Stream::new(seed, 0xC010_0000 + stream)
}
