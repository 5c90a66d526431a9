//! Electronic cleansing: the scan with the colon's tagged fluid replaced by gas and the wall beneath restored.
//!
//! A voxel holds three materials: tissue, and gas or tag in the lumen. [`pool`] takes out fluid under a level. What changes is kept
//! as [`Changes`]: the scan stays as it is, or exchanges its values with them.

mod block;
mod changes;
mod pool;
mod scanner;

use std::fmt;

use super::Lumen;
use crate::error::Result;
use crate::progress::Progress;
use crate::volume::Volume;

pub use changes::Changes;
pub use pool::CleansedPool;

/// HU of gas and of the colon's wall.
const GAS: f32 = -1000.0;
const TISSUE: f32 = 40.0;

/// A scan's colon without tag.
#[derive(Clone, Debug, Default)]
pub struct Cleansed {
    /// The values that differ from the scan's.
    pub changes: Changes,
    /// The pools that were taken out.
    pub pools: Vec<CleansedPool>,
    /// Volume of the films and the stool that were taken out, ml.
    pub residue_ml: f64,
    /// Volume of all tag that was taken out, ml.
    pub replaced_ml: f64,
    /// Tag that was left.
    pub left: Vec<Left>,
    /// Standard deviation of the scan's blur, mm; 0 without tag, where nobody asks.
    pub blur_mm: f64,
}

/// Tag that was not taken out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Left {
    /// Volume, ml.
    pub ml: f64,
    /// Why.
    pub why: &'static str,
}

impl fmt::Display for Cleansed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.changes.is_empty() {
            return f.write_str("there is no tag in the colon: the scan stays as it is");
        }
        let pools = self.pools.len();
        write!(f, "took {:.1} ml of tag out of the colon, in {pools} ", self.replaced_ml)?;
        f.write_str(if pools == 1 { "pool" } else { "pools" })?;
        if self.residue_ml > 0.0 {
            write!(f, " and {:.1} ml of films and stool", self.residue_ml)?;
        }
        let left: f64 = self.left.iter().map(|l| l.ml).sum();
        if left > 0.05 { write!(f, "; left {left:.1} ml") } else { Ok(()) }
    }
}

/// What is known of the scanner.
#[derive(Clone, Copy, Debug)]
struct Scanner {
    /// Standard deviation of its blur, mm.
    blur_mm: f64,
}

/// Takes the tag out of a lumen.
///
/// # Errors
/// Returns status 4 if interrupted.
pub fn cleanse(volume: &Volume, lumen: &Lumen, progress: &Progress) -> Result<Cleansed> {
    let (labels, count) = lumen.fluid().components_by_corners();
    if count == 0 {
        return Ok(Cleansed::default());
    }
    let mut fluids: Vec<pool::Fluid> = (0..count as u32).map(|label| pool::Fluid { label, runs: Vec::new() }).collect();
    for ((j, k, r), &label) in lumen.fluid().iter().zip(&labels) {
        fluids[label as usize].runs.push((j, k, r.range()));
    }
    let scanner = Scanner { blur_mm: scanner::blur_mm(volume, lumen) };
    let pools = pool::cleanse(volume, lumen, &labels, &fluids, &scanner, progress)?;
    let mut changed = pools.changed.concat();
    changed.sort_unstable_by_key(|c| c.0);
    Ok(Cleansed {
        changes: Changes::from_sorted(changed.into_iter()),
        replaced_ml: pools.taken.iter().map(|p| p.ml).sum(),
        pools: pools.taken,
        residue_ml: 0.0,
        left: pools.left,
        blur_mm: scanner.blur_mm,
    })
}

/// Returns the cubic step from 0 at `lo` to 1 at `hi`.
fn step(lo: f32, hi: f32, x: f32) -> f32 {
    let t = ((x - lo) / (hi - lo)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests;
