//! How far the pyramid of a pixel is empty, found along its ray.
//!
//! At t mm from the camera every ray of a pixel is within t · spread of the ray in its middle. Where a place of that ray
//! has more empty surroundings ([`EmptyRadius`]) than this, the pyramid is empty for as much of the ray, before and behind
//! the place, as is left over; so the ray is walked from one such place to the next (sphere tracing, Hart 1996, of a
//! cone: Amanatides 1984).

use super::known::BEYOND;
use crate::render::View;
use crate::render::leap::{EmptyRadius, SLACK};
use crate::render::march::Ray;
use crate::render::prepared_volume::PreparedVolume;

/// The least that a step must gain, voxels.
const GAIN: f32 = 0.1;

/// What a walk along a pyramid needs to know besides the ray.
#[derive(Clone, Copy, Debug)]
pub struct Pyramid {
    /// mm that move a place by at most one voxel along every axis.
    pub mm_per_voxel: f32,
    /// A sample depends on voxels nearer than so many voxels.
    pub reach: f32,
    /// Half the pixel's diagonal, or all of it where rays do not pass through its middle, at distance 1.
    pub spread: f32,
}

impl Pyramid {
    /// For pixels of `view` with `samples_per_pixel` rays each, and samples that depend on `reach` voxels of `space`; none
    /// where its camera is not a perspective one.
    pub fn new(volume: &PreparedVolume, view: &View, samples_per_pixel: u32, reach: f32) -> Option<Self> {
        let across = if samples_per_pixel > 1 { 2f64.sqrt() } else { 0.5f64.sqrt() };
        let spread = (view.pixel()? * (across + 3.0 * BEYOND)) as f32;
        Some(Self { mm_per_voxel: mm_per_voxel(volume) as f32, reach, spread })
    }

    /// How far the pyramid around `ray`, which makes the angle whose cosine is `cos` with the view, is empty, if it is
    /// so up to `from` mm. Not beyond the ray's end.
    #[inline(always)]
    pub fn empty_mm<C: EmptyRadius>(&self, clear: &C, ray: &Ray, cos: f32, from: f32) -> f32 {
        let end = ray.mm(ray.count);
        // Directions are the plane's points at distance 1, brought to unit length: at least as near to each other.
        let spread = self.spread / (1.0 / cos - self.spread).max(1.0);
        let at = |mm: f32| (clear.around(ray.at_mm(mm)) - self.reach - SLACK) * self.mm_per_voxel;
        let room = |free: f32, mm: f32| (free - spread * mm) / (1.0 + spread);
        let least = GAIN * self.mm_per_voxel;
        let mut front = from;
        while front < end {
            // What half a voxel of clearance would cover backwards.
            let step = room((0.5 - SLACK) * self.mm_per_voxel, front).max(0.0);
            let ahead = front + step;
            let free = at(ahead);
            let reached = if step >= least && free >= step + spread * ahead {
                ahead + room(free, ahead)
            } else {
                front + room(at(front), front)
            };
            // Also ends the walk where rounding would make it stand still.
            if reached < front + least || reached <= front {
                break;
            }
            front = reached;
        }
        front.min(end.max(from))
    }
}

/// mm that move a place by at most one voxel along every axis.
pub fn mm_per_voxel(volume: &PreparedVolume) -> f64 {
    let m = volume.voxels().grid().to_voxel().matrix3.transpose();
    let fastest = m.x_axis.length().max(m.y_axis.length()).max(m.z_axis.length());
    // Rounded down by more than f32 can be wrong.
    (1.0 - 1e-6) / fastest
}
