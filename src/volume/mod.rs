//! A scan: Hounsfield units on a regular grid, and the grid's position in the patient.

pub(crate) mod cell;
mod grid;
pub mod io;

pub use grid::Grid;

/// Value of everything outside the volume or the scanner's field of view, HU.
pub const AIR_HU: i16 = -1024;

/// A CT volume: one `i16` HU per voxel, x fastest, then y, then z.
///
/// ```
/// use colvis::volume::{Grid, Volume};
/// use glam::{DMat3, DVec3};
///
/// let grid = Grid::new([2, 2, 2], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY)?;
/// let volume = Volume::new(grid, vec![-1000, -1000, -1000, -1000, 40, 40, 40, 40]); // HU, x fastest
/// assert_eq!((volume.get(0, 0, 0), volume.get(0, 0, 1)), (-1000, 40));
/// # Ok::<(), String>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Volume {
    grid: Grid,
    data: Vec<i16>,
}

impl Volume {
    /// Creates a volume of `data` (HU, x fastest) on `grid`.
    ///
    /// # Panics
    /// Panics if the number of values does not match the grid. Readers check that beforehand.
    pub fn new(grid: Grid, data: Vec<i16>) -> Self {
        assert_eq!(grid.len(), data.len(), "a volume's values must match its grid");
        Self { grid, data }
    }

    /// Returns the grid.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Returns all values, HU, x fastest.
    pub fn data(&self) -> &[i16] {
        &self.data
    }

    /// Returns all values to be changed. The grid stays.
    pub(crate) fn data_mut(&mut self) -> &mut [i16] {
        &mut self.data
    }

    /// Returns the size of the values in memory, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.data.as_slice())
    }

    /// Returns the value of a voxel, HU, or [`AIR_HU`] outside the grid.
    #[inline]
    pub fn get(&self, i: i64, j: i64, k: i64) -> i16 {
        let [nx, ny, nz] = self.grid.dims();
        if (i as u64) < nx as u64 && (j as u64) < ny as u64 && (k as u64) < nz as u64 {
            self.data[i as usize + nx * (j as usize + ny * k as usize)]
        } else {
            AIR_HU
        }
    }
}
