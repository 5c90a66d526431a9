//! A ray of the image, as evenly spaced samples.
//!
//! Sample k of a ray lies at t = (k + ½)·Δs from the **camera**, wherever the volume begins and whatever is skipped, so
//! that skipping leaves every bit of the picture as it was. The ray is set up in f64, clipped to the volume grown by
//! one voxel of air, and walked in f32 from the first sample within.
//!
//! Places are *grown* voxel coordinates: voxel coordinates plus one, never negative within the clipped ray.

use glam::{DVec3, Vec3};

use super::ray::clip;
use super::space::Space;

/// The most samples that a ray may have; where h is so small against the volume that it would need more, steps grow.
const MAX_SAMPLES: f64 = (1 << 22) as f64;

/// The step length: Δs = h · 2^`power`, h the smallest spacing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// The power of two.
    pub power: i32,
    /// Δs, mm.
    pub mm: f64,
}

impl Step {
    /// The step of the wanted `power` in `space`, or the next longer one that keeps every ray's samples bounded.
    pub fn new(space: &Space, power: i32) -> Self {
        let grid = space.volume().grid();
        let dims = grid.dims().map(|n| (n + 1) as f64);
        let diagonal = (DVec3::from_array(dims) * grid.spacing()).length() * 2.0;
        let least = (diagonal / grid.min_spacing() / MAX_SAMPLES).log2().ceil() as i32;
        let power = power.max(least);
        Self { power, mm: grid.min_spacing() * f64::from(power).exp2() }
    }
}

/// A ray's samples within the grown volume.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Sample 0, grown voxel coordinates.
    pub from: Vec3,
    /// From one sample to the next, voxels.
    pub along: Vec3,
    /// 1 / `along`, infinite where that is 0.
    pub inverse: Vec3,
    /// World direction, of unit length.
    pub direction: Vec3,
    /// Number of samples.
    pub count: u32,
}

impl Ray {
    /// The samples of the ray from `origin` (world, mm) along `direction` (world, of unit length); `None` where it
    /// misses the volume.
    pub fn new(space: &Space, origin: DVec3, direction: DVec3, step: Step) -> Option<Self> {
        let grid = space.volume().grid();
        let from = grid.voxel(origin);
        let (enter, exit) = clip(grid.dims(), from, grid.to_voxel().transform_vector3(direction))?;
        let first = (enter / step.mm - 0.5).ceil().max(0.0);
        let count = (exit / step.mm - 0.5).floor() - first + 1.0;
        if count < 1.0 {
            return None;
        }
        let start = grid.voxel(origin + direction * ((first + 0.5) * step.mm)) + DVec3::ONE;
        let along = (grid.to_voxel().transform_vector3(direction) * step.mm).as_vec3();
        Some(Self {
            from: start.as_vec3(),
            along,
            inverse: along.recip().abs().copysign(along),
            direction: direction.as_vec3(),
            count: count.min(MAX_SAMPLES) as u32,
        })
    }

    /// Place of sample `n`, grown voxel coordinates.
    #[inline(always)]
    pub fn at(&self, n: u32) -> Vec3 {
        self.from + self.along * n as f32
    }
}
