//! Gas that does not belong to the colon.

use glam::DVec3;

use super::kinds::{Features, GasKind};
use super::runs::{Rows, Run};
use crate::volume::Grid;

/// A piece of gas that does not belong to the colon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Other {
    /// Volume, ml.
    pub ml: f64,
    /// Its kind.
    pub kind: GasKind,
    /// Reason for the classification.
    pub why: &'static str,
    /// Minimum and maximum world coordinates of its voxels' centres, mm.
    pub bounds_mm: [DVec3; 2],
    /// True if it looked like gas of the colon but was classified as other gas.
    pub is_judged: bool,
    /// Its measures, if it was classified.
    pub features: Option<Features>,
}

impl Other {
    /// Creates an empty piece of a kind that is beyond doubt.
    pub(super) fn sure(kind: GasKind, why: &'static str) -> Self {
        Self { ml: 0.0, kind, why, bounds_mm: Self::NOWHERE, is_judged: false, features: None }
    }

    /// Bounds of nothing, which grow.
    pub(super) const NOWHERE: [DVec3; 2] = [DVec3::INFINITY, DVec3::NEG_INFINITY];

    /// Grows the bounds by a run of row (j, k).
    pub(super) fn reach(&mut self, grid: &Grid, r: Run, j: usize, k: usize) {
        for i in [r.start, r.end - 1] {
            let p = grid.world(DVec3::new(f64::from(i), j as f64, k as f64));
            self.bounds_mm = [self.bounds_mm[0].min(p), self.bounds_mm[1].max(p)];
        }
    }
}

/// All gas outside the colon.
#[derive(Clone, Debug)]
pub struct Others {
    /// Pieces, the largest first.
    pub pieces: Vec<Other>,
    /// Gas excluded by position and texture, and gas that was classified, labelled with the number of its kind.
    pub(super) rows: [Rows; 2],
}

impl Others {
    /// Sets `label` in a mask (x fastest) at these voxels wherever it is 0.
    pub fn mark(&self, mask: &mut [u8], label: u8) {
        self.mark_kinds(mask, |_| label);
    }

    /// Same as [`Others::mark`], with a label for each kind.
    pub fn mark_kinds(&self, mask: &mut [u8], label: impl Fn(GasKind) -> u8) {
        for rows in &self.rows {
            let [nx, ny, _] = rows.dims();
            for (j, k, r) in rows.iter() {
                let row = &mut mask[nx * (j + ny * k)..][..nx];
                let label = label(GasKind::ALL[r.label as usize]);
                row[r.range()].iter_mut().filter(|v| **v == 0).for_each(|v| *v = label);
            }
        }
    }
}
