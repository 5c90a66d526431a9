//! The thickness of the wall in the scan. Whatever depends on it need not be finer.

use std::array::from_fn;

use rayon::prelude::*;

use crate::space::TransferFunction;
use crate::volume::Volume;

/// The wall's rise from air to tissue, HU.
const RISE: f32 = 1000.0;
/// Every 64th row of a slice is measured. In the next slice the rows start 27 higher, so that the samples cover all row
/// positions and all slices.
const ROWS: [usize; 2] = [64, 27];
/// Blur, in voxels, up to which waves are taken to be as short as the grid can hold. The phantom has this much at 0.7
/// mm; a CT has less.
const SHARP: f32 = 2.1;
/// The longest waves that are made use of, in the unit of [`waves`].
pub(crate) const LONGEST: f32 = 2.0;
/// The width of a class of differences between neighbouring voxels, HU, and the number of classes.
const CLASS: [usize; 2] = [4, 512];

/// Returns the length of the finest waves in the scan, in units of twice the smallest spacing.
///
/// 1 means that the wall is as sharp as voxels can show.
pub(crate) fn waves(volume: &Volume, wall: TransferFunction) -> f32 {
    (blur(volume, wall) / SHARP).clamp(1.0, LONGEST)
}

/// Returns the thickness of the wall where it is sharp, in voxels of the smallest spacing; 0 if there is no wall.
///
/// This many voxels share the rise from air to tissue if nine tenths of the neighbouring voxels on both sides of the
/// wall differ by less. The number depends on the scanner, the kernel and the grid. Noise makes it smaller.
fn blur(volume: &Volume, wall: TransferFunction) -> f32 {
    let grid = volume.grid();
    let [nx, ny, nz] = grid.dims();
    let iso = wall.iso() as i16;
    let share = grid.spacing().to_array().map(|s| (grid.min_spacing() / s) as f32);
    let count = |mut counts: [u64; CLASS[1]], z: usize| {
        for y in (z * ROWS[1] % ROWS[0]..ny).step_by(ROWS[0]) {
            let row = |y, z| &volume.data()[grid.index(0, y, z)..][..nx];
            let here = row(y, z);
            let next = [Some(&here[1..]), (y + 1 < ny).then(|| row(y + 1, z)), (z + 1 < nz).then(|| row(y, z + 1))];
            for (next, share) in next.into_iter().zip(share) {
                for (&a, &b) in here.iter().zip(next.unwrap_or(&[])) {
                    if (a > iso) != (b > iso) {
                        let rise = f32::from(a.abs_diff(b)) * share;
                        counts[(rise as usize / CLASS[0]).min(CLASS[1] - 1)] += 1;
                    }
                }
            }
        }
        counts
    };
    let none = || [0; CLASS[1]];
    let counts = (0..nz).into_par_iter().fold(none, count).reduce(none, |a, b| from_fn(|n| a[n] + b[n]));
    let most = counts.iter().sum::<u64>() * 9 / 10;
    let mut below = 0;
    let class = counts.iter().position(|c| {
        below += c;
        below > most
    });
    class.map_or(0.0, |n| RISE / ((n as f32 + 0.5) * CLASS[0] as f32))
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};
    use proptest::prelude::*;

    use super::*;
    use crate::volume::Grid;

    /// A wall at a height of 40 mm along `direction`, which rises from air to tissue within `thick` mm.
    fn sloping(dims: [usize; 3], spacing: DVec3, direction: DVec3, thick: f64) -> Volume {
        let grid = Grid::new(dims, spacing, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let value = |n: usize| {
            let voxel = [n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1]].map(|c| c as f64);
            let height = (DVec3::from_array(voxel) * spacing).dot(direction) - 40.0;
            (-650.0 + f64::from(RISE) * height / thick).clamp(-1000.0, 0.0).round() as i16
        };
        let data = (0..grid.len()).map(value).collect();
        Volume::new(grid, data)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        /// The blur is the thickness divided by the smallest spacing, whichever axis meets the wall.
        #[test]
        fn it_is_the_walls_thickness(axis in 0..3usize, thick in 2.0..12.0, across in 0.5..2.0, tilt in 0.0..0.1) {
            let mut spacing = DVec3::ONE;
            spacing[axis] = across;
            let direction = (DVec3::AXES[axis] + DVec3::splat(tilt)).normalize();
            let volume = sloping([100, 100, 100], spacing, direction, thick);
            let expected = thick / spacing.min_element();
            let found = f64::from(blur(&volume, TransferFunction::default()));
            // Values next to the wall's ends are cut off where the wall takes few voxels.
            prop_assume!(thick / across > 3.0);
            prop_assert!((found / expected - 1.0).abs() < 0.1, "{found} {expected}");
        }
    }

    #[test]
    fn nothing_and_extremes() {
        let grid = |dims| Grid::new(dims, DVec3::new(0.3, 0.3, 10.0), DVec3::ZERO, DMat3::IDENTITY).unwrap();
        for hu in [i16::MIN, -1000, 0, i16::MAX] {
            assert_eq!(blur(&Volume::new(grid([2, 2, 2]), vec![hu; 8]), TransferFunction::default()), 0.0);
        }
        let volume = Volume::new(grid([9, 1, 17]), (0..9 * 17).map(|n| [i16::MIN, i16::MAX][n % 2]).collect());
        let found = blur(&volume, TransferFunction::default());
        assert!(found > 0.0 && found < 0.5, "{found}");
    }
}
