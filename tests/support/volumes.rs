//! Small volumes.

use colvis::volume::{Grid, Volume};
use glam::{DMat3, DVec3};

/// Creates a volume whose values identify their position.
pub(crate) fn ramp(dims: [usize; 3], spacing: DVec3, origin: DVec3, direction: DMat3) -> Volume {
    let grid = Grid::new(dims, spacing, origin, direction).unwrap();
    let data = (0..grid.len()).map(|i| (i as i64 * 37 % 3000 - 1000) as i16).collect();
    Volume::new(grid, data)
}
