//! Where the rays of a view cross the wall.

use glam::DVec3;

use crate::error::Result;
use crate::progress::Progress;
use crate::render::{self, View};
use crate::space::PreparedVolume;

/// Side of the squares of pixels that are looked at together.
pub(super) const SIDE: usize = 8;

/// Where a ray first crosses the wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Distance from the camera, mm.
    pub mm: f64,
    /// World, mm.
    pub place: DVec3,
    /// The wall's normal there, world, of unit length, towards the gas: against the gradient of the interpolated value.
    pub normal: DVec3,
}

impl Crossing {
    /// Returns cos/r² of a lamp at `eye` (world, mm), 1/mm².
    pub fn headlight(&self, eye: DVec3) -> f64 {
        let to = eye - self.place;
        (to.dot(self.normal) / to.length()).max(0.0) / to.length_squared()
    }
}

/// Returns where each pixel's ray crosses the wall, row by row: nowhere if the camera is in the wall.
///
/// # Errors
/// Returns status 4 if interrupted.
pub(super) fn crossings(volume: &PreparedVolume, view: &View, progress: &Progress) -> Result<Vec<Option<Crossing>>> {
    let mut out = vec![None; view.width() * view.height()];
    render::crossings(volume, view, &mut out, progress, |hit| {
        let (ray, mm) = hit?;
        let normal = render::normal_at(volume, ray, mm)?;
        Some(Crossing { mm, place: ray.origin + ray.direction * mm, normal })
    })?;
    Ok(out)
}
