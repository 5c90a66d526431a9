//! Where sixteen rays go, and which cells they are in.

use fearless_simd::{Simd, f32x16, i32x16, prelude::*};
use glam::Vec3;

use super::beam::Beam;

/// The directions of sixteen rays.
pub struct Directions<S: Simd> {
    /// A step, voxels.
    pub along: [f32x16<S>; 3],
    /// World direction, of unit length.
    pub world: [f32x16<S>; 3],
}

impl<S: Simd> Directions<S> {
    /// The rays' places `k` steps from `origin`.
    #[inline(always)]
    pub fn at(&self, origin: Vec3, k: f32) -> [f32x16<S>; 3] {
        let [x, y, z] = self.along;
        [x * k + origin.x, y * k + origin.y, z * k + origin.z]
    }

    /// As [`Directions::at`], each ray with its own `k`.
    #[inline(always)]
    pub fn at_each(&self, origin: Vec3, k: f32x16<S>) -> [f32x16<S>; 3] {
        let [x, y, z] = self.along;
        [x * k + origin.x, y * k + origin.y, z * k + origin.z]
    }

    /// The bundle of the rays, and of those whose steps are up to `margin` beside theirs, voxels.
    #[inline(always)]
    pub fn beam(&self, origin: Vec3, margin: f32) -> Beam {
        let [x, y, z] = self.along;
        let low = Vec3::new(x.reduce_min(), y.reduce_min(), z.reduce_min());
        let high = Vec3::new(x.reduce_max(), y.reduce_max(), z.reduce_max());
        Beam::new(origin, low - margin, high + margin)
    }
}

/// Cells (counted from cell −1) and the places within them, 0 to 1.
#[inline(always)]
pub fn split<S: Simd>(q: [f32x16<S>; 3]) -> ([i32x16<S>; 3], [f32x16<S>; 3]) {
    // Not by `map`: closures do not inherit the level's instructions.
    let floor = [q[0].floor(), q[1].floor(), q[2].floor()];
    let place = [q[0] - floor[0], q[1] - floor[1], q[2] - floor[2]];
    let cell = [floor[0].to_int(), floor[1].to_int(), floor[2].to_int()];
    (cell, place)
}
