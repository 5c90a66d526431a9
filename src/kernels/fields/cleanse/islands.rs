//! Crumbs that are left where tag was: bubbles in it that blur to the brightness of tissue.

use super::GAS;
use super::changes::Changes;
use super::residue::Bits;
use crate::error::Result;
use crate::fields::lumen::runs::{Run, touching};
use crate::math::sets::Sets;
use crate::progress::Progress;
use crate::volume::Volume;

/// Values above this are not gas, HU.
const TISSUE_HU: i16 = -700;
/// Maximum volume of a piece that is cleared, mm³: a larger one may be tissue after all.
const MOST_MM3: f64 = 60.0;

/// Turns remaining pieces that are connected to nothing else into gas. `bits` are overwritten.
pub(super) fn clear(volume: &Volume, changes: &mut Changes, mut bits: Bits, progress: &Progress) -> Result<()> {
    let grid = volume.grid();
    let [nx, ny, nz] = grid.dims();
    bits.clear();
    changes.runs().for_each(|(voxels, _)| bits.fill(voxels));
    // Runs of what is not gas, by row.
    let mut rows: Vec<(usize, Vec<Run>)> = Vec::new();
    let mut count = 0;
    for (voxels, values) in changes.runs() {
        let mut start = None;
        let mut close = |start: &mut Option<usize>, end: usize| {
            let Some(from) = start.take() else { return };
            let row = from / nx;
            if rows.last().is_none_or(|r| r.0 != row) {
                rows.push((row, Vec::new()));
            }
            if let Some((_, runs)) = rows.last_mut() {
                runs.push(Run { start: (from % nx) as u32, end: (from % nx + end - from) as u32, label: count });
                count += 1;
            }
        };
        for (n, hu) in voxels.clone().zip(values) {
            if *hu <= TISSUE_HU || n % nx == 0 {
                close(&mut start, n);
            }
            if *hu > TISSUE_HU {
                start.get_or_insert(n);
            }
        }
        close(&mut start, voxels.end);
    }
    let mut sets = Sets::new(count as usize);
    let mut is_held = vec![false; count as usize];
    let is_tissue = |n: usize| !bits.has(n) && volume.data()[n] > TISSUE_HU;
    let find = |row: usize| rows.binary_search_by_key(&row, |r| r.0).ok().map(|at| rows[at].1.as_slice());
    for (row, runs) in &rows {
        progress.check()?;
        let (j, k) = (row % ny, row / ny);
        for run in runs {
            let (start, end) = (run.start as usize, run.end as usize);
            let held = &mut is_held[run.label as usize];
            *held |= start > 0 && is_tissue(row * nx + start - 1) || end < nx && is_tissue(row * nx + end);
            let beside = [(j > 0).then(|| row - 1), (j + 1 < ny).then(|| row + 1)];
            let around = [(k > 0).then(|| row - ny), (k + 1 < nz).then(|| row + ny)];
            for other in beside.into_iter().chain(around).flatten() {
                *held = *held || (start..end).any(|i| is_tissue(other * nx + i));
            }
        }
        for other in [(j > 0).then(|| row - 1), (k > 0).then(|| row - ny)].into_iter().flatten() {
            let Some(others) = find(other) else { continue };
            touching(others, runs, |a, b| sets.join(others[a].label, runs[b].label));
        }
        for pair in runs.windows(2).filter(|w| w[0].end == w[1].start) {
            sets.join(pair[0].label, pair[1].label);
        }
    }
    let (of, pieces) = sets.numbered();
    let (mut size, mut held) = (vec![0usize; pieces], vec![false; pieces]);
    for run in rows.iter().flat_map(|r| &r.1) {
        let piece = of[run.label as usize] as usize;
        size[piece] += run.len() as usize;
        held[piece] |= is_held[run.label as usize];
    }
    let most = MOST_MM3 / (1e3 * grid.voxel_ml());
    let is_crumb = |label: u32| {
        let piece = of[label as usize] as usize;
        !held[piece] && size[piece] as f64 <= most
    };
    // In the same order as the changes.
    let crumbs = rows.iter().flat_map(|(row, runs)| {
        let own = runs.iter().filter(|r| is_crumb(r.label));
        own.map(move |r| row * nx + r.start as usize..row * nx + r.end as usize)
    });
    let crumbs: Vec<_> = crumbs.collect();
    changes.set(&crumbs, GAS as i16);
    Ok(())
}
