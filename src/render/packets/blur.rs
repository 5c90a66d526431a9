//! How thick the wall is in the scan: what depends on it need not be finer.

use std::array::from_fn;

use rayon::prelude::*;

use crate::render::transfer::TransferFunction;
use crate::volume::Volume;

/// The wall's rise from air to tissue, HU.
const RISE: f32 = 1000.0;
/// Every so many rows of a slice tell of the blur, and by how many they lie further up in the next slice: so that all rows'
/// places and all slices are among them.
const ROWS: [usize; 2] = [64, 27];
/// Voxels of blur up to which waves are taken to be as short as the grid can hold: as many as the phantom has at 0.7 mm; a CT has
/// fewer.
const SHARP: f32 = 2.1;
/// The longest waves that are counted on.
pub const LONGEST: f32 = 2.0;
/// HU that differences of neighbouring voxels are counted by, and how many such classes there are.
const CLASS: [usize; 2] = [4, 512];

/// How long the finest waves are that the scan holds, twice the smallest spacing: 1 where the wall is as sharp as voxels can show.
pub fn waves(volume: &Volume, wall: TransferFunction) -> f32 {
    (blur(volume, wall) / SHARP).clamp(1.0, LONGEST)
}

/// How thick the wall is where it is sharp, voxels of the smallest spacing: so many share the rise from air to tissue where nine
/// tenths of the neighbouring voxels on both sides of the wall differ by less. The number is the scanner's, the kernel's and the
/// grid's; noise makes it smaller. 0 where there is no wall.
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

    /// A wall about the height 40 mm along `way`, which rises from air to tissue within `thick` mm.
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
        /// It is the thickness by the smallest spacing where the wall is met along an axis, whichever.
        #[test]
        fn it_is_the_walls_thickness(axis in 0..3usize, thick in 2.0..12.0, across in 0.5..2.0, tilt in 0.0..0.1) {
            let mut spacing = DVec3::ONE;
            spacing[axis] = across;
            let direction = (DVec3::AXES[axis] + DVec3::splat(tilt)).normalize();
            let volume = sloping([100, 100, 100], spacing, direction, thick);
            let expected = thick / spacing.min_element();
            let found = f64::from(blur(&volume, TransferFunction::default()));
            // Values next to the wall's ends are cut off where it takes few voxels.
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
