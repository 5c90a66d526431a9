//! Which fluid belongs to which level.
//!
//! Connected fluid may have several levels: gas above each part has its own pressure, as in a siphon. Each level is a set of
//! adjacent tops of columns under gas, and fluid belongs to the level to which its path is shortest.

use std::collections::VecDeque;

use rayon::prelude::*;

use crate::error::Result;
use crate::fields::Lumen;
use crate::fields::lumen::frame::{AxisDirection, Frame};
use crate::fields::lumen::runs::{Rows, Run, touching};
use crate::math::sets::Sets;
use crate::progress::Progress;
use crate::volume::Grid;

/// Gas is at most this many voxels above the top of fluid: the lumen leaves out what is blurred.
const GAP: i64 = 3;
/// Minimum number of columns of a level.
const COLUMNS: usize = 12;

/// Fluid by level.
#[derive(Debug)]
pub(super) struct Split {
    /// Direction in which gravity pulls.
    pub down: AxisDirection,
    /// The level of each run of fluid; `None` where none is reached.
    pub labels: Vec<Option<u32>>,
    /// Number of levels.
    pub count: usize,
}

/// Finds all levels, and the fluid of each. Returns `None` if there is no gas above any fluid.
pub(super) fn split(grid: &Grid, lumen: &Lumen, progress: &Progress) -> Result<Option<Split>> {
    let fluid = lumen.fluid();
    let Some(down) = downwards(lumen, Frame::of(grid)) else { return Ok(None) };
    let step = down.step();
    let [b, c] = [(down.axis + 1) % 3, (down.axis + 2) % 3];
    // Tops of columns: (across, across, height) and the run.
    let tops_of = |k: usize| {
        progress.check()?;
        let mut tops: Vec<([i64; 3], u32)> = Vec::new();
        for (j, n) in (0..fluid.dims()[1]).flat_map(|j| fluid.row_range(j, k).map(move |n| (j, n))) {
            for i in fluid.runs()[n].range() {
                let at = |m: i64| [i as i64 - m * step[0], j as i64 - m * step[1], k as i64 - m * step[2]];
                let [x, y, z] = at(1);
                if fluid.find(x, y, z).is_some() {
                    continue;
                }
                let is_gas = |m: i64| {
                    let [x, y, z] = at(m);
                    lumen.gas().find(x, y, z).is_some()
                };
                if (1..=GAP).any(is_gas) {
                    let v = at(0);
                    tops.push(([v[b], v[c], v[down.axis]], n as u32));
                }
            }
        }
        Ok(tops)
    };
    let slices: Vec<Vec<_>> = (0..fluid.dims()[2]).into_par_iter().map(tops_of).collect::<Result<_>>()?;
    let mut tops = slices.concat();
    tops.sort_unstable();
    progress.check()?;
    let mut sets = Sets::new(tops.len());
    for (n, ([x, y, height], _)) in tops.iter().enumerate() {
        for (dx, dy) in [(0, 1), (1, -1), (1, 0), (1, 1)] {
            let from = tops.partition_point(|t| t.0 < [x + dx, y + dy, height - 1]);
            let last = [x + dx, y + dy, height + 1];
            for (m, _) in tops.iter().enumerate().skip(from).take_while(|t| t.1.0 <= last) {
                sets.join(n as u32, m as u32);
            }
        }
    }
    let (of, groups) = sets.numbered();
    let mut sizes = vec![0usize; groups];
    of.iter().for_each(|&g| sizes[g as usize] += 1);
    let mut numbers = vec![None; groups];
    let mut count = 0;
    for (number, _) in numbers.iter_mut().zip(&sizes).filter(|(_, size)| **size >= COLUMNS) {
        *number = Some(count as u32);
        count += 1;
    }
    let mut labels = vec![None; fluid.runs().len()];
    let mut open = VecDeque::new();
    for ((_, run), group) in tops.iter().zip(of) {
        let label = &mut labels[*run as usize];
        if let (Some(level), None) = (numbers[group as usize], &label) {
            *label = Some(level);
            open.push_back(*run);
        }
    }
    let beside = neighbours(fluid);
    while let Some(run) = open.pop_front() {
        for &next in &beside[run as usize] {
            if labels[next as usize].is_none() {
                labels[next as usize] = labels[run as usize];
                open.push_back(next);
            }
        }
    }
    Ok(Some(Split { down, labels, count }))
}

/// Returns the runs that share a face with each run.
fn neighbours(rows: &Rows) -> Vec<Vec<u32>> {
    let [_, ny, nz] = rows.dims();
    let mut beside = vec![Vec::new(); rows.runs().len()];
    for (j, k) in (0..nz).flat_map(|k| (0..ny).map(move |j| (j, k))) {
        let here = rows.row_range(j, k);
        for (j, k) in [(j > 0).then(|| (j - 1, k)), (k > 0).then(|| (j, k - 1))].into_iter().flatten() {
            let other = rows.row_range(j, k);
            touching(&rows.runs()[other.clone()], &rows.runs()[here.clone()], |a, b| {
                let (a, b) = (other.start + a, here.start + b);
                beside[a].push(b as u32);
                beside[b].push(a as u32);
            });
        }
        for n in here.clone().skip(1) {
            if rows.runs()[n - 1].end == rows.runs()[n].start {
                beside[n - 1].push(n as u32);
                beside[n].push(n as u32 - 1);
            }
        }
    }
    beside
}

/// Returns the direction in which gravity pulls: away from the gas above the fluid.
fn downwards(lumen: &Lumen, frame: Frame) -> Option<AxisDirection> {
    let gas = lumen.gas();
    let [_, ny, nz] = gas.dims();
    let above = |down: AxisDirection| {
        let step = down.step().map(|s| -GAP * s);
        let count = |(j, k, r): (usize, usize, Run)| {
            let (j, k) = (j.wrapping_add_signed(step[1] as isize), k.wrapping_add_signed(step[2] as isize));
            if j >= ny || k >= nz {
                return 0;
            }
            let [start, end] = [r.start, r.end].map(|x| i64::from(x) + step[0]);
            let row = gas.row(j, k);
            let from = row.partition_point(|g| i64::from(g.end) <= start);
            let near = row[from..].iter().take_while(|g| i64::from(g.start) < end);
            near.map(|g| (i64::from(g.end).min(end) - i64::from(g.start).max(start)) as usize).sum()
        };
        lumen.fluid().iter().map(count).sum::<usize>()
    };
    let sides = [frame.posterior, frame.posterior.back(), frame.left, frame.left.back()].map(|d| (above(d), d));
    let (count, down) = sides.into_iter().reduce(|a, b| if b.0 > a.0 { b } else { a })?;
    (count > 0).then_some(down)
}
