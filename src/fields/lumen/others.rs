//! Gas that certainly does not belong to the colon: the air outside, gas around the patient, lungs.

use glam::DVec3;

use super::choose::{self, Kind};
use super::frame::Frame;
use super::grow::grow;
use super::runs::{self, Rows};
use super::{CORE_HU, GAS_HU, GROWTH, Lumen};
use crate::error::Result;
use crate::progress::Progress;
use crate::volume::Volume;

/// A piece of gas that does not belong to the colon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Other {
    /// Volume, ml.
    pub ml: f64,
    /// Kind: `outside`, `around` (in the table, in clothes) or `lung`.
    pub kind: &'static str,
    /// Reason for the classification.
    pub why: &'static str,
    /// Minimum and maximum world coordinates of its voxels' centres, mm.
    pub bounds_mm: [DVec3; 2],
}

/// All gas outside the colon.
#[derive(Clone, Debug)]
pub struct Others {
    /// Pieces, the largest first.
    pub pieces: Vec<Other>,
    rows: Rows,
}

impl Others {
    /// Sets `label` in a mask (x fastest) at these voxels wherever it is 0.
    pub fn mark(&self, mask: &mut [u8], label: u8) {
        let [nx, ny, _] = self.rows.dims();
        for (j, k, r) in self.rows.iter() {
            let row = &mut mask[nx * (j + ny * k)..][..nx];
            row[r.range()].iter_mut().filter(|v| **v == 0).for_each(|v| *v = label);
        }
    }
}

/// Finds gas that certainly does not belong to the colon in the scan where `lumen` was found. Small pieces are not
/// classified, and neither are those that look like the colon without being part of it.
///
/// # Errors
/// Returns an error if cancelled, or if the volume cannot be addressed.
pub fn not_colon(volume: &Volume, lumen: &Lumen, progress: &Progress) -> Result<Others> {
    progress.stage("finding what is no colon", volume.grid().dims()[2] as u64);
    let frame = Frame::of(volume.grid());
    let (rows, components) = runs::components_below(volume, CORE_HU, progress)?;
    let mut kinds = choose::kinds(volume, &rows, components, frame);
    for (j, k, r) in rows.iter() {
        // A given position can make anything a colon.
        if lumen.gas.find(i64::from(r.start), j as i64, k as i64).is_some() {
            kinds[r.label as usize] = Kind::Unsure;
        }
    }
    let is_other = |c: u32| !matches!(kinds[c as usize], Kind::Unsure);
    let rows = rows.select(|c| is_other(c).then_some(c));
    let rows = grow(volume, rows, GAS_HU, GROWTH, progress)?;
    let (mut voxels, mut bounds) = (vec![0u64; components], vec![[DVec3::INFINITY, DVec3::NEG_INFINITY]; components]);
    for (j, k, r) in rows.iter() {
        voxels[r.label as usize] += u64::from(r.len());
        for i in [r.start, r.end - 1] {
            let p = volume.grid().world(DVec3::new(f64::from(i), j as f64, k as f64));
            let b = &mut bounds[r.label as usize];
            *b = [b[0].min(p), b[1].max(p)];
        }
    }
    let piece = |c: usize| {
        let (kind, why) = kinds[c].reported()?;
        Some(Other { ml: voxels[c] as f64 * volume.grid().voxel_ml(), kind, why, bounds_mm: bounds[c] })
    };
    let mut pieces: Vec<Other> = (0..components).filter(|&c| voxels[c] > 0).filter_map(piece).collect();
    pieces.sort_by(|a, b| b.ml.total_cmp(&a.ml));
    Ok(Others { pieces, rows })
}
