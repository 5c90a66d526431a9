//! A scan: Hounsfield units on a regular grid, and the grid's position in the patient.

#[doc(hidden)]
pub mod cell;
mod content;
mod grid;
#[doc(hidden)]
pub mod hounsfield;
pub mod io;
mod position;

use std::sync::atomic::{AtomicU64, Ordering};

use crate::error::{Error, Result};

pub use content::{content_hash, content_origin};
pub use grid::Grid;
pub use position::PatientPosition;

/// Value of everything outside the volume or the scanner's field of view, HU.
pub const AIR_HU: i16 = -1024;

/// A CT volume: one `i16` HU per voxel, x fastest, then y, then z.
///
/// ```
/// # use colvis_scan as colvis;
/// use colvis::volume::{Grid, Volume};
/// use glam::{DMat3, DVec3};
///
/// let grid = Grid::new([2, 2, 2], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY)?;
/// let volume = Volume::new(grid, vec![-1000, -1000, -1000, -1000, 40, 40, 40, 40]); // HU, x fastest
/// assert_eq!((volume.get(0, 0, 0), volume.get(0, 0, 1)), (-1000, 40));
/// # Ok::<(), colvis::error::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Volume {
    grid: Grid,
    data: Vec<i16>,
    header_position: Option<PatientPosition>,
    stamp: u64,
}

impl PartialEq for Volume {
    fn eq(&self, other: &Self) -> bool {
        let Self { grid, data, header_position, stamp: _ } = self;
        (grid, data, header_position) == (&other.grid, &other.data, &other.header_position)
    }
}

/// Returns a number that no volume has yet.
fn stamped() -> u64 {
    static STAMPS: AtomicU64 = AtomicU64::new(0);
    STAMPS.fetch_add(1, Ordering::Relaxed)
}

impl Volume {
    /// Creates a volume of `data` (HU, x fastest) on `grid`.
    ///
    /// # Panics
    /// Panics if the number of values does not match the grid. Readers check that beforehand; [`Volume::try_new`] returns
    /// an error instead.
    pub fn new(grid: Grid, data: Vec<i16>) -> Self {
        assert_eq!(grid.len(), data.len(), "a volume's values must match its grid");
        Self { grid, data, header_position: None, stamp: stamped() }
    }

    /// Like [`Volume::new`], for values whose number is not known to match.
    ///
    /// ```
    /// # use colvis_scan as colvis;
    /// use colvis::volume::{Grid, Volume};
    /// use glam::{DMat3, DVec3};
    ///
    /// let grid = Grid::new([2, 2, 2], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY)?;
    /// let e = Volume::try_new(grid, vec![-1000; 7]).unwrap_err();
    /// assert_eq!(e.to_string(), "volume: 7 values do not fill a grid of 2x2x2 voxels; give one value for each voxel, x fastest");
    /// # Ok::<(), colvis::error::Error>(())
    /// ```
    ///
    /// # Errors
    /// Returns status 3 if the number of values does not match the grid.
    pub fn try_new(grid: Grid, data: Vec<i16>) -> Result<Self> {
        if grid.len() == data.len() {
            return Ok(Self::new(grid, data));
        }
        let [nx, ny, nz] = grid.dims();
        let why = format!("{} values do not fill a grid of {nx}x{ny}x{nz} voxels", data.len());
        Err(Error::input("volume", why, "give one value for each voxel, x fastest"))
    }

    /// Returns the same volume with the patient's position that its header names.
    #[must_use]
    pub fn with_header_position(self, header_position: Option<PatientPosition>) -> Self {
        Self { header_position, ..self }
    }

    /// Returns the patient's position that the scan's header names, if it does.
    pub fn header_position(&self) -> Option<PatientPosition> {
        self.header_position
    }

    /// Returns the grid.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Returns all values, HU, x fastest.
    pub fn data(&self) -> &[i16] {
        &self.data
    }

    /// Returns a number by which what was derived from the values is known to be theirs: values with the same one are the same.
    #[doc(hidden)]
    pub fn stamp(&self) -> u64 {
        self.stamp
    }

    /// Returns all values to be changed. The grid stays.
    #[doc(hidden)]
    pub fn data_mut(&mut self) -> &mut [i16] {
        self.stamp = stamped();
        &mut self.data
    }

    /// Keeps only a box: `dims` voxels from `first` on. It moves its values within the memory that it has, and returns the rest.
    ///
    /// # Panics
    /// Panics if the box is empty or reaches beyond the grid.
    #[must_use]
    pub fn into_part(mut self, first: [usize; 3], dims: [usize; 3]) -> Self {
        let part = self.grid.part(first, dims);
        let mut to = 0;
        for k in first[2]..first[2] + dims[2] {
            for j in first[1]..first[1] + dims[1] {
                // A row never moves up.
                let from = self.grid.index(first[0], j, k);
                self.data.copy_within(from..from + dims[0], to);
                to += dims[0];
            }
        }
        self.data.truncate(to);
        self.data.shrink_to_fit();
        Self { grid: part, stamp: stamped(), ..self }
    }

    /// Returns a copy of a box: `dims` voxels from `first` on.
    ///
    /// # Panics
    /// Panics if the box is empty or reaches beyond the grid.
    #[must_use]
    pub fn part(&self, first: [usize; 3], dims: [usize; 3]) -> Self {
        let grid = self.grid.part(first, dims);
        let mut data = Vec::with_capacity(grid.len());
        for k in first[2]..first[2] + dims[2] {
            for j in first[1]..first[1] + dims[1] {
                let from = self.grid.index(first[0], j, k);
                data.extend_from_slice(&self.data[from..from + dims[0]]);
            }
        }
        Self { grid, data, stamp: stamped(), ..*self }
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

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;

    #[test]
    fn a_part_has_the_values_of_the_whole_at_its_places() {
        let grid =
            Grid::new([7, 6, 5], DVec3::new(0.5, 1.0, 2.0), DVec3::new(-3.0, 4.0, 9.0), DMat3::IDENTITY).unwrap();
        let whole = Volume::new(grid.clone(), (0..grid.len() as i16).collect());
        for (first, dims) in [([0; 3], [7, 6, 5]), ([1, 2, 3], [4, 3, 2]), ([6, 5, 4], [1, 1, 1])] {
            let part = whole.clone().into_part(first, dims);
            assert_eq!(whole.part(first, dims), part);
            assert_eq!((part.grid().dims(), part.data().len()), (dims, dims.iter().product()));
            for n in 0..part.data().len() {
                let v =
                    DVec3::new((n % dims[0]) as f64, (n / dims[0] % dims[1]) as f64, (n / dims[0] / dims[1]) as f64);
                let there = grid.voxel(part.grid().world(v)).round().to_array().map(|x| x as i64);
                assert_eq!(part.data()[n], whole.get(there[0], there[1], there[2]));
            }
        }
    }
}
