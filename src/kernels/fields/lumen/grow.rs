//! Growth of the gas from its core, which keeps neighbouring loops apart, to its surface.

use super::runs::{Rows, Run};
use crate::error::Result;
use crate::progress::Progress;
use crate::volume::Volume;
use colvis_scan::memory;

/// Grows every labelled run by the voxels at or below `limit` HU that are 6-connected to it within `rounds` voxels.
/// Where two labels meet, the smaller one wins.
pub(super) fn grow(volume: &Volume, mut rows: Rows, limit: i16, rounds: usize, progress: &Progress) -> Result<Rows> {
    for _ in 0..rounds {
        let grown = layer(volume, &rows, limit, progress)?;
        if grown.runs() == rows.runs() {
            break;
        }
        rows = grown;
        // The rows before it are as large.
        memory::release();
    }
    Ok(rows)
}

fn layer(volume: &Volume, rows: &Rows, limit: i16, progress: &Progress) -> Result<Rows> {
    let dims @ [nx, ny, nz] = rows.dims();
    // Room that is not used is no memory.
    Rows::gather_about(dims, 2 * rows.runs().len(), |k| {
        progress.check()?;
        let mut out = Vec::new();
        let mut lengths = Vec::with_capacity(ny);
        let mut added: Vec<(u32, u32)> = Vec::new();
        for j in 0..ny {
            let own = rows.row(j, k);
            let values = &volume.data()[volume.grid().index(0, j, k)..][..nx];
            added.clear();
            for r in own {
                let ends = [r.start.checked_sub(1), Some(r.end).filter(|&x| (x as usize) < nx)];
                for x in ends.into_iter().flatten() {
                    uncovered(own, Run { start: x, end: x + 1, ..*r }, values, limit, &mut added);
                }
            }
            let beside = [
                j.checked_sub(1).map(|j| (j, k)),
                Some((j + 1, k)).filter(|_| j + 1 < ny),
                k.checked_sub(1).map(|k| (j, k)),
                Some((j, k + 1)).filter(|_| k + 1 < nz),
            ];
            for (j, k) in beside.into_iter().flatten() {
                for &r in rows.row(j, k) {
                    uncovered(own, r, values, limit, &mut added);
                }
            }
            let before = out.len();
            merge(own, &mut added, &mut out);
            lengths.push((out.len() - before) as u32);
        }
        Ok((lengths, out))
    })
}

/// Lists (x, label) for the voxels of `with` that are in no run of `own` and whose value is at or below `limit` HU.
fn uncovered(own: &[Run], with: Run, values: &[i16], limit: i16, added: &mut Vec<(u32, u32)>) {
    let mut x = with.start;
    let mut at = own.partition_point(|r| r.end <= x);
    while x < with.end {
        let gap_end = own.get(at).map_or(with.end, |r| r.start.min(with.end));
        added.extend((x..gap_end).filter(|&x| values[x as usize] <= limit).map(|x| (x, with.label)));
        x = own.get(at).map_or(with.end, |r| r.end.max(gap_end));
        at += 1;
    }
}

/// Appends the union of `own` and `added` as runs.
fn merge(own: &[Run], added: &mut Vec<(u32, u32)>, out: &mut Vec<Run>) {
    // Sort by x, then by label, so that the smaller of two labels for one voxel stays.
    added.sort_unstable();
    added.dedup_by_key(|a| a.0);
    let first = out.len();
    let mut push = |r: Run| match out[first..].last_mut() {
        Some(last) if last.end == r.start && last.label == r.label => last.end = r.end,
        _ => out.push(r),
    };
    let mut singles = added.iter().map(|&(x, label)| Run { start: x, end: x + 1, label }).peekable();
    for &r in own {
        while let Some(s) = singles.next_if(|s| s.start < r.start) {
            push(s);
        }
        push(r);
    }
    singles.for_each(push);
}
