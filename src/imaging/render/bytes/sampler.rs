//! Samples the volume of 7 + 1 bits: the nearest voxel, or interpolation between eight voxels in fixed point.

use glam::Vec3;

use crate::render::regression::{Block, Fit, Regression};
use crate::render::sampler::{Sampler, VoxelSampler, nearest, regression, split};
use crate::space::PreparedVolume;

use super::{ByteVolume, CODE, EMPTY, FLAG, OPAQUE, unit};

/// Turns codes into HU: `value = scale · code + offset`.
#[derive(Clone, Copy)]
struct Decode {
    scale: f32,
    offset: f32,
}

impl Decode {
    fn new(bytes: &ByteVolume) -> Self {
        let scale = unit(bytes.wall);
        Self { scale, offset: bytes.wall.lo() - scale * f32::from(EMPTY) }
    }

    fn fit(self, fit: Fit) -> Fit {
        Fit { gradient: fit.gradient * self.scale, density: fit.density * self.scale + self.offset }
    }
}

/// High detail: trilinear values, in fixed point, and interpolated regressions.
pub struct ByteTrilinear<'a> {
    bytes: &'a ByteVolume,
    decode: Decode,
    lo: f32,
    regression: Regression,
}

/// Low detail: everything is taken from the nearest voxel.
pub struct ByteNearest<'a> {
    bytes: &'a ByteVolume,
    decode: Decode,
    regression: Regression,
}

impl<'a> ByteTrilinear<'a> {
    /// Creates a sampler of `bytes`, which must be made from `volume`.
    pub fn new(volume: &PreparedVolume, bytes: &'a ByteVolume) -> Self {
        Self { bytes, decode: Decode::new(bytes), lo: bytes.wall.lo(), regression: regression(volume) }
    }

    /// Returns the value computed in floating point, for comparison, HU.
    pub fn value_in_floats(&self, q: Vec3) -> f32 {
        let (cell, t) = split(q);
        let c = corners(self.bytes, cell).map(f32::from);
        let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let (near, far) = (
            mix(mix(c[0], c[1], t.x), mix(c[2], c[3], t.x), t.y),
            mix(mix(c[4], c[5], t.x), mix(c[6], c[7], t.x), t.y),
        );
        mix(near, far, t.z) * self.decode.scale + self.decode.offset
    }
}

impl<'a> ByteNearest<'a> {
    /// Creates a sampler of `bytes`, which must be made from `volume`.
    pub fn new(volume: &PreparedVolume, bytes: &'a ByteVolume) -> Self {
        Self { bytes, decode: Decode::new(bytes), regression: regression(volume) }
    }
}

/// Returns the codes at the corners of a cell counted from cell −1: x fastest, then y, then z.
#[inline(always)]
fn corners(bytes: &ByteVolume, cell: [i32; 3]) -> [u8; 8] {
    bytes.voxels().corners(cell).map(|v| v & CODE)
}

/// Returns the codes of 4×4×4 voxels from `first` on, counted from voxel −1.
#[inline(always)]
fn block(bytes: &ByteVolume, first: [i32; 3]) -> Block {
    bytes.voxels().block(first, |v| f32::from(v & CODE))
}

/// True if the voxel nearest to `q` is opaque and flagged as homogeneous.
#[inline(always)]
fn is_within_tissue(bytes: &ByteVolume, q: Vec3) -> bool {
    bytes.get(nearest(q)) >= FLAG | OPAQUE
}

/// Fixed-point bits of a position within a cell. With seven bits of value the sum of three products fits 31 bits.
const PLACE_BITS: i32 = 8;

impl Sampler for ByteTrilinear<'_> {
    #[inline(always)]
    fn value(&self, q: Vec3) -> f32 {
        let (cell, t) = split(q);
        let [x, y, z] = (t * (1 << PLACE_BITS) as f32 + 0.5).to_array().map(|t| t as i32);
        let c = corners(self.bytes, cell).map(i32::from);
        let mix = |a: i32, b: i32, t: i32| (a << PLACE_BITS) + (b - a) * t;
        let near = mix(mix(c[0], c[1], x), mix(c[2], c[3], x), y);
        let far = mix(mix(c[4], c[5], x), mix(c[6], c[7], x), y);
        // Counted from the ramp's foot, so that empty values stay exactly empty.
        let above = mix(near, far, z) - (i32::from(EMPTY) << (3 * PLACE_BITS));
        above as f32 * (self.decode.scale / (1 << (3 * PLACE_BITS)) as f32) + self.lo
    }

    // A separate function: inside the loop of a ray, the optimiser gives up on it.
    #[inline(never)]
    fn fit(&self, q: Vec3) -> Fit {
        let (cell, t) = split(q);
        self.decode.fit(self.regression.fit(&block(self.bytes, cell.map(|c| c - 1)), t))
    }

    #[inline(always)]
    fn is_within_tissue(&self, q: Vec3) -> bool {
        is_within_tissue(self.bytes, q)
    }
}

impl VoxelSampler for ByteTrilinear<'_> {
    const INTERPOLATES: bool = true;

    #[inline(never)]
    fn fit_at(&self, v: [i32; 3]) -> Fit {
        self.decode.fit(self.regression.fit(&block(self.bytes, v.map(|c| c - 1)), Vec3::ZERO))
    }

    fn densities(&self) -> [f32; 2] {
        [0, CODE].map(|code| f32::from(code) * self.decode.scale + self.decode.offset)
    }
}

impl Sampler for ByteNearest<'_> {
    #[inline(always)]
    fn value(&self, q: Vec3) -> f32 {
        f32::from(self.bytes.get(nearest(q)) & CODE) * self.decode.scale + self.decode.offset
    }

    // A separate function: inside the loop of a ray, the optimiser gives up on it.
    #[inline(never)]
    fn fit(&self, q: Vec3) -> Fit {
        self.decode.fit(self.regression.fit(&block(self.bytes, nearest(q).map(|c| c - 1)), Vec3::ZERO))
    }

    #[inline(always)]
    fn is_within_tissue(&self, q: Vec3) -> bool {
        is_within_tissue(self.bytes, q)
    }
}

impl VoxelSampler for ByteNearest<'_> {
    const INTERPOLATES: bool = false;

    #[inline(never)]
    fn fit_at(&self, v: [i32; 3]) -> Fit {
        self.decode.fit(self.regression.fit(&block(self.bytes, v.map(|c| c - 1)), Vec3::ZERO))
    }

    fn densities(&self) -> [f32; 2] {
        [0, CODE].map(|code| f32::from(code) * self.decode.scale + self.decode.offset)
    }
}
