//! A harmonic function on the lumen: the coordinate along the colon whose level sets never cross.
//!
//! ∇²u = 0 in the lumen and ∂u/∂n = 0 at its wall; u is held in some places, or a given flow enters there. Anywhere else u has no maximum or
//! minimum (maximum principle), so that every level set parts one end from the other, and two of them never meet, however sharp the
//! bend. Planes across a line do meet in bends.
//!
//! The equation is solved by finite volumes (Eymard, Gallouët and Herbin, *Handbook of Numerical Analysis* 7, 2000) over the cells of
//! a [`Domain`]: blocks of a few voxels, parted where a wall runs through them. The flux between two cells is (u₁ − u₂) A / d, with A the
//! area of the voxel faces that they share and d the distance of their centres across these. The mean error is of
//! second order in the size of a cell. Beside the wall, which runs along voxels, it is of first order (both are tested on a bend, where u is
//! the angle). Within a cell u is linear, with the slope that fits the neighbours best.
//!
//! The system is solved by conjugate gradients. A W-cycle over aggregates of cells preconditions them (Braess, *Computing* 55, 1995;
//! see `levels`), and the solution on aggregates is where they begin, so that the great differences of flow between wide and narrow
//! places are right from the first step. It stops when the energy norm of the error, as the preconditioner estimates it, is below a share
//! of that of the solution. Sums are taken over blocks of fixed size, in order: the result is the same for every number of threads.

mod domain;
mod levels;
mod solve;
#[cfg(test)]
mod tests;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

pub use domain::{CELL_MM, Domain, Link};
use levels::Levels;

use crate::error::Result;
use crate::progress::Progress;

/// The least share of the mean square distance of a cell's neighbours that counts along every direction in the fit of its slope.
/// Without it, a cell in a row of cells has none.
const STIFF: f64 = 1e-3;

/// A harmonic function on a [`Domain`].
#[derive(Clone, Debug)]
pub struct Harmonic {
    /// The value of each cell at its centre; NaN where it is not determined.
    values: Vec<f64>,
    /// Its change along the axes of the grid, 1/mm.
    slopes: Vec<DVec3>,
    /// Number of steps that the solution took.
    steps: usize,
}

impl Harmonic {
    /// Solves the equation with the values of some cells held, and with a flow into some cells (the integral of −∇²u over each, mm).
    /// Cells that no way leads to from a held one have no value. It stops when the error's energy norm is below `tolerance` times that of
    /// the solution, or after 200 steps.
    ///
    /// # Errors
    /// Returns status 4 if interrupted.
    pub fn solve(
        domain: &Domain,
        held: &[(u32, f64)],
        sources: &[(u32, f64)],
        tolerance: f64,
        progress: &Progress,
    ) -> Result<Self> {
        let mut values = vec![f64::NAN; domain.len()];
        let mut is_reached = vec![false; domain.components()];
        for &(n, value) in held {
            values[n as usize] = value;
            is_reached[domain.component(n) as usize] = true;
        }
        let is_free = |n: usize| values[n].is_nan() && is_reached[domain.component(n as u32) as usize];
        let free: Vec<bool> = (0..domain.len()).into_par_iter().map(is_free).collect();
        let levels = Levels::new(domain, &free, progress)?;
        let (solution, steps) = levels.solve(domain, (&values, sources), tolerance, progress)?;
        values.par_iter_mut().zip(&solution).zip(&free).for_each(|((v, s), free)| {
            if *free {
                *v = *s;
            }
        });
        let slopes = (0..domain.len() as u32).into_par_iter().map(|n| slope(domain, &values, n)).collect();
        Ok(Self { values, slopes, steps })
    }

    /// Returns the number of steps that the solution took.
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// Returns the value at the centre of a cell; NaN where it is not determined.
    pub fn value(&self, cell: u32) -> f64 {
        self.values[cell as usize]
    }

    /// Returns the value at a place in or beside a cell, in the coordinates of [`Domain::local`]: the mean of the linear functions of the
    /// cell and its neighbours, the nearer the more. NaN where it is not determined.
    pub fn at(&self, domain: &Domain, cell: u32, local: DVec3) -> f64 {
        let size = domain.cell_mm().length_squared();
        let mut sum = (0.0, 0.0);
        let neighbours = domain.neighbours(cell).iter().map(|l| l.to);
        for n in neighbours.chain([cell]) {
            let away = local - domain.centre(n);
            let weight = (-4.0 * away.length_squared() / size).exp().max(1e-30);
            sum.0 += weight * (self.values[n as usize] + self.slopes[n as usize].dot(away));
            sum.1 += weight;
        }
        sum.0 / sum.1
    }
}

/// Returns the slope that fits the differences between a cell and its neighbours best, weighted by how well they conduct.
fn slope(domain: &Domain, values: &[f64], cell: u32) -> DVec3 {
    let (own, centre) = (values[cell as usize], domain.centre(cell));
    if own.is_nan() {
        return DVec3::ZERO;
    }
    let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for link in domain.neighbours(cell) {
        let away = domain.centre(link.to) - centre;
        let weighted = away * f64::from(link.conductance);
        matrix += DMat3::from_cols(weighted * away.x, weighted * away.y, weighted * away.z);
        right += weighted * (values[link.to as usize] - own);
    }
    let trace = matrix.x_axis.x + matrix.y_axis.y + matrix.z_axis.z;
    if trace <= 0.0 {
        return DVec3::ZERO;
    }
    (matrix + DMat3::from_diagonal(DVec3::splat(STIFF * trace))).inverse() * right
}
