//! An image ray as evenly spaced samples.
//!
//! Sample k of a ray is at t = (k + ½)·Δs from the **camera**, regardless of where the volume begins and what is
//! skipped. Skipping therefore changes no bit of the picture. The ray is set up in f64, clipped to the volume grown by
//! one voxel of air, and walked in f32 from the first sample inside.
//!
//! Positions are *grown* voxel coordinates: voxel coordinates plus one, never negative within the clipped ray.

use glam::{DVec3, Vec3};

use crate::space::PreparedVolume;
use crate::space::ray::clip;

/// The maximum number of samples of a ray. If h is so small relative to the volume that a ray would need more, steps grow.
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
    /// Returns the step of the given `power` in `volume`, or the next longer one that keeps within the sample limit.
    pub fn new(volume: &PreparedVolume, power: i32) -> Self {
        let grid = volume.voxels().grid();
        let dims = grid.dims().map(|n| (n + 1) as f64);
        let diagonal = (DVec3::from_array(dims) * grid.spacing()).length() * 2.0;
        let least = (diagonal / grid.min_spacing() / MAX_SAMPLES).log2().ceil() as i32;
        let power = power.max(least);
        Self { power, mm: grid.min_spacing() * 2f64.powi(power) }
    }
}

/// A ray's samples within the grown volume.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Sample 0, grown voxel coordinates.
    pub from: Vec3,
    /// Offset from one sample to the next, voxels.
    pub along: Vec3,
    /// 1 / `along`, or 0 where the ray does not move. The ray meets the plane p of an axis after p · `inverse` + `offset` samples.
    pub inverse: Vec3,
    /// −`from` / `along`, or infinite where the ray does not move.
    pub offset: Vec3,
    /// World direction, unit length.
    pub direction: Vec3,
    /// Number of samples.
    pub count: u32,
    /// Distance of sample 0 from the camera, mm.
    pub start_mm: f32,
    /// Samples per mm.
    pub per_mm: f32,
    /// True if the camera is within the grown volume. Sample 0 is then the first one from the camera.
    pub inside: bool,
    /// The first sample offset at which a position may be half a voxel away along an axis. All smaller offsets are nearer.
    pub near: u32,
}

/// Rounds each coordinate, between 0 and 2²², to the nearest whole number, ties to even.
///
/// It uses the fact that the bits of a float near 2²³ count in ones. This is much cheaper than a cast, which must
/// handle values out of range.
#[inline(always)]
pub(crate) fn round(q: Vec3) -> [i32; 3] {
    const SHIFT: f32 = (1 << 23) as f32;
    (q + SHIFT).to_array().map(|c| (c.to_bits() & 0x7F_FFFF) as i32)
}

impl Ray {
    /// Returns the samples of the ray from `origin` (world, mm) along `direction` (world, unit length), or `None` if it
    /// misses the volume.
    pub fn new(volume: &PreparedVolume, origin: DVec3, direction: DVec3, step: Step) -> Option<Self> {
        let grid = volume.voxels().grid();
        let (enter, exit) = clip(grid.dims(), grid.voxel(origin), grid.to_voxel().transform_vector3(direction))?;
        let first = (enter / step.mm - 0.5).ceil().max(0.0);
        let count = (exit / step.mm - 0.5).floor() - first + 1.0;
        if count < 1.0 {
            return None;
        }
        let start = grid.voxel(origin + direction * ((first + 0.5) * step.mm)) + DVec3::ONE;
        let along = (grid.to_voxel().transform_vector3(direction) * step.mm).as_vec3();
        let from = start.as_vec3();
        // Less than this moves a sample by a hundredth of a voxel at the end of the longest ray.
        let moves = along.abs().cmpgt(Vec3::splat(1e-9));
        Some(Self {
            from,
            along,
            inverse: Vec3::select(moves, along.recip(), Vec3::ZERO),
            offset: Vec3::select(moves, -from / along, Vec3::INFINITY),
            direction: direction.as_vec3(),
            count: count.min(MAX_SAMPLES) as u32,
            start_mm: ((first + 0.5) * step.mm) as f32,
            per_mm: (1.0 / step.mm) as f32,
            inside: first == 0.0 && enter == 0.0,
            // A thousandth less than half a voxel, to allow for rounding.
            near: 1 + (0.499 / along.abs().max_element()).min(1e3) as u32,
        })
    }

    /// Returns the position of sample `n`, grown voxel coordinates.
    #[inline(always)]
    pub fn at(&self, n: u32) -> Vec3 {
        self.from + self.along * n as f32
    }

    /// Returns the position at `mm` from the camera, grown voxel coordinates.
    #[inline(always)]
    pub fn at_mm(&self, mm: f32) -> Vec3 {
        self.from + self.along * ((mm - self.start_mm) * self.per_mm)
    }

    /// Returns the distance of sample `n` from the camera, mm.
    #[inline(always)]
    pub fn mm(&self, n: u32) -> f32 {
        self.start_mm + n as f32 / self.per_mm
    }
}
