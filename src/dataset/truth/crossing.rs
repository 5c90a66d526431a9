//! Where the rays of a view cross the wall.

use glam::DVec3;
use rayon::prelude::*;

use crate::error::Result;
use crate::progress::Progress;
use crate::render::leap::Crossings;
use crate::render::{self, View};
use crate::space::PreparedVolume;
use crate::space::ray::trilinear;

/// Side of the squares of pixels that are looked at together.
pub(super) const SIDE: usize = 8;

/// Where a ray first crosses the wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Distance from the camera, mm.
    pub mm: f64,
    /// World, mm.
    pub place: DVec3,
    /// The scan's place of the tissue there, world, mm: the same unless the scan is deformed.
    pub tissue: DVec3,
    /// The wall's normal there, world, of unit length, towards the gas: against the gradient of the interpolated value.
    pub normal: DVec3,
    /// The same of the values around it, so that it does not change abruptly from voxel to voxel as `normal` does: from the differences
    /// over two voxels, as pictures are shaded. It never points away from the ray's origin.
    pub smooth: DVec3,
}

impl Crossing {
    /// Returns cos/r² of a lamp at `eye` (world, mm), 1/mm², with the smooth normal.
    pub fn headlight(&self, eye: DVec3) -> f64 {
        let to = eye - self.place;
        (to.dot(self.smooth) / to.length()).max(0.0) / to.length_squared()
    }
}

/// Returns where each pixel's ray crosses the wall, row by row: nowhere if the camera is in the wall.
///
/// # Errors
/// Returns status 4 if interrupted.
pub(super) fn crossings(
    volume: &PreparedVolume,
    rays: &Crossings,
    view: &View,
    tissue: Option<&(dyn Fn(DVec3) -> DVec3 + Sync)>,
    progress: &Progress,
) -> Result<Vec<Option<Crossing>>> {
    let width = view.width();
    let mut out = vec![None; width * view.height()];
    let eye = rays.from(view.position());
    let cross = |x: usize, y: usize| {
        let ray = view.ray(x, y)?;
        let is_eye = ray.origin == view.position();
        let mm = if is_eye { eye.first(ray.direction) } else { rays.first(ray.origin, ray.direction) }?;
        let normal = render::normal_at(volume, ray, mm)?;
        let place = ray.origin + ray.direction * mm;
        let smooth = smooth(volume, place).filter(|n| n.dot(ray.direction) < 0.0).unwrap_or(normal);
        let tissue = tissue.map_or(place, |of| of(place));
        Some(Crossing { mm, place, tissue, normal, smooth })
    };
    out.par_chunks_mut(SIDE * width).enumerate().try_for_each(|(band, out)| {
        progress.check()?;
        // Neighbouring rays visit the same voxels while they are in the cache.
        for left in (0..width).step_by(SIDE) {
            for y in 0..out.len() / width {
                for x in left..(left + SIDE).min(width) {
                    out[y * width + x] = cross(x, band * SIDE + y);
                }
            }
        }
        Ok(())
    })?;
    Ok(out)
}

/// Returns the unit normal towards the gas by central differences over two voxels of the interpolated value.
fn smooth(volume: &PreparedVolume, place: DVec3) -> Option<DVec3> {
    let grid = volume.voxels().grid();
    let at = grid.voxel(place);
    let value = |by: DVec3| trilinear(volume.voxels(), at + by);
    let difference = |axis: DVec3| 0.5 * (value(axis) - value(-axis));
    let gradient = DVec3::new(difference(DVec3::X), difference(DVec3::Y), difference(DVec3::Z));
    (-(grid.to_voxel().matrix3.transpose() * gradient)).try_normalize()
}
