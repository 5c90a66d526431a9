//! Leaping by the flag of the 7 + 1-bit volume: "a very fast check of the homogenous region flag quickly reveals that
//! we are sampling in an empty region, and the ray may be incremented" (the paper's section 2.2).

use glam::Vec3;

use crate::render::leap::EmptyRadius;
use crate::render::march::Ray;
use crate::render::sampler::nearest;
use crate::render::skip::Skipper;

use super::{ByteVolume, EMPTY, FLAG};

impl ByteVolume {
    /// True if the voxel nearest to `q`, and all within the flags' reach of it, are empty. Reads one byte.
    #[inline(always)]
    fn is_empty(&self, q: Vec3) -> bool {
        (FLAG..=FLAG | EMPTY).contains(&self.get(nearest(q)))
    }
}

/// Leaps over voxels that are flagged and empty. The flags must reach as far as the samples' classifier.
#[doc(hidden)]
pub struct ByteLeap<'a> {
    bytes: &'a ByteVolume,
}

impl<'a> ByteLeap<'a> {
    /// Leaps by the flags of `bytes`.
    #[doc(hidden)]
    pub fn new(bytes: &'a ByteVolume) -> Self {
        Self { bytes }
    }
}

impl Skipper for ByteLeap<'_> {
    type Walk = ();

    fn start(&self, _: &Ray, _: u32) {}

    #[inline(always)]
    fn next(&self, (): &mut (), ray: &Ray, mut n: u32) -> u32 {
        // The position is within half a voxel of the flagged voxel, and so are samples less than half a voxel further on.
        while n < ray.count && self.bytes.is_empty(ray.at(n)) {
            n += ray.near;
        }
        n
    }
}

/// The clearance known from the flags.
#[doc(hidden)]
pub struct ByteSurroundings<'a> {
    /// The volume with its flags.
    pub bytes: &'a ByteVolume,
}

impl EmptyRadius for ByteSurroundings<'_> {
    #[inline(always)]
    fn around(&self, q: Vec3) -> f32 {
        if self.bytes.is_empty(q) { self.bytes.reach as f32 + 0.5 } else { 0.0 }
    }
}
