//! Sixteen places at once.

use glam::DAffine3;

use crate::render::Sixteen;

/// Returns the coordinates of one of sixteen.
#[inline(always)]
pub(super) fn nth<T: Copy>(all: &[[T; 16]; 3], k: usize) -> [T; 3] {
    [all[0][k], all[1][k], all[2][k]]
}

/// Returns places, moved by so much along their normals, in voxels.
#[inline(always)]
pub(super) fn moved(to_voxel: &DAffine3, places: &Sixteen, normals: &[[f32; 3]; 16], by: f64) -> Sixteen {
    let (m, from) = (to_voxel.matrix3.to_cols_array_2d(), to_voxel.translation.to_array());
    let mut out = [[0.0; 16]; 3];
    for k in 0..16 {
        let along = |a: usize| places[a][k] + by * f64::from(normals[k][a]);
        let [x, y, z] = [along(0), along(1), along(2)];
        for (a, out) in out.iter_mut().enumerate() {
            out[k] = m[0][a] * x + m[1][a] * y + m[2][a] * z + from[a];
        }
    }
    out
}
