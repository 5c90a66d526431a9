//! The lumen, gas and tagged fluid together, and the position of its wall between voxels.

use super::grow::grow;
use super::runs::Rows;
use super::{GAS_HU, GROWTH, Lumen};
use crate::error::{Error, Result};
use crate::fields::voxels::VoxelSet;
use crate::progress::Progress;
use crate::volume::{Grid, Volume};

/// Brightness of the wall itself, HU. Fluid ends half-way between this and its own brightness.
const WALL_HU: f64 = 60.0;
/// Minimum brightness of fluid, HU, used if its own brightness cannot be measured.
const LEAST_TAG_HU: f64 = 240.0;
/// Offset of a voxel from its wall's value if its own value does not determine it, HU.
const UNTOLD_HU: f64 = 1.0;

/// The colon's interior as a set of voxels.
///
/// The wall of gas against tissue is at the middle of the opacity ramp. The wall of tagged fluid is half-way between
/// the values of tissue and fluid. Gas meets fluid inside: there is no wall between the two.
#[derive(Clone, Debug)]
pub struct Interior<'a> {
    grid: &'a Grid,
    /// `None` for a mask.
    values: Option<Values<'a>>,
    set: VoxelSet,
}

#[derive(Clone, Debug)]
struct Values<'a> {
    volume: &'a Volume,
    iso: f64,
    /// Fluid that is not gas, and the value of its wall, HU, by label.
    fluid: Rows,
    fluid_iso: Vec<f64>,
}

impl<'a> Interior<'a> {
    /// Creates the interior of a lumen found in `volume`, with the gas wall at `iso` HU. At a value other than
    /// [`GAS_HU`] the gas loses its outermost voxels or grows by a few.
    ///
    /// # Errors
    /// Returns status 4 when interrupted, status 3 if there are more voxels than can be numbered.
    pub fn of_lumen(volume: &'a Volume, lumen: &Lumen, iso: f64, progress: &Progress) -> Result<Self> {
        let level = iso.floor().clamp(-32768.0, 32767.0) as i16;
        let grown = (level > GAS_HU).then(|| grow(volume, lumen.gas.clone(), level, GROWTH, progress)).transpose()?;
        let gas = grown.as_ref().unwrap_or(&lumen.gas);
        let grid = volume.grid();
        let row_of = |j: usize, k: usize| &volume.data()[grid.index(0, j, k)..][..grid.dims()[0]];
        let dark = gas.iter().flat_map(|(j, k, r)| {
            let values = row_of(j, k);
            let mut next = r.start as usize;
            let end = r.end as usize;
            std::iter::from_fn(move || {
                let start = (next..end).find(|&i| values[i] <= level)?;
                let stop = (start..end).find(|&i| values[i] > level).unwrap_or(end);
                next = stop;
                Some((j, k, start..stop))
            })
        });
        let fluid = lumen.fluid.iter().map(|(j, k, r)| (j, k, r.range()));
        let set = VoxelSet::from_runs(grid.dims(), dark.chain(fluid)).ok_or_else(too_many)?;
        let fluid_iso = tags(volume, &lumen.fluid).into_iter().map(|tag| 0.5 * (tag + WALL_HU)).collect();
        let values = Values { volume, iso, fluid: lumen.fluid.clone(), fluid_iso };
        Ok(Self { grid, values: Some(values), set })
    }

    /// Creates the interior of a mask: every nonzero voxel.
    ///
    /// # Errors
    /// Returns status 3 if there are more voxels than can be numbered.
    pub fn of_mask(mask: &'a Volume) -> Result<Self> {
        let set = VoxelSet::from_fn(mask.grid().dims(), |n| mask.data()[n] != 0).ok_or_else(too_many)?;
        Ok(Self { grid: mask.grid(), values: None, set })
    }

    /// Returns the voxels inside.
    pub fn set(&self) -> &VoxelSet {
        &self.set
    }

    /// Returns the grid.
    pub fn grid(&self) -> &Grid {
        self.grid
    }

    /// Returns how far a voxel is inside the wall, HU (unitless for a mask): positive inside, negative outside.
    pub fn above(&self, voxel: [i64; 3]) -> f64 {
        let inside = self.set.contains(voxel);
        let Some(values) = &self.values else {
            // Voxels of a mask that meet only in an edge are not joined, just as in a flight.
            return if inside { UNTOLD_HU } else { -2.0 * UNTOLD_HU };
        };
        let own = values.above(voxel);
        if inside { own.max(UNTOLD_HU) } else { own.min(-UNTOLD_HU) }
    }

    /// Returns the position of the wall between an inside voxel and its outside neighbour, as a fraction of the
    /// distance; `None` if the values do not determine it.
    pub fn crossing(&self, inside: [i64; 3], outside: [i64; 3]) -> Option<f64> {
        let values = self.values.as_ref()?;
        let iso = values.iso_of(inside);
        let [a, b] = [inside, outside].map(|v| f64::from(values.volume.get(v[0], v[1], v[2])));
        // Tissue is darker than fluid and brighter than gas. A neighbour on the same side is excluded for another reason.
        let parted = if values.is_fluid(inside) { a > iso && b <= iso } else { a <= iso && b > iso };
        parted.then(|| (iso - a) / (b - a))
    }
}

impl Values<'_> {
    fn is_fluid(&self, [i, j, k]: [i64; 3]) -> bool {
        self.fluid.find(i, j, k).is_some()
    }

    /// Returns the value of the wall beside a voxel, HU.
    fn iso_of(&self, [i, j, k]: [i64; 3]) -> f64 {
        self.fluid.find(i, j, k).map_or(self.iso, |r| self.fluid_iso[r.label as usize])
    }

    fn above(&self, voxel: [i64; 3]) -> f64 {
        let hu = f64::from(self.volume.get(voxel[0], voxel[1], voxel[2]));
        if self.is_fluid(voxel) { hu - self.iso_of(voxel) } else { self.iso - hu }
    }
}

/// Returns the brightness of the fluid of each label, HU: its median.
fn tags(volume: &Volume, fluid: &Rows) -> Vec<f64> {
    let labels = fluid.runs().iter().map(|r| r.label as usize + 1).max().unwrap_or(0);
    let mut counts = vec![Vec::new(); labels];
    for (j, k, r) in fluid.iter() {
        let own: &mut Vec<u32> = &mut counts[r.label as usize];
        own.resize(1 << 16, 0);
        let first = volume.grid().index(0, j, k);
        for &v in &volume.data()[first + r.start as usize..first + r.end as usize] {
            own[(i32::from(v) + 32768) as usize] += 1;
        }
    }
    let median = |counts: Vec<u32>| {
        let half = counts.iter().map(|&n| u64::from(n)).sum::<u64>() / 2;
        let mut seen = 0;
        let at = counts.iter().position(|&n| {
            seen += u64::from(n);
            seen > half
        });
        at.map_or(LEAST_TAG_HU, |at| (at as f64 - 32768.0).max(LEAST_TAG_HU))
    };
    counts.into_iter().map(median).collect()
}

fn too_many() -> Error {
    Error::input("volume", "holds more lumen than can be numbered", "crop or resample it")
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::super::runs::Run;
    use super::*;

    /// Four voxels of gas, four of fluid and two of tissue in a row.
    #[test]
    fn the_wall_of_fluid_is_half_way_between_fluid_and_tissue() {
        for tag in [400i16, 900] {
            let grid = Grid::new([10, 1, 1], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
            let data = [[-1000; 4], [tag; 4]].concat().into_iter().chain([60; 2]).collect();
            let volume = Volume::new(grid.clone(), data);
            let rows = |start: u32, end: u32| {
                let run = Run { start, end, label: 0 };
                Rows::from_slices(grid.dims(), vec![(vec![1], vec![run])]).unwrap()
            };
            let (gas, fluid) = (rows(0, 4), rows(4, 8));
            let lumen = Lumen::of_rows(&grid, gas, fluid);
            let interior = Interior::of_lumen(&volume, &lumen, -650.0, &Progress::new()).unwrap();
            assert_eq!(interior.set().len(), 8);
            assert_eq!(interior.crossing([7, 0, 0], [8, 0, 0]), Some(0.5), "{tag} HU");
            assert_eq!(interior.above([7, 0, 0]), 0.5 * (f64::from(tag) - 60.0));
            assert_eq!(interior.above([2, 0, 0]), 350.0);
        }
    }
}
