//! A box of voxels of the scan with the values around it, as small as a cache.

use std::ops::Range;

use fearless_simd::{Level, Simd, dispatch};
use glam::Vec3;

use crate::fields::lumen::runs::Rows;
use crate::fields::voxels::each_bit;
use crate::math::normal;
use crate::volume::{Grid, Volume};

/// Edge of a cell, over which levels of brightness are averaged, mm.
const CELL_MM: f64 = 3.0;
/// Cells of a brick along each axis.
const CELLS: [usize; 3] = [8, 4, 4];

/// Division of a grid into bricks, each of some cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Bricks {
    /// Voxels along the edges of a cell.
    pub cell: [usize; 3],
    /// Voxels of the grid.
    pub dims: [usize; 3],
}

impl Bricks {
    pub(super) fn of(grid: &Grid) -> Self {
        // Rows of a block are words: see [`Mask`].
        let cell = (CELL_MM / grid.spacing()).round().to_array().map(|n| (n as usize).clamp(1, 4));
        Self { cell, dims: grid.dims() }
    }

    /// Returns the number of voxels of a brick along each axis.
    pub(super) fn edges(&self) -> [usize; 3] {
        [0, 1, 2].map(|a| self.cell[a] * CELLS[a])
    }

    /// Returns the number of bricks along each axis.
    pub(super) fn counts(&self) -> [usize; 3] {
        let edges = self.edges();
        [0, 1, 2].map(|a| self.dims[a].div_ceil(edges[a]))
    }

    /// Returns the bricks (numbered, x fastest) that hold voxels within `reach` of the runs, ascending.
    pub(super) fn around(&self, runs: &[(usize, usize, Range<usize>)], reach: [usize; 3]) -> Vec<usize> {
        let (edges, counts) = (self.edges(), self.counts());
        let bricks = |from: usize, end: usize, a: usize| {
            from.saturating_sub(reach[a]) / edges[a]..=((end - 1 + reach[a]) / edges[a]).min(counts[a] - 1)
        };
        let mut marked = vec![false; counts.iter().product()];
        for (j, k, r) in runs {
            for z in bricks(*k, k + 1, 2) {
                for y in bricks(*j, j + 1, 1) {
                    let row = counts[0] * (y + counts[1] * z);
                    let x = bricks(r.start, r.end, 0);
                    marked[row + x.start()..=row + x.end()].fill(true);
                }
            }
        }
        (0..marked.len()).filter(|&b| marked[b]).collect()
    }

    /// Returns which brick along each axis a brick is.
    pub(super) fn at(&self, brick: usize) -> [usize; 3] {
        let counts = self.counts();
        [brick % counts[0], brick / counts[0] % counts[1], brick / counts[0] / counts[1]]
    }

    /// Returns the box of a brick with a margin, which may lie outside the grid.
    pub(super) fn block(&self, brick: usize, margin: [usize; 3]) -> Block {
        self.blocks(self.at(brick), [1; 3], margin)
    }

    /// Returns the box of so many bricks along each axis, as far as there are, from one of them on, with a margin. Rows are words:
    /// there is one brick along x.
    pub(super) fn blocks(&self, at: [usize; 3], many: [usize; 3], margin: [usize; 3]) -> Block {
        let edges = self.edges();
        let own = [0, 1, 2].map(|a| (many[a] * edges[a]).min(self.dims[a] - at[a] * edges[a]));
        Block {
            first: [0, 1, 2].map(|a| (at[a] * edges[a]) as i64 - margin[a] as i64),
            dims: [0, 1, 2].map(|a| own[a] + 2 * margin[a]),
            margin,
        }
    }
}

/// A box of voxels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Block {
    /// Its first voxel.
    pub first: [i64; 3],
    /// Voxels along each axis, with the margin on both sides.
    pub dims: [usize; 3],
    /// Voxels along each axis by which it is wider than its brick.
    pub margin: [usize; 3],
}

impl Block {
    pub(super) fn len(&self) -> usize {
        self.dims.iter().product()
    }

    /// Returns the part of this box within `reach` rows, along y and z, of the rows that hold a voxel of `mask`, which is of any box and
    /// not empty. It has no margin.
    pub(super) fn part_around(&self, mask: &Mask, reach: [usize; 3]) -> Self {
        let ny = mask.block.dims[1];
        let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
        for (n, _) in mask.rows.iter().enumerate().filter(|(_, row)| **row != 0) {
            let at = [n % ny, n / ny];
            low = [0, 1].map(|a| low[a].min(at[a]));
            high = [0, 1].map(|a| high[a].max(at[a]));
        }
        let mut part = Self { margin: [0; 3], ..*self };
        for a in [1, 2] {
            let (begin, end) = (self.first[a], self.first[a] + self.dims[a] as i64);
            let [low, high] = [low, high].map(|rows| mask.block.first[a] + rows[a - 1] as i64);
            part.first[a] = (low - reach[a] as i64).clamp(begin, end);
            part.dims[a] = ((high + reach[a] as i64 + 1).clamp(begin, end) - part.first[a]) as usize;
        }
        part
    }

    pub(super) fn strides(&self) -> [usize; 3] {
        [1, self.dims[0], self.dims[0] * self.dims[1]]
    }

    /// Returns the voxel at an index of the box.
    pub(super) fn voxel(&self, n: usize) -> [i64; 3] {
        let [nx, ny, _] = self.dims;
        let at = [n % nx, n / nx % ny, n / nx / ny];
        [0, 1, 2].map(|a| self.first[a] + at[a] as i64)
    }

    /// Calls `visit` with the index in this box and the voxel for all voxels of the brick.
    pub(super) fn each_own(&self, mut visit: impl FnMut(usize, [i64; 3])) {
        let range = |a: usize| self.margin[a]..self.dims[a] - self.margin[a];
        let [_, sy, sz] = self.strides();
        for z in range(2) {
            for y in range(1) {
                for x in range(0) {
                    let at = [x, y, z];
                    visit(x + sy * y + sz * z, [0, 1, 2].map(|a| self.first[a] + at[a] as i64));
                }
            }
        }
    }

    /// Returns the index of a voxel of this box.
    pub(super) fn index(&self, voxel: [i64; 3]) -> usize {
        let [x, y, z] = [0, 1, 2].map(|a| (voxel[a] - self.first[a]) as usize);
        x + self.dims[0] * (y + self.dims[1] * z)
    }

    /// Returns which rows of this box are within `reach` rows, along y and z, of one that holds a voxel of `mask`, which is of any box.
    pub(super) fn rows_around(&self, mask: &Mask, reach: [usize; 3]) -> Vec<bool> {
        let [_, ny, nz] = self.dims;
        let other = mask.block;
        let mut near = vec![false; ny * nz];
        let around = |at: usize, a: usize| {
            let at = at as i64 + other.first[a] - self.first[a];
            let reach = reach[a] as i64;
            (at - reach).clamp(0, self.dims[a] as i64) as usize..(at + reach + 1).clamp(0, self.dims[a] as i64) as usize
        };
        for (n, _) in mask.rows.iter().enumerate().filter(|(_, row)| **row != 0) {
            for z in around(n / other.dims[1], 2) {
                for y in around(n % other.dims[1], 1) {
                    near[y + ny * z] = true;
                }
            }
        }
        near
    }

    /// Returns the values of the scan, HU. Beyond the scan its outermost values are repeated.
    pub(super) fn load(&self, volume: &Volume) -> Vec<f32> {
        dispatch!(Level::new(), simd => simd.vectorize(
            #[inline(always)]
            || self.loaded(volume),
        ))
    }

    #[inline(always)]
    fn loaded(&self, volume: &Volume) -> Vec<f32> {
        let (dims, data) = (volume.grid().dims(), volume.data());
        let within = |n: i64, a: usize| n.clamp(0, dims[a] as i64 - 1) as usize;
        let mut out = Vec::with_capacity(self.len());
        for z in 0..self.dims[2] as i64 {
            for y in 0..self.dims[1] as i64 {
                let row = dims[0] * (within(self.first[1] + y, 1) + dims[1] * within(self.first[2] + z, 2));
                let row = &data[row..row + dims[0]];
                let x = self.first[0]..self.first[0] + self.dims[0] as i64;
                if x.start >= 0 && x.end <= dims[0] as i64 {
                    out.extend(row[x.start as usize..x.end as usize].iter().map(|&hu| f32::from(hu)));
                } else {
                    out.extend(x.map(|i| f32::from(row[within(i, 0)])));
                }
            }
        }
        out
    }

    /// Returns which voxels are in runs that `is_one` accepts by their number.
    pub(super) fn mask(&self, rows: &Rows, is_one: impl Fn(usize) -> bool) -> Mask {
        let dims = rows.dims();
        let mut out = Mask { block: *self, rows: vec![0; self.dims[1] * self.dims[2]] };
        let inside = |first: i64, n: usize, count: usize| {
            let at = first + n as i64;
            (0..count as i64).contains(&at).then_some(at as usize)
        };
        for z in 0..self.dims[2] {
            let Some(k) = inside(self.first[2], z, dims[2]) else { continue };
            for y in 0..self.dims[1] {
                let Some(j) = inside(self.first[1], y, dims[1]) else { continue };
                let (range, row) = (rows.row_range(j, k), rows.row(j, k));
                let from = row.partition_point(|r| i64::from(r.end) <= self.first[0]);
                for (n, r) in row.iter().enumerate().skip(from) {
                    let start = (i64::from(r.start) - self.first[0]).max(0) as usize;
                    let end = (i64::from(r.end) - self.first[0]).clamp(0, self.dims[0] as i64) as usize;
                    if start >= self.dims[0] {
                        break;
                    }
                    if is_one(range.start + n) {
                        out.rows[y + self.dims[1] * z] |= bits(end) & !bits(start);
                    }
                }
            }
        }
        out
    }

    /// Blurs by Gaussians of standard deviations `sigma` (voxels), one axis after the other. Beyond the box its outermost values
    /// are repeated.
    pub(super) fn blur(&self, values: &mut Vec<f32>, sigma: [f64; 3]) {
        let bells = sigma.map(bell);
        dispatch!(Level::new(), simd => simd.vectorize(
            #[inline(always)]
            || self.blurred(values, &bells),
        ));
    }

    #[inline(always)]
    fn blurred(&self, values: &mut Vec<f32>, bells: &[Vec<f32>; 3]) {
        let [nx, ny, nz] = self.dims;
        let strides = self.strides();
        let mut from = vec![0f32; values.len()];
        for a in 0..3 {
            let bell = &bells[a];
            std::mem::swap(values, &mut from);
            if a == 0 {
                for (to, row) in values.chunks_exact_mut(nx).zip(from.chunks_exact(nx)) {
                    to.iter_mut().zip(row).for_each(|(t, f)| *t = bell[0] * f);
                    for (d, b) in bell.iter().enumerate().skip(1) {
                        let (first, last) = (d.min(nx), nx.saturating_sub(d));
                        let at = |x: usize| b * (row[x.saturating_sub(d)] + row[(x + d).min(nx - 1)]);
                        for x in (0..first.min(last)).chain(last.max(first.min(last))..nx) {
                            to[x] += at(x);
                        }
                        if first < last {
                            let both = row[..last - d].iter().zip(&row[first + d..]);
                            to[first..last].iter_mut().zip(both).for_each(|(t, (l, h))| *t += b * (l + h));
                        }
                    }
                }
                continue;
            }
            // Whole rows at once.
            let (count, stride) = (self.dims[a], strides[a]);
            for row in 0..ny * nz {
                let at = row * nx;
                let n = at / stride % count;
                let to = &mut values[at..at + nx];
                to.iter_mut().zip(&from[at..at + nx]).for_each(|(t, f)| *t = bell[0] * f);
                for (d, b) in bell.iter().enumerate().skip(1) {
                    let low = at - (n - n.saturating_sub(d)) * stride;
                    let high = at + ((n + d).min(count - 1) - n) * stride;
                    let (low, high) = (&from[low..low + nx], &from[high..high + nx]);
                    to.iter_mut().zip(low).zip(high).for_each(|((t, l), h)| *t += b * (l + h));
                }
            }
        }
    }
    /// Replaces each value by what `of` keeps of those in a box of half sides `reach` around it, as far as it is in this box.
    pub(super) fn spread(&self, values: &mut Vec<f32>, reach: [usize; 3], of: impl Fn(f32, f32) -> f32) {
        dispatch!(Level::new(), simd => simd.vectorize(
            #[inline(always)]
            || self.spread_along(values, reach, &of),
        ));
    }

    #[inline(always)]
    fn spread_along(&self, values: &mut Vec<f32>, reach: [usize; 3], of: impl Fn(f32, f32) -> f32) {
        let [nx, ny, nz] = self.dims;
        let mut from = vec![0f32; values.len()];
        for (to, row) in from.chunks_exact_mut(nx).zip(values.chunks_exact(nx)) {
            to.copy_from_slice(row);
            for d in 1..=reach[0].min(nx - 1) {
                to.iter_mut().zip(&row[d..]).for_each(|(t, o)| *t = of(*t, *o));
                to[d..].iter_mut().zip(row).for_each(|(t, o)| *t = of(*t, *o));
            }
        }
        // Whole rows at once.
        for (count, stride, reach) in [(ny, 1, reach[1]), (nz, ny, reach[2])] {
            std::mem::swap(values, &mut from);
            from.copy_from_slice(values);
            for row in 0..ny * nz {
                let n = row / stride % count;
                let to = &mut from[row * nx..(row + 1) * nx];
                for m in n.saturating_sub(reach)..(n + reach + 1).min(count) {
                    let other = (row + m * stride - n * stride) * nx;
                    to.iter_mut().zip(&values[other..other + nx]).for_each(|(t, o)| *t = of(*t, *o));
                }
            }
        }
        std::mem::swap(values, &mut from);
    }
}

/// The lowest `count` bits.
fn bits(count: usize) -> u64 {
    if count < 64 { (1 << count) - 1 } else { u64::MAX }
}

/// A set of voxels of a block, whose rows are words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Mask {
    block: Block,
    /// Those with the same z follow each other.
    pub(super) rows: Vec<u64>,
}

impl Mask {
    /// A row of a block has no more voxels.
    pub(super) const ROW: usize = 64;

    /// True if it holds the voxel at an index of the block.
    pub(super) fn has(&self, n: usize) -> bool {
        let nx = self.block.dims[0];
        self.rows[n / nx] >> (n % nx) & 1 == 1
    }

    /// True if it holds all voxels of the block.
    pub(super) fn is_full(&self) -> bool {
        self.rows.iter().all(|&row| row == bits(self.block.dims[0]))
    }

    /// True if it is empty.
    pub(super) fn is_empty(&self) -> bool {
        self.rows.iter().all(|row| *row == 0)
    }

    /// Keeps the rows that `is_one` accepts, given their number.
    pub(super) fn keep_rows(&mut self, is_one: impl Fn(usize) -> bool) {
        for (at, row) in self.rows.iter_mut().enumerate() {
            if *row != 0 && !is_one(at) {
                *row = 0;
            }
        }
    }

    /// Keeps the voxels that `is_one` accepts, given their index in the block.
    pub(super) fn keep(&mut self, mut is_one: impl FnMut(usize) -> bool) {
        let nx = self.block.dims[0];
        for (at, row) in self.rows.iter_mut().enumerate() {
            let mut kept = 0;
            each_bit(*row, |x| kept |= u64::from(is_one(at * nx + x)) << x);
            *row = kept;
        }
    }

    /// Keeps the voxels of another set of the same block.
    pub(super) fn keep_in(&mut self, other: &Self) {
        self.rows.iter_mut().zip(&other.rows).for_each(|(row, other)| *row &= other);
    }

    /// Keeps the voxels of a part of the block.
    pub(super) fn keep_within(&mut self, part: &[Range<usize>; 3]) {
        let along = bits(part[0].end) & !bits(part[0].start);
        let ny = self.block.dims[1];
        for (at, row) in self.rows.iter_mut().enumerate() {
            let is_in = part[1].contains(&(at % ny)) && part[2].contains(&(at / ny));
            *row &= if is_in { along } else { 0 };
        }
    }

    /// Adds the voxel at an index of the block.
    pub(super) fn set(&mut self, n: usize) {
        let nx = self.block.dims[0];
        self.rows[n / nx] |= 1 << (n % nx);
    }

    /// Adds the voxels of another set of the same block.
    pub(super) fn add(&mut self, other: &Self) {
        self.rows.iter_mut().zip(&other.rows).for_each(|(row, more)| *row |= more);
    }

    /// Returns the voxels of the set in the brick itself.
    pub(super) fn own(&self) -> Self {
        let mut own = Self { block: self.block, rows: vec![0; self.rows.len()] };
        self.each_own(|n, _| own.set(n));
        own
    }

    /// Calls `visit` with the index in the block of each voxel.
    pub(super) fn each(&self, mut visit: impl FnMut(usize)) {
        for (row, &word) in self.rows.iter().enumerate() {
            each_bit(word, |x| visit(row * self.block.dims[0] + x));
        }
    }

    /// Calls `visit` with the index in the block and the voxel for each voxel of the set in the brick itself.
    pub(super) fn each_own(&self, mut visit: impl FnMut(usize, [i64; 3])) {
        let Block { first, dims, margin } = self.block;
        let own = bits(dims[0] - margin[0]) & !bits(margin[0]);
        for z in margin[2]..dims[2] - margin[2] {
            for y in margin[1]..dims[1] - margin[1] {
                let row = y + dims[1] * z;
                let at = [first[0], first[1] + y as i64, first[2] + z as i64];
                each_bit(self.rows[row] & own, |x| visit(row * dims[0] + x, [at[0] + x as i64, at[1], at[2]]));
            }
        }
    }

    /// Returns the voxels within a box of half sides `reach` of one of the set.
    pub(super) fn dilated(&self, reach: [usize; 3]) -> Self {
        let [nx, ny, nz] = self.block.dims;
        let mut rows: Vec<u64> = self
            .rows
            .iter()
            .map(|&row| (1..=reach[0]).fold(row, |wide, d| wide | row << d | row >> d) & bits(nx))
            .collect();
        let spread = |to: &mut [u64], from: &[u64], by: usize| {
            to.iter_mut().zip(&from[by..]).for_each(|(to, from)| *to |= from);
            to[by..].iter_mut().zip(from).for_each(|(to, from)| *to |= from);
        };
        let from = rows.clone();
        for (to, from) in rows.chunks_exact_mut(ny).zip(from.chunks_exact(ny)) {
            (1..=reach[1].min(ny - 1)).for_each(|by| spread(to, from, by));
        }
        let from = rows.clone();
        (1..=reach[2].min(nz - 1)).for_each(|by| spread(&mut rows, &from, by * ny));
        Self { block: self.block, rows }
    }

    /// Returns the voxels around which a box of half sides `reach` is in the set, as far as it is in the block.
    pub(super) fn eroded(&self, reach: [usize; 3]) -> Self {
        let all = bits(self.block.dims[0]);
        let outside = Self { block: self.block, rows: self.rows.iter().map(|r| !r & all).collect() };
        let rows = outside.dilated(reach).rows.iter().map(|r| !r & all).collect();
        Self { block: self.block, rows }
    }
}

/// Returns half of a normalised Gaussian, to three standard deviations.
fn bell(sigma: f64) -> Vec<f32> {
    let reach = (3.0 * sigma).ceil() as usize;
    let mut bell: Vec<f32> = (0..=reach).map(|n| (-0.5 * (n as f64 / sigma.max(1e-6)).powi(2)).exp() as f32).collect();
    let total = bell[0] + 2.0 * bell[1..].iter().sum::<f32>();
    bell.iter_mut().for_each(|b| *b /= total);
    bell
}

/// A mean over each cell around some voxels, read between the cells.
#[derive(Clone, Debug)]
pub(super) struct CellMeans {
    first: [i64; 3],
    dims: [usize; 3],
    cell: Vec3,
    values: Vec<f32>,
}

impl CellMeans {
    /// Smooths sums over cells (given as (cell, sum, count)) and divides them, with `weight` times the value `usual` added.
    pub(super) fn new(bricks: &Bricks, sums: &[([usize; 3], f64, f64)], usual: f64, weight: f64) -> Self {
        let low = [0, 1, 2].map(|a| sums.iter().map(|s| s.0[a]).min().unwrap_or(0) as i64 - 2);
        let high = [0, 1, 2].map(|a| sums.iter().map(|s| s.0[a]).max().unwrap_or(0) as i64 + 2);
        let block = Block { first: low, dims: [0, 1, 2].map(|a| (high[a] - low[a] + 1) as usize), margin: [0; 3] };
        let [_, sy, sz] = block.strides();
        let (mut sum, mut count) = (vec![0f32; block.len()], vec![0f32; block.len()]);
        for (cell, s, c) in sums {
            let [x, y, z] = [0, 1, 2].map(|a| (cell[a] as i64 - low[a]) as usize);
            // The deviation from what is usual, so that it stays precise.
            sum[x + sy * y + sz * z] += (s - usual * c) as f32;
            count[x + sy * y + sz * z] += *c as f32;
        }
        block.blur(&mut sum, [0.8; 3]);
        block.blur(&mut count, [0.8; 3]);
        let values = sum.iter().zip(&count).map(|(s, c)| usual as f32 + s / (c + weight as f32)).collect();
        let cell = Vec3::from_array(bricks.cell.map(|c| c as f32));
        Self { first: low, dims: block.dims, cell, values }
    }

    /// Returns the first voxel along x that is not before the middle of a cell, which is counted from the first one.
    fn middle(&self, x: usize) -> i64 {
        let cell = self.cell[0] as i64;
        cell * (x as i64 + self.first[0]) + cell / 2
    }

    /// Writes the values along a row of voxels that begins at `voxel`.
    pub(super) fn row(&self, voxel: [i64; 3], out: &mut [f32]) {
        dispatch!(Level::new(), simd => simd.vectorize(
            #[inline(always)]
            || self.write_row(voxel, out),
        ));
    }

    #[inline(always)]
    fn write_row(&self, voxel: [i64; 3], out: &mut [f32]) {
        let place = |a: usize, v: i64| {
            let last = self.dims[a] - 1;
            let p = ((v as f32 + 0.5) / self.cell[a] - 0.5 - self.first[a] as f32).clamp(0.0, last as f32);
            let low = (p as usize).min(last.saturating_sub(1));
            (low, p - low as f32)
        };
        let [nx, ny, nz] = self.dims;
        let ((y, ty), (z, tz)) = (place(1, voxel[1]), place(2, voxel[2]));
        let lines = [0, 1].map(|dz| [0, 1].map(|dy| nx * ((y + dy).min(ny - 1) + ny * (z + dz).min(nz - 1))));
        let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let line = |x: usize| {
            let [near, far] = lines.map(|l| mix(self.values[l[0] + x], self.values[l[1] + x], ty));
            mix(near, far, tz)
        };
        let last = (nx - 1) as f32;
        let begin = (voxel[0] as f32 + 0.5) / self.cell[0] - 0.5 - self.first[0] as f32;
        let mut from = 0;
        while from < out.len() {
            // All voxels between two cells' middles at once.
            let (x, _) = place(0, voxel[0] + from as i64);
            let until = if x + 2 < nx { self.middle(x + 1) - voxel[0] } else { i64::MAX };
            let until = until.clamp(from as i64 + 1, out.len() as i64) as usize;
            let (low, high) = (line(x), line((x + 1).min(nx - 1)));
            let first = from as i32;
            for (n, out) in (first..).zip(&mut out[from..until]) {
                let p = begin + n as f32 / self.cell[0];
                *out = mix(low, high, p.clamp(0.0, last) - x as f32);
            }
            from = until;
        }
    }
}

/// A table of Φ and of its derivative.
#[derive(Clone, Debug)]
pub(super) struct Phi(Vec<[f32; 2]>);

impl Phi {
    const REACH: f32 = 6.0;
    const PER_UNIT: f32 = 128.0;

    pub(super) fn new() -> Self {
        let steps = (2.0 * Self::REACH * Self::PER_UNIT) as usize;
        let at = |n: usize| {
            let x = n as f64 / f64::from(Self::PER_UNIT) - f64::from(Self::REACH);
            [normal::cdf(x) as f32, ((-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt()) as f32]
        };
        Self((0..=steps + 1).map(at).collect())
    }

    /// Returns Φ(x) and φ(x), to about 10⁻⁵.
    #[inline]
    pub(super) fn at(&self, x: f32) -> [f32; 2] {
        let x = (x.clamp(-Self::REACH, Self::REACH) + Self::REACH) * Self::PER_UNIT;
        let n = x as usize;
        let t = x - n as f32;
        let ([a, b], [c, d]) = (self.0[n], self.0[n + 1]);
        [a + (c - a) * t, b + (d - b) * t]
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::math::hash;

    fn block() -> Block {
        Block { first: [-2, 3, 0], dims: [9, 8, 7], margin: [1, 2, 1] }
    }

    #[test]
    fn a_blur_keeps_constants_and_spreads_a_point_by_its_standard_deviation() {
        let block = Block { first: [0; 3], dims: [41, 31, 21], margin: [0; 3] };
        let mut flat = vec![3.0f32; block.len()];
        block.blur(&mut flat, [2.0, 0.5, 1.3]);
        assert!(flat.iter().all(|v| (v - 3.0).abs() < 1e-4));
        let mut point = vec![0f32; block.len()];
        point[20 + 41 * (15 + 31 * 10)] = 1.0;
        let sigma = [2.0, 1.5, 1.2];
        block.blur(&mut point, sigma);
        assert!((point.iter().sum::<f32>() - 1.0).abs() < 1e-4);
        for a in 0..3 {
            let square: f64 = (0..point.len())
                .map(|n| f64::from(point[n]) * (block.voxel(n)[a] as f64 - [20.0, 15.0, 10.0][a]).powi(2))
                .sum();
            assert!((square.sqrt() / sigma[a] - 1.0).abs() < 0.03, "axis {a}: {}", square.sqrt());
        }
    }

    #[test]
    fn dilation_and_erosion_match_their_definition() {
        let block = block();
        let mut mask = Mask { block, rows: vec![0; 56] };
        let is_in = |n: usize| hash::bits(7, n as u64).is_multiple_of(9);
        (0..block.len()).filter(|&n| is_in(n)).for_each(|n| mask.set(n));
        let mut each = Vec::new();
        mask.each(|n| each.push(n));
        assert_eq!(each, (0..block.len()).filter(|&n| is_in(n)).collect::<Vec<_>>());
        let reach = [2, 1, 3];
        let within = |n: usize, m: usize| {
            let (a, b) = (block.voxel(n), block.voxel(m));
            (0..3).all(|i| a[i].abs_diff(b[i]) as usize <= reach[i])
        };
        let (wide, narrow) = (mask.dilated(reach), mask.eroded([1, 0, 0]));
        for n in 0..block.len() {
            assert_eq!(wide.has(n), (0..block.len()).any(|m| is_in(m) && within(n, m)), "{n}");
            let beside = |d: i64| {
                let x = block.voxel(n)[0] - block.first[0] + d;
                (0..9).contains(&x).then(|| is_in((n as i64 + d) as usize))
            };
            assert_eq!(narrow.has(n), [-1, 0, 1].iter().all(|&d| beside(d).unwrap_or(true)), "{n}");
        }
    }

    #[test]
    fn blocks_hold_the_values_of_the_scan_and_go_on_beyond_it() {
        let grid = Grid::new([40, 20, 9], DVec3::splat(1.5), DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let volume = Volume::new(grid.clone(), (0..grid.len()).map(|n| n as i16).collect());
        let bricks = Bricks::of(&grid);
        assert_eq!((bricks.cell, bricks.edges(), bricks.counts()), ([2; 3], [16, 8, 8], [3, 3, 2]));
        let mut seen = vec![0; grid.len()];
        for brick in 0..18 {
            let block = bricks.block(brick, [3, 1, 2]);
            let values = block.load(&volume);
            assert_eq!(values.len(), block.len());
            for (n, value) in values.iter().enumerate() {
                let v = block.voxel(n);
                let [i, j, k] = [0, 1, 2].map(|a| v[a].clamp(0, grid.dims()[a] as i64 - 1));
                assert_eq!(*value, f32::from(volume.get(i, j, k)));
            }
            block.each_own(|n, [i, j, k]| {
                assert_eq!((block.voxel(n), block.index([i, j, k])), ([i, j, k], n));
                seen[grid.index(i as usize, j as usize, k as usize)] += 1;
            });
            let mut mask = Mask { block, rows: vec![0; block.dims[1] * block.dims[2]] };
            (0..block.len()).filter(|n| n % 3 == brick % 3).for_each(|n| mask.set(n));
            let (mut own, mut of_mask) = (Vec::new(), Vec::new());
            block.each_own(|n, v| own.extend((n % 3 == brick % 3).then_some((n, v))));
            mask.each_own(|n, v| of_mask.push((n, v)));
            assert_eq!(of_mask, own);
        }
        assert!(seen.iter().all(|&s| s == 1), "each voxel is in one brick");
        assert_eq!(bricks.around(&[(7, 8, 15..17)], [0; 3]), [9, 10]);
        assert_eq!(bricks.around(&[(7, 8, 15..17)], [0, 1, 1]), [0, 1, 3, 4, 9, 10, 12, 13]);
        assert_eq!(bricks.around(&[(0, 0, 0..1), (19, 8, 39..40)], [5; 3]).len(), 1 + 2 * 2);
    }

    #[test]
    fn means_are_those_of_the_cells_and_the_usual_far_away() {
        let grid = Grid::new([60; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let bricks = Bricks::of(&grid);
        let sums: Vec<_> =
            (0..400).map(|n| ([n % 20, n / 20, 4], 27.0 * (100.0 + 10.0 * (n % 20) as f64), 27.0)).collect();
        let means = CellMeans::new(&bricks, &sums, 50.0, 1e-3);
        // In the middle of cell 10 along x, which is voxel 31, and a ramp beside it.
        let at = |means: &CellMeans, voxel: [i64; 3]| {
            let mut row = [0.0; 5];
            means.row([voxel[0] - 3, voxel[1], voxel[2]], &mut row);
            row[3]
        };
        assert!((at(&means, [31, 31, 13]) - 200.0).abs() < 1.0, "{}", at(&means, [31, 31, 13]));
        assert!((at(&means, [34, 31, 13]) - 210.0).abs() < 1.0);
        assert!((at(&means, [31, 31, 15]) - 200.0).abs() < 1.0);
        let none = CellMeans::new(&bricks, &[], 50.0, 1.0);
        assert_eq!(at(&none, [31, 31, 13]), 50.0);
    }

    #[test]
    fn the_table_of_phi_is_as_good_as_said() {
        let phi = Phi::new();
        for n in -700..=700 {
            let x = 0.01 * f64::from(n);
            let [p, d] = phi.at(x as f32);
            assert!((f64::from(p) - normal::cdf(x)).abs() < 1e-5, "{x}");
            let density = if x.abs() > 6.0 { 0.0 } else { (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt() };
            assert!((f64::from(d) - density).abs() < 1e-5, "{x}");
        }
    }
}
