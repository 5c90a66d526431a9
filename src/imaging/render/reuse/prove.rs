//! Finds how far the pyramid of a pixel is empty, along its ray.
//!
//! At t mm from the camera every ray of a pixel is within t · spread of its central ray. If a point on the central ray has more
//! empty surroundings ([`EmptyRadius`]) than this, the pyramid is empty along the ray before and behind the point, for a length
//! equal to the surplus. The ray is walked from one such point to the next (sphere tracing, Hart 1996, of a cone: Amanatides 1984).

use super::known::BEYOND;
use crate::render::View;
use crate::render::leap::{EmptyRadius, SLACK};
use crate::render::march::Ray;
use crate::space::PreparedVolume;

/// The least that a step must gain, voxels.
const GAIN: f32 = 0.1;

/// The parameters of a walk along a pyramid, besides the ray.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pyramid {
    /// Distance in mm that moves a position by at most one voxel along every axis.
    pub mm_per_voxel: f32,
    /// A sample depends on voxels nearer than this, voxels.
    pub reach: f32,
    /// Half the pixel's diagonal at distance 1, or all of it if rays do not pass through the pixel's middle.
    pub spread: f32,
}

impl Pyramid {
    /// Prepares walks for pixels of `view` with `samples_per_pixel` rays each; `None` unless the camera is perspective.
    ///
    /// Samples depend on `reach` voxels of `volume`.
    pub(crate) fn new(volume: &PreparedVolume, view: &View, samples_per_pixel: u32, reach: f32) -> Option<Self> {
        let across = if samples_per_pixel > 1 { 2f64.sqrt() } else { 0.5f64.sqrt() };
        let spread = (view.pixel()? * (across + 3.0 * BEYOND)) as f32;
        Some(Self { mm_per_voxel: mm_per_voxel(volume) as f32, reach, spread })
    }

    /// Returns how far the pyramid around `ray` is empty, mm, up to the ray's end at most.
    ///
    /// `cos` is the cosine of the angle between the ray and the view. The pyramid must be empty up to `from` mm.
    #[inline(always)]
    pub(crate) fn empty_mm<C: EmptyRadius>(&self, clear: &C, ray: &Ray, cos: f32, from: f32) -> f32 {
        let end = ray.mm(ray.count);
        // Directions are the plane's points at distance 1, scaled to unit length: at least as near to each other.
        let spread = self.spread / (1.0 / cos - self.spread).max(1.0);
        let at = |mm: f32| (clear.around(ray.at_mm(mm)) - self.reach - SLACK) * self.mm_per_voxel;
        let room = |free: f32, mm: f32| (free - spread * mm) / (1.0 + spread);
        let least = GAIN * self.mm_per_voxel;
        let mut front = from;
        while front < end {
            // The distance that half a voxel of clearance would cover backwards.
            let step = room((0.5 - SLACK) * self.mm_per_voxel, front).max(0.0);
            let ahead = front + step;
            let free = at(ahead);
            let reached = if step >= least && free >= step + spread * ahead {
                ahead + room(free, ahead)
            } else {
                front + room(at(front), front)
            };
            // Also ends the walk where rounding would bring it to a standstill.
            if reached < front + least || reached <= front {
                break;
            }
            front = reached;
        }
        front.min(end.max(from))
    }
}

/// Returns the distance in mm that moves a position by at most one voxel along every axis.
pub(crate) fn mm_per_voxel(volume: &PreparedVolume) -> f64 {
    let m = volume.voxels().grid().to_voxel().matrix3.transpose();
    let fastest = m.x_axis.length().max(m.y_axis.length()).max(m.z_axis.length());
    // Rounded down by more than the error of f32.
    (1.0 - 1e-6) / fastest
}
