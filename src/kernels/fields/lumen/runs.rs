//! Sets of voxels as runs along the index x axis, and their connected components.
//!
//! A lumen of millions of voxels is a few hundred thousand runs, so nothing here is ever as large as the volume.

use std::ops::Range;

use rayon::prelude::*;

use super::frame::AxisDirection;
use crate::error::{Error, Result};
use crate::math::sets::Sets;
use crate::progress::Progress;
use crate::volume::Volume;

/// Number of slices made at a time.
const SLICES: usize = 32;

/// Voxels `start..end` of one row, all with the same `label`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::fields) struct Run {
    pub start: u32,
    pub end: u32,
    pub label: u32,
}

impl Run {
    pub(crate) fn len(self) -> u32 {
        self.end - self.start
    }

    pub(crate) fn range(self) -> Range<usize> {
        self.start as usize..self.end as usize
    }
}

/// Runs in voxel order, accessible by row. Runs of a row are disjoint and ascending.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(in crate::fields) struct Rows {
    dims: [usize; 3],
    /// Start of each row in `runs`; one more entry than there are rows.
    offsets: Vec<u32>,
    runs: Vec<Run>,
}

impl Rows {
    /// Joins the rows of slices given in order, each as (length of every row, runs). Fails if there are too many runs to number
    /// with 32 bits.
    pub(crate) fn from_slices(dims: [usize; 3], slices: Vec<(Vec<u32>, Vec<Run>)>) -> Result<Self> {
        let mut rows = Self::without_rows(dims);
        slices.into_iter().try_for_each(|s| rows.append(s))?;
        Ok(rows)
    }

    /// Same as [`Rows::from_slices`] with slices that `slice` makes by number, in parallel. Only a few slices exist beside the rows
    /// at any time: all of a scan's gas and noise is tens of megabytes. Fails as [`Rows::from_slices`] does, and with the first error of
    /// `slice`.
    pub(crate) fn gather(
        dims: [usize; 3],
        slice: impl Fn(usize) -> Result<(Vec<u32>, Vec<Run>)> + Sync,
    ) -> Result<Self> {
        Self::gather_about(dims, 0, slice)
    }

    /// Same as [`Rows::gather`], with room for about so many runs from the beginning.
    pub(crate) fn gather_about(
        dims: [usize; 3],
        count: usize,
        slice: impl Fn(usize) -> Result<(Vec<u32>, Vec<Run>)> + Sync,
    ) -> Result<Self> {
        Self::gather_layers(dims, 1, count, |k| Ok(vec![slice(k)?]))
    }

    /// Same as [`Rows::gather_about`], by layers of so many slices; the last one may have fewer. `layer` returns the slices of a layer.
    pub(crate) fn gather_layers(
        dims: [usize; 3],
        thickness: usize,
        count: usize,
        layer: impl Fn(usize) -> Result<Vec<(Vec<u32>, Vec<Run>)>> + Sync,
    ) -> Result<Self> {
        let mut rows = Self::without_rows(dims);
        rows.runs.reserve(count);
        let (layers, some) = (dims[2].div_ceil(thickness), SLICES.div_ceil(thickness));
        for first in (0..layers).step_by(some) {
            let batch = (first..(first + some).min(layers)).into_par_iter().map(&layer);
            batch.collect::<Result<Vec<_>>>()?.into_iter().flatten().try_for_each(|s| rows.append(s))?;
        }
        rows.runs.shrink_to_fit();
        Ok(rows)
    }

    fn without_rows(dims: [usize; 3]) -> Self {
        let mut offsets = Vec::with_capacity(dims[1] * dims[2] + 1);
        offsets.push(0);
        Self { dims, offsets, runs: Vec::new() }
    }

    /// Adds the next slice.
    pub(super) fn append(&mut self, (lengths, runs): (Vec<u32>, Vec<Run>)) -> Result<()> {
        let Ok(mut at) = u32::try_from(self.runs.len()) else { return Err(too_many()) };
        if u32::try_from(self.runs.len() + runs.len()).is_err() {
            return Err(too_many());
        }
        for n in lengths {
            at += n;
            self.offsets.push(at);
        }
        self.runs.extend(runs);
        Ok(())
    }

    pub(crate) fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// Returns the runs of row (j, k).
    pub(crate) fn row(&self, j: usize, k: usize) -> &[Run] {
        &self.runs[self.row_range(j, k)]
    }

    /// Returns the range of row (j, k) among all runs.
    pub(crate) fn row_range(&self, j: usize, k: usize) -> Range<usize> {
        let r = j + self.dims[1] * k;
        self.offsets[r] as usize..self.offsets[r + 1] as usize
    }

    pub(crate) fn runs(&self) -> &[Run] {
        &self.runs
    }

    /// Returns all runs with their row: (j, k, run).
    pub(crate) fn iter(&self) -> impl Iterator<Item = (usize, usize, Run)> + Clone + '_ {
        (0..self.dims[2])
            .flat_map(move |k| (0..self.dims[1]).map(move |j| (j, k)))
            .flat_map(move |(j, k)| self.row(j, k).iter().map(move |&r| (j, k, r)))
    }

    /// Returns the run that contains voxel (i, j, k); `None` outside the grid.
    pub(crate) fn find(&self, i: i64, j: i64, k: i64) -> Option<Run> {
        let [nx, ny, nz] = self.dims;
        if (i as u64) >= nx as u64 || (j as u64) >= ny as u64 || (k as u64) >= nz as u64 {
            return None;
        }
        let row = self.row(j as usize, k as usize);
        let at = row.partition_point(|r| i64::from(r.end) <= i);
        row.get(at).copied().filter(|r| i64::from(r.start) <= i)
    }

    /// Keeps only a box, `dims` voxels from `first` on, with its own numbers of voxels.
    pub(crate) fn part(&self, first: [usize; 3], dims: [usize; 3]) -> Self {
        let mut out = Self::without_rows(dims);
        let (low, high) = (first[0] as u32, (first[0] + dims[0]) as u32);
        for k in first[2]..first[2] + dims[2] {
            for j in first[1]..first[1] + dims[1] {
                let within = self.row(j, k).iter().filter(|r| r.end > low && r.start < high);
                out.runs.extend(within.map(|r| Run {
                    start: r.start.max(low) - low,
                    end: r.end.min(high) - low,
                    label: r.label,
                }));
                out.offsets.push(out.runs.len() as u32);
            }
        }
        out.runs.shrink_to_fit();
        out
    }

    /// Calls `visit` for the voxels one step in `axis_direction` from the given run of row (j, k) that are in no run.
    pub(crate) fn beyond(
        &self,
        r: Run,
        j: usize,
        k: usize,
        axis_direction: AxisDirection,
        mut visit: impl FnMut([i64; 3]),
    ) {
        let [nx, ny, nz] = self.dims;
        let [di, dj, dk] = axis_direction.step();
        if di != 0 {
            let i = if di > 0 { i64::from(r.end) } else { i64::from(r.start) - 1 };
            // A run with another label may follow immediately.
            if (0..nx as i64).contains(&i) && self.find(i, j as i64, k as i64).is_none() {
                visit([i, j as i64, k as i64]);
            }
            return;
        }
        let (j, k) = (j as i64 + dj, k as i64 + dk);
        if !(0..ny as i64).contains(&j) || !(0..nz as i64).contains(&k) {
            return;
        }
        let row = self.row(j as usize, k as usize);
        let mut next = r.start;
        for other in row[row.partition_point(|o| o.end <= r.start)..].iter().take_while(|o| o.start < r.end) {
            (next..other.start).for_each(|i| visit([i64::from(i), j, k]));
            next = other.end;
        }
        (next..r.end).for_each(|i| visit([i64::from(i), j, k]));
    }

    /// Keeps the runs whose label `keep` maps to a new one, relabelled; drops the others.
    pub(crate) fn select(&self, keep: impl Fn(u32) -> Option<u32>) -> Self {
        self.pick(|_, r| keep(r.label))
    }

    /// Replaces the label of each run.
    pub(crate) fn relabelled(mut self, label: impl Fn(u32) -> u32) -> Self {
        self.runs.iter_mut().for_each(|r| r.label = label(r.label));
        self
    }

    /// Keeps the runs that `keep`, given a run's number and the run, maps to a new label.
    pub(crate) fn pick(&self, keep: impl Fn(usize, Run) -> Option<u32>) -> Self {
        let mut out = Self { dims: self.dims, offsets: Vec::with_capacity(self.offsets.len()), runs: Vec::new() };
        out.offsets.push(0);
        for row in self.offsets.windows(2) {
            let kept = (row[0] as usize..row[1] as usize).filter_map(|n| {
                let run = self.runs[n];
                keep(n, run).map(|label| Run { label, ..run })
            });
            out.runs.extend(kept);
            out.offsets.push(out.runs.len() as u32);
        }
        out.runs.shrink_to_fit();
        out
    }

    /// Replaces each run, given as (j, k, run), by those that `parts` appends, in order.
    pub(crate) fn split(&self, mut parts: impl FnMut(usize, usize, Run, &mut Vec<Run>)) -> Self {
        let mut out = Self { dims: self.dims, offsets: Vec::with_capacity(self.offsets.len()), runs: Vec::new() };
        out.offsets.push(0);
        for (n, row) in self.offsets.windows(2).enumerate() {
            for &run in &self.runs[row[0] as usize..row[1] as usize] {
                parts(n % self.dims[1], n / self.dims[1], run, &mut out.runs);
            }
            out.offsets.push(out.runs.len() as u32);
        }
        out.runs.shrink_to_fit();
        out
    }

    /// Keeps the runs that `keep`, given a run's number and the run, maps to a new label, and joins those of one label that follow each other
    /// without a gap.
    pub(crate) fn joined(&self, keep: impl Fn(usize, Run) -> Option<u32>) -> Self {
        let mut out = Self { dims: self.dims, offsets: Vec::with_capacity(self.offsets.len()), runs: Vec::new() };
        // Room that is not used is no memory.
        out.runs.reserve(self.runs.len());
        out.offsets.push(0);
        for row in self.offsets.windows(2) {
            let first = out.runs.len();
            for n in row[0] as usize..row[1] as usize {
                let run = self.runs[n];
                let Some(label) = keep(n, run) else { continue };
                match out.runs[first..].last_mut() {
                    Some(last) if last.end == run.start && last.label == label => last.end = run.end,
                    _ => out.runs.push(Run { label, ..run }),
                }
            }
            out.offsets.push(out.runs.len() as u32);
        }
        out.runs.shrink_to_fit();
        out
    }

    /// Returns the 26-connected component of every run, and the number of components. The runs of each row must be separate.
    pub(crate) fn components_by_corners(&self) -> (Vec<u32>, usize) {
        let [_, ny, nz] = self.dims;
        let mut sets = Sets::new(self.runs.len());
        for (j, k) in (0..nz).flat_map(|k| (0..ny).map(move |j| (j, k))) {
            let here = self.row_range(j, k);
            let below = (k > 0).then(|| j.saturating_sub(1)..(j + 2).min(ny)).into_iter().flatten().map(|j| (j, k - 1));
            for (j, k) in below.chain((j > 0).then(|| (j - 1, k))) {
                let other = self.row_range(j, k);
                near(&self.runs[other.clone()], &self.runs[here.clone()], 1, |a, b| {
                    sets.join((other.start + a) as u32, (here.start + b) as u32);
                });
            }
        }
        sets.numbered()
    }

    /// Labels every run with its 6-connected component, numbered from 0 in the order of first voxels, and returns the number of
    /// components. The runs of each row must be separate. Slices are joined internally in parallel, then to each other in order.
    pub(super) fn label_components(&mut self, progress: &Progress) -> Result<usize> {
        let [_, ny, nz] = self.dims;
        let within = |k: usize| {
            let base = self.offsets[k * ny] as usize;
            let mut own = Sets::new(self.offsets[(k + 1) * ny] as usize - base);
            for j in 1..ny {
                let (a, b) = (self.row_range(j - 1, k), self.row_range(j, k));
                touching(&self.runs[a.clone()], &self.runs[b.clone()], |x, y| {
                    own.join((a.start - base + x) as u32, (b.start - base + y) as u32);
                });
            }
            own
        };
        let mut sets = Sets::concat((0..nz).into_par_iter().map(within).collect());
        for k in 1..nz {
            progress.check()?;
            for j in 0..ny {
                let (a, b) = (self.row_range(j, k - 1), self.row_range(j, k));
                touching(&self.runs[a.clone()], &self.runs[b.clone()], |x, y| {
                    sets.join((a.start + x) as u32, (b.start + y) as u32);
                });
            }
        }
        let (labels, count) = sets.numbered();
        for (run, label) in self.runs.iter_mut().zip(labels) {
            run.label = label;
        }
        Ok(count)
    }

    /// Returns the size in memory, bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.offsets.capacity() * size_of::<u32>() + self.runs.capacity() * size_of::<Run>()
    }
}

fn too_many() -> Error {
    Error::input("volume", "is too large and too noisy to be segmented", "crop or resample it")
}

/// Calls `f(a, b)` for the indices of every two runs of rows `a` and `b` that share an x.
pub(in crate::fields) fn touching(a: &[Run], b: &[Run], f: impl FnMut(usize, usize)) {
    near(a, b, 0, f);
}

/// Same as [`touching`], for runs that share an x or, if `slack` is 1, touch corner to corner. In that case the runs of
/// each row must be separate.
pub(super) fn near(a: &[Run], b: &[Run], slack: u32, mut f: impl FnMut(usize, usize)) {
    let (mut i, mut j) = (0, 0);
    while i < a.len() && j < b.len() {
        if a[i].start < b[j].end + slack && b[j].start < a[i].end + slack {
            f(i, j);
        }
        if a[i].end <= b[j].end {
            i += 1;
        } else {
            j += 1;
        }
    }
}

/// Returns the voxels at or below `limit` HU with their 6-connected components as labels (numbered from 0 in the order
/// of their first voxels), and the number of components.
///
/// Slices are scanned and joined internally in parallel, then joined to each other in order.
pub(super) fn components_below(volume: &Volume, limit: i16, progress: &Progress) -> Result<(Rows, usize)> {
    let dims @ [nx, ny, _] = volume.grid().dims();
    if u32::try_from(nx).is_err() {
        return Err(Error::input("volume", format!("a row of {nx} voxels is too long"), "crop it"));
    }
    let mut rows = Rows::gather(dims, |k| {
        let mut runs = Vec::new();
        let mut lengths = Vec::with_capacity(ny);
        for row in volume.data()[k * nx * ny..][..nx * ny].chunks_exact(nx) {
            let before = runs.len();
            scan_row(row, limit, &mut runs);
            lengths.push((runs.len() - before) as u32);
        }
        progress.advance(1)?;
        Ok((lengths, runs))
    })?;
    let count = rows.label_components(progress)?;
    Ok((rows, count))
}

/// Appends the runs of a row's values at or below `limit` HU.
fn scan_row(row: &[i16], limit: i16, runs: &mut Vec<Run>) {
    let mut start = None;
    for (block, values) in row.chunks(64).enumerate() {
        let base = (block * 64) as u32;
        // Most blocks are uniform, which counting detects faster than collecting bits.
        let inside = match values.iter().map(|&v| u16::from(v <= limit)).sum::<u16>() {
            0 => 0,
            64 => u64::MAX,
            _ => values.iter().enumerate().fold(0, |m, (x, &v)| m | (u64::from(v <= limit) << x)),
        };
        // Bit x of `edges` is set where voxel x differs from the previous one.
        let mut edges = inside ^ ((inside << 1) | u64::from(start.is_some()));
        if values.len() < 64 {
            edges &= (1 << values.len()) - 1;
        }
        while edges != 0 {
            let x = base + edges.trailing_zeros();
            edges &= edges - 1;
            match start.take() {
                None => start = Some(x),
                Some(s) => runs.push(Run { start: s, end: x, label: 0 }),
            }
        }
    }
    if let Some(s) = start {
        runs.push(Run { start: s, end: row.len() as u32, label: 0 });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::Grid;
    use glam::{DMat3, DVec3};
    use proptest::prelude::*;

    fn volume(dims: [usize; 3], data: Vec<i16>) -> Volume {
        Volume::new(Grid::new(dims, DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap(), data)
    }

    /// Finds components by flooding voxel after voxel, numbered by their first voxels.
    fn flooded(v: &Volume, limit: i16) -> Vec<Option<u32>> {
        let [nx, ny, nz] = v.grid().dims();
        let mut out = vec![None; v.data().len()];
        let mut next = 0;
        for seed in 0..out.len() {
            if v.data()[seed] > limit || out[seed].is_some() {
                continue;
            }
            let mut open = vec![seed];
            out[seed] = Some(next);
            while let Some(at) = open.pop() {
                let (i, j, k) = (at % nx, at / nx % ny, at / nx / ny);
                let mut visit = |ok: bool, to: usize| {
                    if ok && v.data()[to] <= limit && out[to].is_none() {
                        out[to] = Some(next);
                        open.push(to);
                    }
                };
                visit(i > 0, at.wrapping_sub(1));
                visit(i + 1 < nx, at + 1);
                visit(j > 0, at.wrapping_sub(nx));
                visit(j + 1 < ny, at + nx);
                visit(k > 0, at.wrapping_sub(nx * ny));
                visit(k + 1 < nz, at + nx * ny);
            }
            next += 1;
        }
        out
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]

        #[test]
        fn components_are_those_of_a_flood(
            nx in prop::sample::select(vec![1usize, 2, 7, 63, 64, 65, 130]), ny in 1usize..7, nz in 1usize..7,
            seed: u64, share in 0.05f64..0.95,
        ) {
            let data = (0..nx * ny * nz)
                .map(|n| if crate::math::hash::uniform(seed, n as u64) < share { -900 } else { 0 })
                .collect();
            let v = volume([nx, ny, nz], data);
            let (rows, count) = components_below(&v, -800, &Progress::new()).unwrap();
            let expected = flooded(&v, -800);
            let mut got = vec![None; v.data().len()];
            for (j, k, r) in rows.iter() {
                for i in r.range() {
                    got[v.grid().index(i, j, k)] = Some(r.label);
                }
            }
            prop_assert_eq!(&got, &expected);
            prop_assert_eq!(count, expected.iter().flatten().max().map_or(0, |&m| m as usize + 1));
            for (n, e) in expected.iter().enumerate() {
                let found = rows.find((n % nx) as i64, (n / nx % ny) as i64, (n / nx / ny) as i64).map(|r| r.label);
                prop_assert_eq!(found, *e);
            }
        }
    }

    #[test]
    fn a_voxel_outside_the_grid_is_in_no_run() {
        let (rows, _) = components_below(&volume([2, 2, 2], vec![-1000; 8]), -800, &Progress::new()).unwrap();
        assert!(rows.find(0, 0, 0).is_some());
        for p in [(-1, 0, 0), (2, 0, 0), (0, -1, 0), (0, 2, 0), (0, 0, -1), (0, 0, 2), (i64::MIN, i64::MAX, 0)] {
            assert!(rows.find(p.0, p.1, p.2).is_none());
        }
    }

    #[test]
    fn a_cancelled_job_gives_up() {
        let progress = Progress::new();
        progress.cancel();
        assert!(components_below(&volume([2, 2, 2], vec![-1000; 8]), -800, &progress).is_err());
    }

    #[test]
    fn the_size_in_memory_is_that_of_rows_and_runs() {
        // Two runs in each of six rows.
        let v = volume([4, 3, 2], (0..24).map(|n| if n % 2 == 0 { -1000 } else { 0 }).collect());
        let (rows, _) = components_below(&v, -800, &Progress::new()).unwrap();
        assert_eq!(rows.runs().len(), 12);
        // Four bytes for the start of each row and for the end of all, three numbers of four bytes for each run.
        assert_eq!(rows.bytes(), 7 * 4 + 12 * 12);
    }
}
