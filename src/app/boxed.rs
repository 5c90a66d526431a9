//! The part of a scan around its colon, with other values where it was cleansed.

use glam::DVec3;

use crate::fields::Lumen;
use crate::fields::cleanse::Changes;
use crate::volume::Volume;

/// How far beyond the lumen the box reaches, mm: farther than rays see into its wall, and slabs are thick.
const BEYOND_MM: f64 = 12.0;

/// Returns the part of the volume around the lumen and around all changes, with these.
#[doc(hidden)]
pub fn boxed(volume: &Volume, lumen: &Lumen, changes: &Changes) -> Volume {
    let grid = volume.grid();
    let [nx, ny, _] = grid.dims();
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let mut add = |voxel: DVec3| (low, high) = (low.min(voxel), high.max(voxel));
    for [a, b] in lumen.segments.iter().map(|s| s.bounds_mm) {
        // The corners of a box in the world may be any in the grid.
        (0..8).for_each(|n| add(grid.voxel(DVec3::select(glam::BVec3::new(n & 1 > 0, n & 2 > 0, n & 4 > 0), a, b))));
    }
    for (voxels, _) in changes.runs() {
        let row = voxels.start / nx;
        // A run may go on in the next row.
        let last = (voxels.end - 1) / nx;
        let ends = if row == last { [voxels.start % nx, (voxels.end - 1) % nx] } else { [0, nx - 1] };
        for (i, row) in ends.into_iter().zip([row, last]) {
            add(DVec3::new(i as f64, (row % ny) as f64, (row / ny) as f64));
        }
    }
    let beyond = BEYOND_MM / grid.spacing();
    let last = DVec3::from_array(grid.dims().map(|d| (d - 1) as f64));
    let [low, high] = [(low - beyond).floor(), (high + beyond).ceil()]
        .map(|v| v.clamp(DVec3::ZERO, last).to_array().map(|c| c as usize));
    changes.applied_to_box(volume, low, high)
}
