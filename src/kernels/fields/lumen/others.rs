//! Gas that certainly does not belong to the colon: the air outside, gas around the patient, lungs.

use glam::DVec3;

use super::choose;
use super::frame::Frame;
use super::grow::grow;
use super::kinds::{Features, GasKind};
use super::runs::{self, Rows, Run};
use super::{CORE_HU, GAS_HU, GROWTH, Lumen};
use crate::error::Result;
use crate::progress::Progress;
use crate::volume::{Grid, Volume};

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

/// Finds all gas that does not belong to the colon in the scan where `lumen` was found. Small pieces are not told.
///
/// # Errors
/// Returns an error if cancelled, or if the volume cannot be addressed.
pub fn not_colon(volume: &Volume, lumen: &Lumen, progress: &Progress) -> Result<Others> {
    progress.stage("classifying other gas", volume.grid().dims()[2] as u64);
    let frame = Frame::of(volume.grid());
    let (rows, components) = runs::components_below(volume, CORE_HU, progress)?;
    let kinds = choose::look(volume, &rows, components, frame).kinds();
    // Bodies that were classified as colon or not keep that kind, also where the reader set it.
    let mut own: Vec<Option<GasKind>> = kinds.iter().map(|k| k.reported().map(|r| r.0)).collect();
    for (j, k, r) in rows.iter() {
        let at = (i64::from(r.start), j as i64, k as i64);
        if lumen.gas.find(at.0, at.1, at.2).is_some() || lumen.other.find(at.0, at.1, at.2).is_some() {
            own[r.label as usize] = None;
        }
    }
    let rows = rows.select(|c| own[c as usize].map(|_| c));
    let rows = grow(volume, rows, GAS_HU, GROWTH, progress)?;
    let mut pieces: Vec<Option<Other>> = kinds
        .iter()
        .zip(&own)
        .map(|(k, own)| {
            let (kind, why) = k.reported().filter(|_| own.is_some())?;
            Some(Other::sure(kind, why))
        })
        .collect();
    for (j, k, r) in rows.iter() {
        if let Some(piece) = &mut pieces[r.label as usize] {
            piece.ml += f64::from(r.len()) * volume.grid().voxel_ml();
            piece.reach(volume.grid(), r, j, k);
        }
    }
    let judged = lumen.others.iter().filter(|o| o.is_judged).copied();
    let mut pieces: Vec<Other> = pieces.into_iter().flatten().filter(|p| p.ml > 0.0).chain(judged).collect();
    pieces.sort_by(|a, b| b.ml.total_cmp(&a.ml));
    let rows = rows.select(|c| own[c as usize].map(|kind| kind.number() as u32));
    Ok(Others { pieces, rows: [rows, lumen.other.clone()] })
}
