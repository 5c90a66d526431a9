//! D_s, the distance to the wall, inside the lumen and in a shell of two voxels around it.
//!
//! The wall is sampled where grid edges between a voxel of the lumen and one outside cross the iso value, by linear interpolation
//! (half-way for a mask). The distance to these samples is exact (see `transform`). It is therefore never less than the distance to
//! the interpolated wall, and exceeds it by at most the diagonal of a voxel. Right beside the wall, the plane through the
//! neighbouring samples replaces them. Measured on spheres, the error is 0.02 of a voxel in the mean and at most 0.4, at voxels
//! that see the wall along a diagonal, past their own edges (see the tests). The distance is negative in the shell.
//!
//! A distance takes 16 bits. It is counted in 1/512 mm, or in a power of two below 1/128 of a voxel if that is less; 32767 of these reach 64 mm.
//! In a lumen that is wider, which no colon is, the unit is four times as long, as often as necessary. Distances are rounded down, to half a
//! unit between the passes, so they stay bounds.
//!
//! Between voxels it is a cubic B-spline with the distances as its coefficients. The spline is twice continuously differentiable,
//! exact where the distance is linear, and a mean of distances, so it never overshoots. Its weights have the second moment h²/3
//! about the position along each axis, and distances are 1-Lipschitz. The spline therefore stays within √((hx² + hy² + hz²)/3) of
//! the distance everywhere (Jensen). It approaches that bound only on the ridge, which it rounds.
//!
//! On a sheared grid (a tilted gantry stored as such), distances are measured along the axes as if they were orthogonal
//! and scaled by their least stretch: a lower bound of the distance.

#[doc(hidden)]
pub mod compare;
mod envelope;
mod lines;
mod of_lumen;
mod parabolas;
pub(in crate::fields) mod spline;
#[cfg(test)]
mod tests;
mod transform;

use glam::DVec3;

use super::clearance::smallest_singular_value;
use super::voxels::{VoxelBits, VoxelSet};
use super::{Clearance, Clearances, Distance, Sample, Values};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::{Grid, Volume};
use transform::Walls;

/// Width of the shell around the lumen in which the distance is kept too, voxels: the spline's reach at any position in the lumen.
const SHELL: usize = 2;

/// The part of the lumen that counts as free.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Through {
    /// Gas alone: where a camera can see.
    Gas,
    /// Gas and tagged fluid: the anatomical lumen, in which fluid joins the segments of gas.
    #[default]
    GasAndFluid,
}

/// The distance to the wall, mm.
#[derive(Clone, Debug)]
pub struct WallDistance {
    grid: Grid,
    set: VoxelSet,
    /// Distances in the order of the set, in units; at least 0 in the lumen, negative outside.
    values: Vec<i16>,
    /// The unit, mm.
    unit: f32,
    /// See [`smallest_singular_value`].
    shrink: f64,
    voxels: usize,
    /// Maximum excess of a value over the distance to the wall, mm.
    excess: f64,
}

impl WallDistance {
    /// Computes the distance to the boundary of a mask. Every nonzero voxel is lumen.
    ///
    /// # Errors
    /// Same as [`WallDistance::of_lumen`].
    pub fn of_mask(mask: &Volume, progress: &Progress) -> Result<Self> {
        let inside = VoxelBits::from_fn(mask.grid().dims(), |n| mask.data()[n] != 0);
        Self::build(mask.grid(), &inside, None, SHELL, progress)
    }

    fn build(
        grid: &Grid,
        inside: &VoxelBits,
        hu: Option<(&Values<'_>, i16)>,
        shell: usize,
        progress: &Progress,
    ) -> Result<Self> {
        let set = inside.dilated(shell).numbered().ok_or_else(too_many)?;
        let walls = Walls { inside, hu };
        let shrink = smallest_singular_value(grid.direction());
        // A mask without any wall fills the whole grid, so only the grid's size bounds the distance.
        let most = (grid.spacing() * DVec3::from_array(grid.dims().map(|n| n as f64))).length();
        // The values and what they are made by are most of a flight's memory at its peak.
        colvis_scan::memory::release();
        let (values, unit) = transform::distances(&walls, &set, grid.spacing().to_array(), (shrink, most), progress)?;
        colvis_scan::memory::release();
        let excess = if hu.is_some() { grid.spacing().length() } else { 0.0 };
        Ok(Self { grid: grid.clone(), voxels: inside.count(), set, values, unit, shrink, excess })
    }

    /// Returns the grid.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Returns the number of voxels of the lumen.
    pub fn voxels(&self) -> usize {
        self.voxels
    }

    /// Returns the voxels that have a value: the lumen's and the shell's.
    pub fn set(&self) -> &VoxelSet {
        &self.set
    }

    /// Returns the value of a member of [`WallDistance::set`] by its number, mm: at least 0 in the lumen, negative outside.
    ///
    /// # Panics
    /// Panics if there are not so many.
    #[inline]
    pub fn value(&self, n: usize) -> f32 {
        f32::from(self.values[n]) * self.unit
    }

    /// Returns all values in the set's order, mm: see [`WallDistance::value`].
    pub fn values(&self) -> impl ExactSizeIterator<Item = f32> + '_ {
        self.values.iter().map(|&v| f32::from(v) * self.unit)
    }

    /// Returns the distance at a voxel's centre, mm: negative outside the lumen, `None` beyond the shell.
    #[inline]
    pub fn at(&self, voxel: [i64; 3]) -> Option<f32> {
        self.set.number(voxel).map(|n| self.value(n))
    }

    /// True if a voxel belongs to the lumen.
    #[inline]
    pub fn is_inside(&self, voxel: [i64; 3]) -> bool {
        self.at(voxel).is_some_and(|d| d >= 0.0)
    }

    /// Returns the voxel that contains a position (world, mm).
    pub fn voxel(&self, world: DVec3) -> [i64; 3] {
        // `as` saturates, so a position far outside stays outside, and NaN becomes the voxel below voxel 0.
        let u = self.grid.voxel(world);
        if u.is_nan() { [-1; 3] } else { u.to_array().map(|x| x.round() as i64) }
    }

    /// Returns the voxel of the lumen nearest to a position (world, mm), if one is within `within_mm`. The voxel that
    /// contains the position comes first; otherwise centres are compared.
    pub fn nearest(&self, world: DVec3, within_mm: f64) -> Option<[i64; 3]> {
        let centre = self.voxel(world);
        if self.is_inside(centre) {
            return Some(centre);
        }
        if !world.is_finite() {
            return None;
        }
        // The index span of a world distance is the length of that row of the inverse matrix.
        let inverse = self.grid.to_voxel().matrix3.transpose();
        let reach = [0, 1, 2].map(|a| (inverse.col(a).length() * within_mm).ceil() as i64);
        let dims = self.grid.dims().map(|n| n as i64);
        let span =
            |a: usize| (centre[a].saturating_sub(reach[a])).max(0)..centre[a].saturating_add(reach[a] + 1).min(dims[a]);
        let mut best: Option<(f64, [i64; 3])> = None;
        for k in span(2) {
            for j in span(1) {
                for i in span(0) {
                    let far = self.world([i, j, k]).distance(world);
                    if far <= within_mm && best.is_none_or(|b| far < b.0) && self.is_inside([i, j, k]) {
                        best = Some((far, [i, j, k]));
                    }
                }
            }
        }
        best.map(|b| b.1)
    }

    /// Returns the centre of a voxel, world, mm.
    pub fn world(&self, voxel: [i64; 3]) -> DVec3 {
        self.grid.world(DVec3::new(voxel[0] as f64, voxel[1] as f64, voxel[2] as f64))
    }

    /// Returns the maximum deviation of the spline from the distance, mm.
    pub fn margin_mm(&self) -> f64 {
        (self.grid.spacing().length_squared() / 3.0).sqrt()
    }

    /// Returns the size in memory, bytes.
    pub fn bytes(&self) -> usize {
        self.set.bytes() + size_of_val(self.values.as_slice())
    }
}

fn too_many() -> Error {
    Error::input("volume", "holds more lumen than can be numbered", "crop or resample it")
}

impl Distance for WallDistance {
    /// Defined in every voxel of the lumen and slightly beyond the wall, where it is negative.
    fn sample(&self, at: DVec3) -> Option<Sample> {
        spline::sample(&self.grid, at, |v| self.at(v))
    }
}

impl Clearances for WallDistance {
    /// Never more than the distance to the wall of the lumen that this was built from (with [`Through::Gas`], of the gas). It is
    /// the best bound given by the voxels around the position: a distance changes by at most the path length. The diagonal of a
    /// voxel is subtracted, since distances to the wall's samples can exceed the distance to the wall by that much.
    fn clearance(&self, at: DVec3) -> Clearance {
        let none = Clearance { mm: 0.0, toward: DVec3::ZERO };
        if !self.is_inside(self.voxel(at)) {
            return none;
        }
        let base = self.grid.voxel(at).floor();
        let mut mm = 0.0f64;
        for c in 0..8 {
            let corner = base + DVec3::new(f64::from(c & 1), f64::from(c >> 1 & 1), f64::from(c >> 2));
            let Some(d) = self.at(corner.to_array().map(|x| x as i64)) else { continue };
            // The length along axes taken as orthogonal is at least `shrink` times the world length.
            let way = self.grid.world(corner).distance(at);
            mm = mm.max(f64::from(d) - way);
        }
        let toward = self.sample(at).map_or(DVec3::ZERO, |s| -s.gradient.normalize_or_zero());
        Clearance { mm: (mm - self.excess * self.shrink).max(0.0), toward }
    }
}

#[cfg(test)]
impl WallDistance {
    /// Returns the distance inside the region accepted by `is_in` (world, mm), on a grid with its first voxel at the origin.
    pub(in crate::fields) fn drawn(dims: [usize; 3], spacing: DVec3, is_in: impl Fn(DVec3) -> bool) -> Self {
        let grid = Grid::new(dims, spacing, DVec3::ZERO, glam::DMat3::IDENTITY).unwrap();
        let place =
            |n: usize| DVec3::new((n % dims[0]) as f64, (n / dims[0] % dims[1]) as f64, (n / dims[0] / dims[1]) as f64);
        let data = (0..grid.len()).map(|n| i16::from(is_in(grid.world(place(n))))).collect();
        Self::of_mask(&Volume::new(grid, data), &Progress::new()).unwrap()
    }
}
