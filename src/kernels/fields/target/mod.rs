//! D_t, the distance to a target along the lumen. Its slope pulls the camera in the paper's potential. Built only when
//! a scene needs it.
//!
//! The distance solves |∇T| = 1 within the lumen, starting at the target, by fast marching (Sethian 1996) with
//! first-order upwind differences: over the axes whose upwind neighbours are lowest, Σ ((T − T_a)/h_a)² = 1. The front
//! is kept in buckets narrower than a voxel (an untidy queue, Yatziv et al. 2006), so time and memory are linear in the
//! lumen's voxels. Within a bucket, voxels are processed in order of arrival. Every voxel's value comes from lower
//! neighbours, so the target is the only local minimum. Voxels are neighbours only across faces, so there is no path
//! through walls that touch corner to corner. Within the ball inscribed at the target, distances are exact.
//!
//! **A path on which the body fits.** The front passes only where the wall is at least a body's clearance away (and
//! anywhere within 5 mm of both ends). Every other voxel of the lumen gets the distance of the nearest voxel that was
//! passed, plus an increase with the distance from it. From every slit, even one whose far side is nearer to the
//! target, the field leads back to where the body fits. If this does not join the two ends, half the clearance is
//! required, and then none.
//!
//! Between voxels it is the cubic B-spline over the nearby voxels of the lumen. A voxel whose distance differs by more
//! than the paths within the spline's reach can explain is behind a wall and does not count; neither does anything
//! outside. Near walls the remaining weights are scaled to a sum of 1.

mod march;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use glam::DVec3;

use super::distance::{WallDistance, spline};
use super::{Distance, Sample};
use crate::error::{Error, Result};
use crate::progress::Progress;
use march::March;

/// Maximum distance over which a point outside the lumen is moved into it, mm.
const SNAP_MM: f64 = 5.0;
/// Maximum ratio of path length to straight distance between two voxels of the spline's reach.
const DETOUR: f64 = 2.5;

/// The distance to a target along the lumen, mm.
#[derive(Clone, Debug)]
pub struct TargetDistance {
    walls: Arc<WallDistance>,
    /// Distances in the order of the walls' set, mm; infinite outside the lumen and where there is no path to the
    /// target.
    values: Vec<f32>,
    target: DVec3,
    guessed: Vec<[DVec3; 2]>,
    clearance: f64,
}

/// The body that the path must accommodate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyClearance {
    /// Start position, world mm.
    pub from: DVec3,
    /// Clearance that the body needs, mm.
    pub clearance_mm: f64,
}

impl TargetDistance {
    /// Computes the distance to `target` (world, mm; moved into the lumen by at most 5 mm), for a `body` if one is
    /// given.
    ///
    /// `guesses` are pairs of positions (world, mm) between which the lumen may be collapsed. If only one of a pair can
    /// be reached, the straight line between them continues the path and is listed in [`TargetDistance::guessed`].
    ///
    /// # Errors
    /// Returns status 4 if the target is not in the lumen, or when interrupted.
    pub fn to(
        walls: &Arc<WallDistance>,
        target: DVec3,
        body: Option<BodyClearance>,
        guesses: &[[DVec3; 2]],
        progress: &Progress,
    ) -> Result<Self> {
        let Some(voxel) = walls.nearest(target, SNAP_MM) else {
            let why = format!("{:.1},{:.1},{:.1} is not in the lumen", target.x, target.y, target.z);
            return Err(Error::incomplete("target", why, "give a point in the colon's gas or fluid"));
        };
        let target = if walls.is_inside(walls.voxel(target)) { target } else { walls.world(voxel) };
        progress.stage("measuring the distance to the target", walls.voxels() as u64);
        let asked = body.map_or(0.0, |t| t.clearance_mm.max(0.0));
        let mut open = vec![target];
        open.extend(body.map(|t| t.from));
        for clearance in [asked, 0.5 * asked, 0.0] {
            let mut march = March::new(walls, clearance, &open);
            march.ball(voxel, target);
            march.run(progress)?;
            let guessed = march.bridge(guesses, progress)?;
            if clearance > 0.0 {
                if body.is_some_and(|t| !march.reaches(t.from)) {
                    continue;
                }
                march.extend(progress)?;
            }
            return Ok(Self { walls: Arc::clone(walls), values: march.values, target, guessed, clearance });
        }
        unreachable!("the last clearance is none")
    }

    /// Returns the target, world, mm.
    pub fn target(&self) -> DVec3 {
        self.target
    }

    /// Returns the clearance that the path keeps between its ends, mm; 0 if there is no such path.
    pub fn clearance_mm(&self) -> f64 {
        self.clearance
    }

    /// Returns the stretches that were bridged as guesses, each starting on the target's side, world, mm.
    pub fn guessed(&self) -> &[[DVec3; 2]] {
        &self.guessed
    }

    /// Returns the distance at a voxel's centre, mm, or `None` outside the lumen and where there is no path.
    #[inline]
    pub fn at(&self, voxel: [i64; 3]) -> Option<f32> {
        self.walls.set().number(voxel).map(|n| self.values[n]).filter(|d| d.is_finite())
    }

    /// Returns the size in memory, without the shared wall distance, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.values.as_slice())
    }
}

impl Distance for TargetDistance {
    fn sample(&self, at: DVec3) -> Option<Sample> {
        let grid = self.walls.grid();
        let here = self.at(self.walls.voxel(at))?;
        let centre = self.walls.voxel(at);
        let spacing = grid.spacing();
        // Use values relative to the nearest voxel's, so that large distances lose no digits.
        let near = |v: [i64; 3]| {
            let apart: f64 = (0..3).map(|a| (v[a] - centre[a]).abs() as f64 * spacing[a]).sum();
            self.at(v).map(|d| d - here).filter(|d| f64::from(d.abs()) <= DETOUR * apart)
        };
        let s = spline::sample_some(grid, at, near)?;
        Some(Sample { mm: s.mm + f64::from(here), ..s })
    }
}
