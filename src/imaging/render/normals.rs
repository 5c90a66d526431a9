//! The wall's exact normals.

use glam::DVec3;

use super::camera::{CameraRay, View};
use super::caster::crossings;
use crate::error::Result;
use crate::progress::Progress;
use crate::space::PreparedVolume;
use crate::volume::cell::Cell;

/// How far before a crossing the cell is looked up, voxels: a crossing on a face belongs to the cell that the ray comes from.
pub(super) const BEFORE: f64 = 1e-7;

/// Fills `normals` with the normal of the wall that every pixel of `view` shows, row by row: world, of unit length, towards the gas.
///
/// It is that of the surface whose distance [`depths`](super::depths) measures: the negative gradient of the trilinear cell at the point
/// where the ray crosses it, not of a smoothed volume. So no normal points away from its ray's origin. All three numbers are NaN where there
/// is no wall, and where the camera is in it. `normals` has as many entries as the view has pixels.
///
/// # Errors
/// Returns status 4 if cancelled.
pub fn normals(volume: &PreparedVolume, view: &View, normals: &mut [[f32; 3]], progress: &Progress) -> Result<()> {
    let normal = |(ray, t): (CameraRay, f64)| normal_at(volume, ray, t).map(|n| n.as_vec3().to_array());
    crossings(volume, view, normals, progress, |hit| hit.and_then(normal).unwrap_or([f32::NAN; 3]))
}

/// Returns the unit normal, towards the gas, where a ray crosses the wall `t` mm from its origin; `None` at its origin, and where the wall
/// has no normal.
#[doc(hidden)]
pub fn normal_at(volume: &PreparedVolume, ray: CameraRay, t: f64) -> Option<DVec3> {
    if t <= 0.0 {
        return None;
    }
    let grid = volume.voxels().grid();
    let along = grid.to_voxel().transform_vector3(ray.direction);
    let at = grid.voxel(ray.origin + ray.direction * t);
    let base = (at - along * (BEFORE / along.abs().max_element())).floor();
    let cell = Cell::load(volume.voxels(), base.to_array().map(|c| c as i64));
    let gradient = grid.to_voxel().matrix3.transpose() * cell.gradient(at - base);
    // A wall without a gradient, touched at a single point, has no normal.
    (-gradient).try_normalize()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{DMat3, DVec3, Vec3};

    use super::*;
    use crate::render::camera::Panorama;
    use crate::render::depths;
    use crate::space::TransferFunction;
    use crate::volume::{Grid, Volume};

    /// A hollow ball in a turned grid with three spacings.
    fn ball() -> (PreparedVolume, DVec3) {
        let turn = DMat3::from_rotation_z(0.4) * DMat3::from_rotation_x(-0.7);
        let grid = Grid::new([44, 40, 36], DVec3::new(0.7, 0.8, 1.1), DVec3::new(3.0, -20.0, 9.0), turn).unwrap();
        let centre = grid.world(DVec3::new(21.5, 19.5, 17.5));
        let value = |n: usize| {
            let p = grid.world(DVec3::new((n % 44) as f64, (n / 44 % 40) as f64, (n / 1760) as f64));
            (-650.0 + 150.0 * (p.distance(centre) - 11.0)).clamp(-1000.0, 100.0) as i16
        };
        let volume = Volume::new(grid.clone(), (0..grid.len()).map(value).collect());
        (PreparedVolume::new(Arc::new(volume), TransferFunction::default()), centre)
    }

    #[test]
    fn normals_point_to_the_middle_of_a_hollow_ball() {
        let (volume, centre) = ball();
        let from = centre + DVec3::new(2.0, -3.0, 1.0);
        let view = View::with_camera(from, DVec3::Y, DVec3::Z, Arc::new(Panorama), 96, 48).unwrap();
        let (mut found, mut depth) = (vec![[0.0; 3]; 96 * 48], vec![0.0; 96 * 48]);
        normals(&volume, &view, &mut found, &Progress::new()).unwrap();
        depths(&volume, &view, &mut depth, &Progress::new()).unwrap();
        for (n, found) in found.into_iter().enumerate() {
            let ray = view.ray(n % 96, n / 96).unwrap();
            let at = ray.origin + ray.direction * f64::from(depth[n]);
            let found = Vec3::from_array(found);
            assert!((found.length() - 1.0).abs() < 1e-6 && found.dot(ray.direction.as_vec3()) < 0.0, "{n}: {found}");
            let exact = ((centre - at) / 11.0).as_vec3();
            assert!(found.angle_between(exact) < 0.12, "{n}: {found} {exact}");
        }
    }

    #[test]
    fn where_there_is_no_wall_there_is_no_normal() {
        let (volume, centre) = ball();
        let look = |from: DVec3, toward| {
            let view = View::new(from, toward, DVec3::Z, 20.0, 3, 3).unwrap();
            let mut found = [[0.0; 3]; 9];
            normals(&volume, &view, &mut found, &Progress::new()).unwrap();
            found
        };
        let (out, inside) = (centre + DVec3::X * 500.0, centre + DVec3::X * 12.0);
        for found in [look(out, DVec3::X), look(inside, DVec3::X)] {
            assert!(found.iter().flatten().all(|n| n.is_nan()));
        }
        assert!(look(centre, DVec3::X).iter().flatten().all(|n| n.is_finite()));
    }
}
