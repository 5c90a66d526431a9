//! Numbers drawn from a seed.

use glam::DVec3;

use crate::math::hash::{self, Stream};

/// Returns a stream of random numbers.
pub(super) fn stream(seed: u64, stream: u64) -> Stream {
    Stream::new(hash::bits(seed, 0x62AF), stream)
}

/// Draws a direction, evenly over the sphere.
pub(super) fn direction(draw: &mut Stream) -> DVec3 {
    let z = draw.within(-1.0, 1.0);
    let (sin, cos) = draw.within(0.0, std::f64::consts::TAU).sin_cos();
    let r = (1.0 - z * z).sqrt();
    DVec3::new(r * cos, r * sin, z)
}
