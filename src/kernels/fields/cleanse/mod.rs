//! Electronic cleansing: the scan with the colon's tagged fluid replaced by gas and the wall beneath restored.
//!
//! A voxel holds three materials: tissue, and gas or tag in the lumen. The level of a pool of fluid is a plane, which predicts what
//! gas and tag alone would show; the rest of a voxel is tissue (`pool`). Fluid that stands above its level goes with it (`risen`).
//! Films and stool are layers on the wall (`residue`, `layer`); what cannot be distinguished from a thin wall stays. The changes are
//! kept as [`Changes`]: the scan stays as it is, or exchanges its values with them. Values farther than 5 mm from the removed tag stay
//! as they are.
//!
//! No value depends on the number of threads: the scan is worked on in bricks, each by itself.

mod beside;
mod block;
mod changes;
mod islands;
mod layer;
mod model;
mod pool;
mod pools;
mod residue;
mod risen;
mod scanner;
mod slab;

use super::Lumen;
use super::lumen::Segment;
use crate::error::Result;
use crate::progress::Progress;
use crate::volume::Volume;

pub use changes::Changes;
pub use model::{Cleansed, CleansedPool, Left};

/// HU of gas and of the colon's wall.
const GAS: f32 = -1000.0;
const TISSUE: f32 = 40.0;

/// Wall begins here, HU, and these are surely gas and surely wall.
const WALL_HU: i16 = -650;
const FREE_HU: i16 = -690;
const SOLID_HU: i16 = -610;

/// Estimated properties of the scanner.
#[derive(Clone, Copy, Debug)]
struct Scanner {
    /// Standard deviation of its blur, mm.
    blur_mm: f64,
    /// Its gas, HU.
    gas_hu: f32,
}

/// What a cleansed scan is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum For {
    /// To be looked at and measured: walls are as exact as they get.
    Reading,
    /// To be flown through: a tenth of a millimetre does not matter, half the time does.
    Flying,
}

/// Cleanses a lumen: replaces its tag by gas and restores the wall beneath.
///
/// # Errors
/// Returns status 4 if interrupted.
pub fn cleanse(volume: &Volume, lumen: &Lumen, progress: &Progress) -> Result<Cleansed> {
    let (mut made, pools, scanner) = pools_of(volume, lumen, For::Reading, progress)?;
    // Whatever is bright where a pool was belongs to the pool.
    let mut taken = residue::Bits::new(volume.grid().len());
    pools.runs().for_each(|(voxels, _)| taken.fill(voxels));
    let ml: f64 = made.pools.iter().map(|p| p.ml).sum();
    let usual = made.pools.iter().map(|p| p.ml * p.tag_hu).sum::<f64>() / ml;
    let usual = if ml > 0.0 { usual } else { f64::INFINITY };
    let residue = residue::cleanse(volume, lumen, &taken, usual, &scanner, progress)?;
    let below = pools.over(&Changes::joined(&residue.looked_at));
    made.changes = Changes::joined(&residue.changed).over(&below);
    drop((pools, below, residue.changed, residue.looked_at));
    islands::clear(volume, &mut made.changes, taken, progress)?;
    made.replaced_ml += residue.ml;
    made.residue_ml = residue.ml;
    made.left = summed(made.left.into_iter().chain(residue.left));
    Ok(made)
}

/// Removes only the pools of a lumen, for a flight. Every wall and every passage of the scan stays: fluid becomes gas throughout,
/// and everything else that was not gas stays wall, with the restored values where it lies under fluid. A wall thinner than the
/// scanner's blur may have none of its brightness left between gas and fluid: the scan on display may then have a hole there, the
/// scan to fly must not.
///
/// # Errors
/// Returns status 4 if interrupted.
#[doc(hidden)]
pub fn to_fly(volume: &Volume, lumen: &Lumen, progress: &Progress) -> Result<Cleansed> {
    let (mut made, pools, _) = pools_of(volume, lumen, For::Flying, progress)?;
    let grid = volume.grid();
    let mut fluid = residue::Bits::new(grid.len());
    let mut all = Vec::new();
    for (j, k, r) in lumen.fluid().iter() {
        let row = grid.index(0, j, k);
        fluid.fill(row + r.start as usize..row + r.end as usize);
        all.push((row + r.start as usize, r.len() as usize));
    }
    made.changes = pools;
    made.changes.adjust(|n, hu| {
        if fluid.has(n) {
            hu.min(FREE_HU)
        } else if volume.data()[n] > WALL_HU {
            hu.max(SOLID_HU)
        } else {
            hu.min(WALL_HU)
        }
    });
    let gas = Changes::from_sorted(all.into_iter().flat_map(|(n, count)| (n..n + count).map(|n| (n, GAS as i16))));
    made.changes = made.changes.over(&gas);
    // The report describes what the flight sees: all fluid is gone.
    made.left.clear();
    made.replaced_ml = lumen.fluid_ml();
    Ok(made)
}

/// Removes the pools. Returns the result so far, the new values, and the scanner.
fn pools_of(volume: &Volume, lumen: &Lumen, purpose: For, progress: &Progress) -> Result<(Cleansed, Changes, Scanner)> {
    progress.check()?;
    let split = pools::split(volume.grid(), lumen, progress)?;
    let mut fluids: Vec<pool::Fluid> = Vec::new();
    let mut unknown = 0;
    if let Some(split) = &split {
        fluids.extend((0..split.count as u32).map(|label| pool::Fluid { label, runs: Vec::new() }));
        for ((j, k, r), label) in lumen.fluid().iter().zip(&split.labels) {
            match label {
                Some(label) => fluids[*label as usize].runs.push((j, k, r.range())),
                None => unknown += r.len(),
            }
        }
        // Another level may be nearer to all of its fluid.
        fluids.retain(|f| !f.runs.is_empty());
    }
    let scanner = Scanner { blur_mm: scanner::blur_mm(volume, lumen), gas_hu: scanner::gas_hu(volume, lumen) };
    let pools = match &split {
        Some(split) => pool::cleanse(volume, lumen, split, &fluids, &scanner, purpose, progress)?,
        None => pool::Pools::default(),
    };
    let mut left = pools.left;
    if unknown > 0 {
        left.push(Left { ml: f64::from(unknown) * volume.grid().voxel_ml(), why: pool::NO_LEVEL });
    }
    let made = Cleansed {
        replaced_ml: pools.taken.iter().map(|p| p.ml).sum(),
        pools: pools.taken,
        left: summed(left.into_iter()),
        blur_mm: scanner.blur_mm,
        ..Cleansed::default()
    };
    Ok((made, Changes::joined(&pools.changed), scanner))
}

/// Adds up what was left for the same reason.
fn summed(left: impl Iterator<Item = Left>) -> Vec<Left> {
    let mut out: Vec<Left> = Vec::new();
    for one in left {
        match out.iter_mut().find(|l| l.why == one.why) {
            Some(known) => known.ml += one.ml,
            None => out.push(one),
        }
    }
    out
}

/// Keeps the ends of a scan's segments in the cleansed lumen, if their order from rectum to cecum was known. Where the fluid was,
/// the lumen may lead on into bowel beyond them, which is not flown.
#[doc(hidden)]
pub fn keep_ends(cleansed: &mut Lumen, before: &Lumen) {
    if !before.ordered {
        return;
    }
    for n in 0..cleansed.segments.len() {
        let holds = |s: &&Segment| s.ends.iter().all(|&e| cleansed.segment_at(e) == Some(n));
        let mut joined = before.segments.iter().filter(holds);
        if let Some(first) = joined.next() {
            let last = joined.next_back().unwrap_or(first);
            cleansed.segments[n].ends = [first.ends[0], last.ends[1]];
        }
    }
}

/// Returns the cubic step from 0 at `lo` to 1 at `hi`.
fn step(lo: f32, hi: f32, x: f32) -> f32 {
    let t = ((x - lo) / (hi - lo)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod hostile_tests;
#[cfg(test)]
mod tests;
