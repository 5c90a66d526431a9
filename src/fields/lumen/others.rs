//! Gas that is surely none of the colon's: the air outside, gas around the patient, lungs.

use glam::DVec3;

use super::choose::{self, Kind};
use super::frame::Frame;
use super::grow::grow;
use super::runs::{self, Rows};
use super::{CORE_HU, GAS_HU, GROWTH, Lumen};
use crate::error::Result;
use crate::progress::Progress;
use crate::volume::Volume;

/// A piece of gas that is none of the colon's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Other {
    /// Its volume, ml.
    pub ml: f64,
    /// What it is: `outside`, `around` (in the table, in clothes) or `lung`.
    pub kind: &'static str,
    /// How that is told.
    pub why: &'static str,
    /// Least and greatest world coordinates of its voxels' centres, mm.
    pub bounds_mm: [DVec3; 2],
}

/// All such gas.
#[derive(Clone, Debug)]
pub struct Others {
    /// Its pieces, the largest first.
    pub pieces: Vec<Other>,
    rows: Rows,
}

impl Others {
    /// Marks its voxels in a mask (x fastest) wherever that is 0.
    pub fn mark(&self, mask: &mut [u8], label: u8) {
        let [nx, ny, _] = self.rows.dims();
        for (j, k, r) in self.rows.iter() {
            let row = &mut mask[nx * (j + ny * k)..][..nx];
            row[r.range()].iter_mut().filter(|v| **v == 0).for_each(|v| *v = label);
        }
    }
}

/// Finds what is surely none of the colon's in the scan that `lumen` was found in. Of small pieces, and of those that look
/// like the colon without being a part of it, nothing is said.
///
/// # Errors
/// When cancelled, or when the volume cannot be addressed.
pub fn not_colon(volume: &Volume, lumen: &Lumen, progress: &Progress) -> Result<Others> {
    progress.stage("finding what is no colon", volume.grid().dims()[2] as u64);
    let frame = Frame::of(volume.grid());
    let (rows, components) = runs::components_below(volume, CORE_HU, progress)?;
    let mut kinds = choose::kinds(volume, &rows, components, frame);
    for (j, k, r) in rows.iter() {
        // A place that was given may make a colon of anything.
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
