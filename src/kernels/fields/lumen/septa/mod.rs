//! Septa: walls between two limbs of the colon that thick slices or noise have made darker than the wall's middle.
//!
//! Gas connects at [`CORE_HU`](super::CORE_HU) and grows from there to the wall's middle. Two things let it through a thin wall:
//!
//! 1. **The core leaks.** The average of a slice over tissue and gas, or noise, takes a septum below the core's limit. [`ridges`]
//!    finds the voxels of the core that are a ridge of HU between gas on both sides: the second difference along an axis of means
//!    across it, compared with the scan's own noise. The core is parted there.
//! 2. **The growth meets.** Every voxel remembers the part of the core that it grew from. Where voxels of two parts touch that are far
//!    apart in the core, the brighter of the two is a voxel of a septum. A fold does not part the gas, because the path round it is
//!    short, and a narrow place does not, because it is part of the only way.
//!
//! Tagged fluid meets gas at its level. Where it touches gas far from its own level, a septum lies between them, too.

mod beside_fluid;
mod grown;
mod places;
mod ridges;

use rayon::prelude::*;

use super::choose::BUBBLE_ML;
use super::graph::Graph;
use super::runs::{Rows, Run};
use crate::error::Result;
use crate::progress::Progress;
use crate::volume::Volume;

pub(super) use grown::Grown;

/// Two parts of the gas are far apart if the path between them through the core is longer than this, mm, counted along the axes …
const FAR_MM: f64 = 40.0;
/// … or than this in a scan that may hide septa. Beside a sharp bend the way round the septum's edge is short.
const FAR_IF_HIDDEN_MM: f64 = 24.0;
/// Voxels longer than this may hide a septum, mm …
const THICK_MM: f64 = 1.25;
/// … and so may noise of this standard deviation, HU.
const NOISY_HU: f64 = 25.0;
/// Gas that connects beside ridges, HU. At the rim of a septum, where a mean takes in the wall beside it, no ridge is seen, and values
/// just below the core's limit lead around it.
const PARTED_HU: i16 = -850;

/// What the septa of a scan may be hidden in.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hiding {
    /// Standard deviation of the noise in the gas, HU.
    noise_hu: f64,
    /// True if slices are so thick or noise is so strong that septa may be hidden.
    is_likely: bool,
}

impl Hiding {
    /// Measures it in the core.
    pub(crate) fn of(volume: &Volume, core: &Rows) -> Self {
        let noise_hu = noise_hu(volume, core);
        Self { noise_hu, is_likely: volume.grid().spacing().max_element() >= THICK_MM || noise_hu >= NOISY_HU }
    }

    /// Returns the length of a path between parts that are far apart, mm.
    pub(crate) fn far_mm(self) -> f64 {
        if self.is_likely { FAR_IF_HIDDEN_MM } else { FAR_MM }
    }
}

/// Returns the septa through which the core leaks, linear indices, ascending, if they may be hidden.
pub(super) fn leaks(volume: &Volume, core: &Rows, hiding: Hiding, progress: &Progress) -> Result<Vec<usize>> {
    if !hiding.is_likely {
        return Ok(Vec::new());
    }
    let ridges = ridges::ridges(volume, core, hiding.noise_hu, progress)?;
    if ridges.is_empty() {
        return Ok(ridges);
    }
    // Parted at all ridges, the core tells which of them have parts on either side that are far apart.
    let mut parted = below(volume, &without(core, &ridges), PARTED_HU);
    let pieces = parted.label_components(progress)?;
    let mut voxels = vec![0u64; pieces];
    parted.runs().iter().for_each(|r| voxels[r.label as usize] += u64::from(r.len()));
    // The growth takes bubbles back.
    let least = (BUBBLE_ML / volume.grid().voxel_ml()) as u64;
    let parted = parted.select(|p| (voxels[p as usize] >= least).then_some(0));
    let graph = Graph::of(volume.grid(), &parted, progress)?;
    Grown::of(volume, parted, &graph, hiding, progress)?.septa(volume, None, progress)
}

/// Returns the voxels of rows that are at or below `limit` HU.
fn below(volume: &Volume, rows: &Rows, limit: i16) -> Rows {
    rows.split(|j, k, run, out| {
        let row = &volume.data()[volume.grid().index(0, j, k)..];
        let mut x = run.start;
        while x < run.end {
            let is_below = |x: &u32| row[*x as usize] <= limit;
            let Some(start) = (x..run.end).find(is_below) else { break };
            let end = (start..run.end).find(|x| !is_below(x)).unwrap_or(run.end);
            out.push(Run { start, end, ..run });
            x = end;
        }
    })
}

/// Returns the rows without some voxels (linear indices, ascending).
pub(super) fn without(rows: &Rows, voxels: &[usize]) -> Rows {
    if voxels.is_empty() || rows.dims().contains(&0) {
        return rows.clone();
    }
    let [nx, ny, _] = rows.dims();
    let mut at = 0;
    rows.split(|j, k, run, out| {
        let row = nx * (j + ny * k);
        let mut start = run.start;
        while voxels.get(at).is_some_and(|&v| v < row + run.start as usize) {
            at += 1;
        }
        while let Some(&v) = voxels.get(at).filter(|&&v| v < row + run.end as usize) {
            let i = (v - row) as u32;
            if i > start {
                out.push(Run { start, end: i, ..run });
            }
            start = i + 1;
            at += 1;
        }
        if start < run.end {
            out.push(Run { start, ..run });
        }
    })
}

/// Returns the standard deviation of the noise in the gas, HU: from the median difference of neighbours along x.
fn noise_hu(volume: &Volume, core: &Rows) -> f64 {
    const MOST: usize = 512;
    let [_, ny, nz] = core.dims();
    let slice = |mut counts: Vec<u64>, k: usize| {
        for j in (0..ny).filter(|j| (j + k).is_multiple_of(4)) {
            for r in core.row(j, k).iter().filter(|r| r.len() > 12) {
                let row = &volume.data()[volume.grid().index(0, j, k)..][r.range()];
                // Away from the walls.
                for pair in row[4..row.len() - 4].windows(2).step_by(2) {
                    counts[(i32::from(pair[0]) - i32::from(pair[1])).unsigned_abs().min(MOST as u32) as usize] += 1;
                }
            }
        }
        counts
    };
    let none = || vec![0u64; MOST + 1];
    let sum = |a: Vec<u64>, b: Vec<u64>| a.into_iter().zip(b).map(|(a, b)| a + b).collect();
    let counts = (0..nz).into_par_iter().fold(none, slice).reduce(none, sum);
    let half = counts.iter().sum::<u64>() / 2;
    let mut sum = 0;
    let median = counts.iter().position(|&n| {
        sum += n;
        sum > half
    });
    // The median of |a − b| is 0.6745 · √2 standard deviations.
    median.map_or(0.0, |m| m as f64 / 0.954)
}

#[cfg(test)]
mod tests;
