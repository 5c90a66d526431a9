//! Finds gas that certainly does not belong to the colon: the air outside, gas around the patient, lungs.

use super::frame::Frame;
use super::grow::grow;
use super::kinds::GasKind;
use super::model::Lumen;
use super::others::{Other, Others};
use super::{CORE_HU, GAS_HU, GROWTH, choose, runs};
use crate::error::Result;
use crate::progress::Progress;
use crate::volume::Volume;

/// Finds all gas that does not belong to the colon in the scan where `lumen` was found. Small pieces are left out.
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
