//! D_t, the distance to a target along the lumen, whose slope pulls the camera in the paper's potential. Built only
//! when a scene asks for it.
//!
//! It solves |∇T| = 1 within the lumen from the target on, by fast marching (Sethian 1996) with first-order upwind
//! differences: over the axes whose upwind neighbours are lowest, Σ ((T − T_a)/h_a)² = 1. The front is kept in buckets
//! narrower than a voxel (an untidy queue, Yatziv et al. 2006), so that time and memory are linear in the lumen's
//! voxels; the order within a bucket is that of arrival. Every voxel's value comes from lower neighbours, so there is
//! no local minimum but the target. Voxels are neighbours across faces only: there is no way through where walls touch
//! corner to corner. Within the ball inscribed at the target distances are exact.
//!
//! **A way on which the body fits.** The front passes only where the wall is at least a body's clearance away (and
//! anywhere within 5 mm of both ends). Every other voxel of the lumen takes the distance of the nearest one that was
//! passed, and more by how far that is: from every slit, also one whose far side is nearer to the target, the field
//! leads back to where the body fits. Where the two ends are not joined so, half the clearance is asked for, and then
//! none.
//!
//! Between voxels it is the cubic B-spline over those voxels of the lumen that the way leads past: a voxel whose
//! distance differs by more than the ways within the spline's reach can explain lies behind a wall, and does not count;
//! nor does what is outside. Near walls the weights of the rest are scaled to a sum of 1.

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

/// A point outside the lumen is moved into it within this, mm.
const SNAP_MM: f64 = 5.0;
/// How much longer than straight the way between two voxels of the spline's reach may be.
const DETOUR: f64 = 2.5;

/// The distance to a target along the lumen, mm.
#[derive(Clone, Debug)]
pub struct TargetDistance {
    walls: Arc<WallDistance>,
    /// In the order of the walls' set; infinite outside the lumen and where the target cannot be reached from.
    values: Vec<f32>,
    target: DVec3,
    guessed: Vec<[DVec3; 2]>,
    clearance: f64,
}

/// The body that a way is looked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyClearance {
    /// Where it begins, world mm.
    pub from: DVec3,
    /// The clearance that it needs, mm.
    pub clearance_mm: f64,
}

impl TargetDistance {
    /// The distance to `target` (world, mm; moved into the lumen within 5 mm), for a traveller if one is named.
    /// `guesses` are pairs of places (world, mm) between which the lumen may be collapsed: where only one of the two
    /// can be reached, the straight line between them is taken as the way on, and listed in
    /// [`TargetDistance::guessed`].
    ///
    /// # Errors
    /// Status 4 when the target is not in the lumen, or when interrupted.
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

    /// The target, world, mm.
    pub fn target(&self) -> DVec3 {
        self.target
    }

    /// The clearance that the way keeps between its ends, mm; 0 when there is no such way.
    pub fn clearance_mm(&self) -> f64 {
        self.clearance
    }

    /// The stretches that were bridged as a guess, each from the side of the target on, world, mm.
    pub fn guessed(&self) -> &[[DVec3; 2]] {
        &self.guessed
    }

    /// The distance at a voxel's centre, mm; none outside the lumen and where there is no way.
    #[inline]
    pub fn at(&self, voxel: [i64; 3]) -> Option<f32> {
        self.walls.set().number(voxel).map(|n| self.values[n]).filter(|d| d.is_finite())
    }

    /// Size in memory, without the wall distance that it shares.
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
        // Relative to the nearest voxel's, so that large distances lose no digits.
        let near = |v: [i64; 3]| {
            let apart: f64 = (0..3).map(|a| (v[a] - centre[a]).abs() as f64 * spacing[a]).sum();
            self.at(v).map(|d| d - here).filter(|d| f64::from(d.abs()) <= DETOUR * apart)
        };
        let s = spline::sample_some(grid, at, near)?;
        Some(Sample { mm: s.mm + f64::from(here), ..s })
    }
}
