//! How much matter surrounds a place: mean opacities over cells of a few millimetres, for shadows where walls are close.

use glam::Vec3;
use rayon::prelude::*;

use crate::volume::{Grid, Volume};

use super::transfer::TransferFunction;

/// The least side of the first level's cells, mm. Each further level's cells have twice the side.
const CELL_MM: f64 = 4.0;
/// Distance before a wall at which its surroundings are looked at, in cells. Nearer to the wall, what the wall itself adds would
/// depend on how it lies among the cells, which shows as a texture: a cell's mean, interpolated, is a quadratic B-spline only on
/// average, whose support ends at one and a half.
pub(crate) const AHEAD: f64 = 1.3;
/// Number of levels.
pub(crate) const LEVELS: usize = 2;
/// The number that stands for an opacity of 1.
pub(crate) const OPAQUE: f32 = 1000.0;

/// A volume's mean opacities over cells, in levels of growing cells. A trilinear value of a level is the share of opaque
/// matter in about two cells around a place.
///
/// It takes a hundredth of the voxels' memory at a spacing of 0.75 mm.
#[derive(Debug)]
pub(crate) struct Surround {
    levels: [Level; LEVELS],
}

/// A level.
#[derive(Debug)]
pub(crate) struct Level {
    /// Mean opacities times [`OPAQUE`].
    pub(crate) means: Volume,
    /// Transforms grown voxel coordinates (voxels plus one) of the volume to those of the level: `scale · q + offset`.
    pub(crate) scale: Vec3,
    pub(crate) offset: Vec3,
    /// [`AHEAD`] times the longest side of a cell, mm.
    pub(crate) ahead_mm: f32,
}

impl Surround {
    /// Computes the levels in one parallel pass over the voxels; `None` where a grid of cells cannot be made.
    pub(crate) fn new(volume: &Volume, transfer: TransferFunction) -> Option<Self> {
        let spacing = volume.grid().spacing().to_array();
        let sides = |level: u32| spacing.map(|s| (CELL_MM * f64::from(1 << level) / s).ceil().clamp(1.0, 1e6) as usize);
        let (lo, scale) = (transfer.lo(), 1.0 / (transfer.hi() - transfer.lo()));
        let opacity = |hu: i16| ((f32::from(hu) - lo) * scale).clamp(0.0, 1.0);
        let first = means(volume, sides(0), opacity)?;
        // Of the volume, not of the first level: a level's cells need not be a multiple of those before it.
        let second = means(volume, sides(1), opacity)?;
        Some(Self { levels: [first, second] })
    }

    /// Returns the levels, small cells first.
    pub(crate) fn levels(&self) -> &[Level; LEVELS] {
        &self.levels
    }

    /// Returns the memory, bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.levels.iter().map(|l| size_of_val(l.means.data())).sum()
    }
}

/// Returns the means over cells of `side` voxels. The last cells may be smaller.
fn means(volume: &Volume, side: [usize; 3], opacity: impl Fn(i16) -> f32 + Sync) -> Option<Level> {
    let (grid, data) = (volume.grid(), volume.data());
    let dims = grid.dims();
    // Two cells at least, so that there is something to interpolate between.
    let cells = [0, 1, 2].map(|a| dims[a].div_ceil(side[a]).max(2));
    let apart = glam::DVec3::from_array(side.map(|n| n as f64));
    let middle = grid.world((apart - 1.0) * 0.5);
    let coarse = Grid::new(cells, grid.spacing() * apart, middle, grid.direction()).ok()?;
    let mut all = vec![0i16; coarse.len()];
    let range = |a: usize, n: usize| {
        let first = (n * side[a]).min(dims[a] - 1);
        first..(first + side[a]).min(dims[a])
    };
    all.par_chunks_mut(cells[0] * cells[1]).enumerate().for_each(|(z, slice)| {
        let mut sums = vec![0.0f32; cells[0]];
        for (y, row) in slice.chunks_mut(cells[0]).enumerate() {
            sums.fill(0.0);
            let (ys, zs) = (range(1, y), range(2, z));
            let lines = ys.len() * zs.len();
            for line in zs.flat_map(|k| ys.clone().map(move |j| (j, k))) {
                let at = grid.index(0, line.0, line.1);
                for (sum, cell) in sums.iter_mut().zip(data[at..at + dims[0]].chunks(side[0])) {
                    *sum += cell.iter().map(|&hu| opacity(hu)).sum::<f32>();
                }
            }
            for (x, (mean, &sum)) in row.iter_mut().zip(&sums).enumerate() {
                *mean = (sum / (lines * range(0, x).len()) as f32 * OPAQUE).round() as i16;
            }
        }
    });
    let scale = Vec3::from_array(side.map(|n| 1.0 / n as f32));
    let offset = Vec3::ONE - scale * Vec3::from_array(side.map(|n| 0.5 * (n + 1) as f32));
    let ahead_mm = (AHEAD * coarse.spacing().max_element()) as f32;
    Some(Level { means: Volume::new(coarse, all), scale, offset, ahead_mm })
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;

    /// Cells of 4 mm and 8 mm hold the share of their voxels that is opaque, at the middle of these voxels, on grids of any
    /// spacing, and where the last cell is cut off.
    #[test]
    fn cells_hold_the_share_of_opaque_voxels() {
        for (dims, spacing) in
            [([17, 9, 8], DVec3::new(1.0, 1.5, 0.7)), ([2, 40, 3], DVec3::new(8.0, 0.4, 5.0)), ([1; 3], DVec3::ONE)]
        {
            let grid = Grid::new(dims, spacing, DVec3::new(3.0, -7.0, 100.0), DMat3::IDENTITY).unwrap();
            let data: Vec<i16> = (0..grid.len()).map(|n| if n % 7 < 3 { 200 } else { -1000 }).collect();
            let volume = Volume::new(grid.clone(), data.clone());
            let surround = Surround::new(&volume, TransferFunction::default()).unwrap();
            for (n, level) in surround.levels().iter().enumerate() {
                let side = spacing.to_array().map(|s| (CELL_MM * (n + 1) as f64 / s).ceil() as usize);
                let coarse = level.means.grid();
                let mut cells = std::collections::BTreeMap::<usize, (f32, f32)>::new();
                for (at, &hu) in data.iter().enumerate() {
                    let v = [at % dims[0], at / dims[0] % dims[1], at / dims[0] / dims[1]];
                    let c = [0, 1, 2].map(|a| v[a] / side[a]);
                    let cell = cells.entry(coarse.index(c[0], c[1], c[2])).or_default();
                    *cell = (cell.0 + f32::from(u8::from(hu > 0)), cell.1 + 1.0);
                }
                for (&c, &(opaque, all)) in &cells {
                    let found = f32::from(level.means.data()[c]) / OPAQUE;
                    assert!((found - opaque / all).abs() < 1e-3, "{dims:?}, level {n}, cell {c}: {found}");
                }
                // The first cell's middle, in both coordinates.
                let middle = grid.voxel(coarse.world(DVec3::ZERO)).as_vec3() + 1.0;
                assert!((level.scale * middle + level.offset).distance(Vec3::ONE) < 1e-4, "{dims:?}, level {n}");
            }
            assert!(surround.bytes() > 0);
        }
    }

    #[test]
    fn it_is_small() {
        let grid = Grid::new([96; 3], DVec3::splat(0.75), DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let volume = Volume::new(grid.clone(), vec![0; grid.len()]);
        let surround = Surround::new(&volume, TransferFunction::default()).unwrap();
        assert!(surround.bytes() * 100 < 2 * grid.len(), "{}", surround.bytes());
    }
}
