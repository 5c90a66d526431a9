//! The distance to the wall of a lumen.

use super::{SHELL, Through, WallDistance};
use crate::error::Result;
use crate::fields::Values;
use crate::fields::lumen::{GAS_HU, Lumen};
use crate::fields::voxels::VoxelBits;
use crate::progress::Progress;
use crate::volume::Volume;

impl WallDistance {
    /// Computes the distance to the wall of a lumen found in `volume`.
    ///
    /// # Errors
    /// Returns status 4 when interrupted, status 3 if there are more voxels than can be numbered.
    pub fn of_lumen(volume: &Volume, lumen: &Lumen, through: Through, progress: &Progress) -> Result<Self> {
        Self::of_values(&Values::of(volume), lumen, through, progress)
    }

    /// Same as [`WallDistance::of_lumen`], of a lumen found in a volume with these values.
    pub(in crate::fields) fn of_values(
        values: &Values<'_>,
        lumen: &Lumen,
        through: Through,
        progress: &Progress,
    ) -> Result<Self> {
        let fluid = (through == Through::GasAndFluid).then(|| lumen.fluid().iter());
        let runs = lumen.gas().iter().chain(fluid.into_iter().flatten()).map(|(j, k, r)| (j, k, r.range()));
        let inside = VoxelBits::from_runs(values.grid().dims(), runs);
        Self::build(values.grid(), &inside, Some((values, GAS_HU)), SHELL, progress)
    }

    /// Same as [`WallDistance::of_lumen`] for gas and fluid, plus distances outside (in the shell, negative) up to at
    /// least `reach_mm`.
    ///
    /// # Errors
    /// Same as [`WallDistance::of_lumen`].
    pub fn around_lumen(volume: &Volume, lumen: &Lumen, reach_mm: f64, progress: &Progress) -> Result<Self> {
        let runs = lumen.gas().iter().chain(lumen.fluid().iter()).map(|(j, k, r)| (j, k, r.range()));
        let inside = VoxelBits::from_runs(volume.grid().dims(), runs);
        let grid = volume.grid();
        // Maximum number of indices that a world distance spans.
        let inverse = grid.to_voxel().matrix3.transpose();
        let reach = [0, 1, 2].map(|a| (inverse.col(a).length() * reach_mm).ceil() as usize);
        let shell = reach.into_iter().max().unwrap_or(0) + SHELL;
        Self::build(grid, &inside, Some((&Values::of(volume), GAS_HU)), shell, progress)
    }
}
