//! Which samples of a ray need not be looked at.

use super::flags::{BRICK_SHIFT, Flags};
use super::march::Ray;
use super::sampler::nearest;
use super::space::Space;

/// Leaps over samples whose opacity is 0. It may only leave out such samples, so that the picture is the same bit for
/// bit with any skipper.
pub trait Skipper: Sync {
    /// The first sample from `n` on that may be seen; the ray's count or more where there is none.
    fn next(&self, ray: &Ray, n: u32) -> u32;
}

/// Leaves out nothing: brute force.
pub struct Everything;

impl Skipper for Everything {
    #[inline(always)]
    fn next(&self, _: &Ray, n: u32) -> u32 {
        n
    }
}

/// Leaps over empty bricks, and with `VOXELS` also over single voxels that are flagged as homogeneous and empty. The
/// latter only tells of 3×3×3 voxels, too few where a sample depends on the regressions of all eight voxels around it.
pub struct Leap<'a, const VOXELS: bool> {
    space: &'a Space,
    flags: &'a Flags,
    last: [u32; 3],
}

impl<'a, const VOXELS: bool> Leap<'a, VOXELS> {
    /// Leaps by the flags of `space`.
    pub fn new(space: &'a Space) -> Self {
        Self { space, flags: space.flags(), last: space.volume().grid().dims().map(|n| n as u32) }
    }

    #[inline(always)]
    fn is_empty_voxel(&self, q: glam::Vec3) -> bool {
        let volume = self.space.volume();
        let dims = volume.grid().dims();
        let [i, j, k] = nearest(q).map(|c| c.wrapping_sub(1) as usize);
        i < dims[0]
            && j < dims[1]
            && k < dims[2]
            && self.flags.homogeneous(i, j, k)
            && volume.data()[volume.grid().index(i, j, k)] <= self.flags.empty_up_to()
    }
}

impl<const VOXELS: bool> Skipper for Leap<'_, VOXELS> {
    #[inline(always)]
    fn next(&self, ray: &Ray, mut n: u32) -> u32 {
        while n < ray.count {
            let q = ray.at(n);
            let [x, y, z] = [q.x as u32, q.y as u32, q.z as u32];
            let brick = [x.min(self.last[0]), y.min(self.last[1]), z.min(self.last[2])].map(|c| c >> BRICK_SHIFT);
            if self.flags.empty_brick(brick[0] as usize, brick[1] as usize, brick[2] as usize) {
                n = leave(ray, brick, n);
            } else if VOXELS && self.is_empty_voxel(q) {
                n += 1;
            } else {
                break;
            }
        }
        n
    }
}

/// The first sample after `n` that may lie outside the brick. The rounding of distances is less than what is taken off;
/// that of places is covered by the empty voxels that lie around every empty brick.
#[inline(always)]
fn leave(ray: &Ray, brick: [u32; 3], n: u32) -> u32 {
    let mut exit = f32::INFINITY;
    for a in 0..3 {
        let ahead = u32::from(ray.along[a].is_sign_positive());
        let plane = ((brick[a] + ahead) << BRICK_SHIFT) as f32;
        // 0 · ∞ is no exit: `min` passes over the NaN.
        exit = exit.min((plane - ray.from[a]) * ray.inverse[a]);
    }
    ((exit * (1.0 - 1e-6) - 0.01) as u32).saturating_add(1).max(n + 1)
}
