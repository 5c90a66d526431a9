//! Sets of voxels, and of numbered voxels. Fields over the lumen store one value for each member.
//!
//! A set has one bit for each voxel of the grid, with rows padded to whole words. A numbered one also has the number of members before
//! each word. One look-up in each and a bit count give a member's number (a rank dictionary, Jacobson 1989). Rows beyond the first and
//! last members along y and z are not kept. A field therefore costs its values plus an eighth of a byte and half of that for each voxel
//! of the part of the grid that it lies in, never a value for each voxel.

use std::ops::Range;

use rayon::prelude::*;

/// Voxels of a grid.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VoxelBits {
    dims: [usize; 3],
    /// Words per row.
    words: usize,
    /// The rows that are kept: those between the first and the last members.
    js: Range<usize>,
    ks: Range<usize>,
    /// Their bits, and a row without members at the end, which stands for all others.
    bits: Vec<u64>,
}

/// Voxels of a grid, numbered in their order (x fastest).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VoxelSet {
    of: VoxelBits,
    /// Number of members before each word.
    ranks: Vec<u32>,
}

impl VoxelBits {
    /// Creates a set from runs (j, k, range of i) on a grid of `dims`. The runs are read twice, so that only the rows that are kept are
    /// ever held.
    pub fn from_runs(dims: [usize; 3], runs: impl Iterator<Item = (usize, usize, Range<usize>)> + Clone) -> Self {
        let [_, ny, nz] = dims;
        let (mut js, mut ks) = (ny..0, nz..0);
        for (j, k, _) in runs.clone().filter(|r| !r.2.is_empty()) {
            (js.start, js.end) = (js.start.min(j), js.end.max(j + 1));
            (ks.start, ks.end) = (ks.start.min(k), ks.end.max(k + 1));
        }
        let mut set = Self::without_members(dims, js, ks);
        for (j, k, r) in runs.filter(|r| !r.2.is_empty()) {
            let at = set.words * set.kept(j, k);
            fill(&mut set.bits[at..][..set.words], r);
        }
        set
    }

    /// Creates a set that keeps the given rows.
    fn without_members(dims: [usize; 3], js: Range<usize>, ks: Range<usize>) -> Self {
        let (js, ks) = if js.is_empty() { (0..0, 0..0) } else { (js, ks) };
        let words = dims[0].div_ceil(64);
        let bits = vec![0; words * (js.len() * ks.len() + 1)];
        Self { dims, words, js, ks, bits }
    }

    /// Creates a set of the voxels that `is_in` accepts, given as linear indices.
    pub fn from_fn(dims: [usize; 3], is_in: impl Fn(usize) -> bool) -> Self {
        let words = dims[0].div_ceil(64);
        let mut bits = vec![0u64; words * dims[1] * dims[2]];
        for (row, to) in bits.chunks_exact_mut(words).enumerate() {
            for i in 0..dims[0] {
                to[i / 64] |= u64::from(is_in(row * dims[0] + i)) << (i % 64);
            }
        }
        Self::of_grid(dims, &bits)
    }

    /// Creates a set from the bits of all rows.
    fn of_grid(dims: [usize; 3], bits: &[u64]) -> Self {
        let [_, ny, nz] = dims;
        let words = dims[0].div_ceil(64);
        let row = |j: usize, k: usize| &bits[words * (j + ny * k)..][..words];
        let (mut js, mut ks) = (ny..0, nz..0);
        for (k, j) in (0..nz).flat_map(|k| (0..ny).map(move |j| (k, j))) {
            if row(j, k).iter().any(|&w| w != 0) {
                (js.start, js.end) = (js.start.min(j), js.end.max(j + 1));
                (ks.start, ks.end) = (ks.start.min(k), k + 1);
            }
        }
        let mut set = Self::without_members(dims, js, ks);
        let own = words * set.js.len();
        for (n, k) in set.ks.clone().enumerate() {
            set.bits[own * n..own * (n + 1)].copy_from_slice(&bits[words * (set.js.start + ny * k)..][..own]);
        }
        set
    }

    /// Numbers the voxels. Returns `None` if there are more than 2³².
    pub fn numbered(self) -> Option<VoxelSet> {
        let mut ranks = Vec::with_capacity(self.bits.len());
        let mut count = 0u64;
        for w in &self.bits {
            ranks.push(u32::try_from(count).ok()?);
            count += u64::from(w.count_ones());
        }
        u32::try_from(count).ok()?;
        Some(VoxelSet { of: self, ranks })
    }

    /// Returns all voxels within `reach` voxels of a member along every axis (Chebyshev distance), limited to the grid.
    pub fn dilated(&self, reach: usize) -> Self {
        let [nx, ny, nz] = self.dims;
        let w = self.words;
        if self.js.is_empty() {
            return self.clone();
        }
        let wider = |r: &Range<usize>, count: usize| r.start.saturating_sub(reach)..(r.end + reach).min(count);
        let (js, ks) = (wider(&self.js, ny), wider(&self.ks, nz));
        let (own, count) = (w * self.js.len(), js.len());
        let near =
            |n: usize, count: usize| (n.saturating_sub(reach)..(n + reach + 1).min(count)).filter(move |&m| m != n);
        let unite = |to: &mut [u64], from: &[u64]| to.iter_mut().zip(from).for_each(|(t, f)| *t |= f);
        // Within each slice along x, then along y; then whole slices along z.
        let mut source = vec![0u64; w * count * ks.len()];
        source.par_chunks_exact_mut(w * count).enumerate().for_each(|(n, slice)| {
            let Some(k) = (n + ks.start).checked_sub(self.ks.start).filter(|&k| k < self.ks.len()) else { return };
            let first = w * (self.js.start - js.start);
            slice[first..first + own].copy_from_slice(&self.bits[own * k..own * (k + 1)]);
            slice.chunks_exact_mut(w).for_each(|row| dilate_row(row, reach, nx));
            let source = slice.to_vec();
            for (j, row) in slice.chunks_exact_mut(w).enumerate() {
                near(j, count).for_each(|m| unite(row, &source[m * w..][..w]));
            }
        });
        let mut bits = Vec::with_capacity(source.len() + w);
        bits.extend_from_slice(&source);
        bits.par_chunks_exact_mut(w * count).enumerate().for_each(|(k, slice)| {
            near(k, ks.len()).for_each(|m| unite(slice, &source[m * w * count..][..w * count]));
        });
        drop(source);
        bits.resize(bits.len() + w, 0);
        Self { dims: self.dims, words: w, js, ks, bits }
    }

    /// Returns the number of voxels along each axis of the grid.
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// Returns the number of members.
    pub fn count(&self) -> usize {
        self.bits.iter().map(|w| w.count_ones() as usize).sum()
    }

    /// Returns the bits of row (j, k).
    pub fn row(&self, j: usize, k: usize) -> &[u64] {
        &self.bits[self.words * self.kept(j, k)..][..self.words]
    }

    /// Returns which of the rows that are kept row (j, k) is.
    #[inline]
    fn kept(&self, j: usize, k: usize) -> usize {
        // A row before the first one wraps around, and is too large, too.
        let (j, k) = (j.wrapping_sub(self.js.start), k.wrapping_sub(self.ks.start));
        let is_kept = j < self.js.len() && k < self.ks.len();
        if is_kept { j + self.js.len() * k } else { self.js.len() * self.ks.len() }
    }

    /// True if a voxel is a member. Voxels outside the grid are not.
    #[inline]
    pub fn contains(&self, voxel: [i64; 3]) -> bool {
        self.word(voxel).is_some_and(|at| self.bits[at] >> (voxel[0] % 64) & 1 != 0)
    }

    /// Returns the word that has the bit of a voxel; `None` outside the grid.
    #[inline]
    fn word(&self, [i, j, k]: [i64; 3]) -> Option<usize> {
        let [nx, ny, nz] = self.dims;
        if (i as u64) >= nx as u64 || (j as u64) >= ny as u64 || (k as u64) >= nz as u64 {
            return None;
        }
        Some(self.words * self.kept(j as usize, k as usize) + i as usize / 64)
    }

    /// Returns the first voxel of a word.
    fn place(&self, at: usize) -> [usize; 3] {
        let (row, x) = (at / self.words, at % self.words * 64);
        // Without members there are no rows.
        let count = self.js.len().max(1);
        [x, row % count + self.js.start, row / count + self.ks.start]
    }
}

impl VoxelSet {
    /// Creates a set from runs (j, k, range of i) on a grid of `dims`. Returns `None` if there are more than 2³² voxels.
    pub fn from_runs(
        dims: [usize; 3],
        runs: impl Iterator<Item = (usize, usize, Range<usize>)> + Clone,
    ) -> Option<Self> {
        VoxelBits::from_runs(dims, runs).numbered()
    }

    /// Creates a set of the voxels that `is_in` accepts, given as linear indices. Returns `None` if there are more than 2³².
    pub fn from_fn(dims: [usize; 3], is_in: impl Fn(usize) -> bool) -> Option<Self> {
        VoxelBits::from_fn(dims, is_in).numbered()
    }

    /// Returns the members without their numbers.
    pub fn bits(&self) -> &VoxelBits {
        &self.of
    }

    /// Returns the number of voxels along each axis of the grid.
    pub fn dims(&self) -> [usize; 3] {
        self.of.dims
    }

    /// Returns the number of members.
    pub fn len(&self) -> usize {
        self.ranks.last().map_or(0, |&r| r as usize) + self.of.bits.last().map_or(0, |w| w.count_ones() as usize)
    }

    /// True if the set is empty.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the bits of row (j, k).
    pub fn row(&self, j: usize, k: usize) -> &[u64] {
        self.of.row(j, k)
    }

    /// Returns the number of the first member in row (j, k) or after it; the number of all members after the last row.
    pub fn row_start(&self, j: usize, k: usize) -> usize {
        // The first row that is kept from there on.
        let (j, k) = if j < self.of.js.end { (j.max(self.of.js.start), k) } else { (self.of.js.start, k + 1) };
        let (j, k) = if k < self.of.ks.start { (self.of.js.start, self.of.ks.start) } else { (j, k) };
        if k < self.of.ks.end { self.ranks[self.of.words * self.of.kept(j, k)] as usize } else { self.len() }
    }

    /// True if a voxel is a member. Voxels outside the grid are not.
    #[inline]
    pub fn contains(&self, voxel: [i64; 3]) -> bool {
        self.of.contains(voxel)
    }

    /// Returns a member's number.
    #[inline]
    pub fn number(&self, voxel: [i64; 3]) -> Option<usize> {
        let at = self.of.word(voxel)?;
        let (word, bit) = (self.of.bits[at], 1u64 << (voxel[0] % 64));
        (word & bit != 0).then(|| self.ranks[at] as usize + (word & (bit - 1)).count_ones() as usize)
    }

    /// Returns the member with a number below [`VoxelSet::len`].
    pub fn voxel(&self, number: usize) -> [i64; 3] {
        let at = self.ranks.partition_point(|&r| r as usize <= number) - 1;
        let mut word = self.of.bits[at];
        for _ in self.ranks[at] as usize..number {
            word &= word - 1;
        }
        let ([x, j, k], bit) = (self.of.place(at), word.trailing_zeros() as usize);
        [(x + bit) as i64, j as i64, k as i64]
    }

    /// Calls `visit(number, voxel)` for every member in order.
    pub fn for_each(&self, mut visit: impl FnMut(usize, [usize; 3])) {
        let mut number = 0;
        for (at, &word) in self.of.bits.iter().enumerate() {
            let [x, j, k] = self.of.place(at);
            each_bit(word, |b| {
                visit(number, [x + b, j, k]);
                number += 1;
            });
        }
    }

    /// Returns the size in memory, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.of.bits.as_slice()) + size_of_val(self.ranks.as_slice())
    }
}

/// Calls `visit` with the position of every set bit, ascending.
#[inline]
pub fn each_bit(mut word: u64, mut visit: impl FnMut(usize)) {
    while word != 0 {
        visit(word.trailing_zeros() as usize);
        word &= word - 1;
    }
}

/// Calls `visit` for every run of set bits in a row, ascending.
pub fn each_run(row: &[u64], mut visit: impl FnMut(Range<usize>)) {
    let mut start = None;
    for (n, &word) in row.iter().enumerate() {
        each_bit(word ^ (word << 1 | u64::from(start.is_some())), |b| {
            let x = 64 * n + b;
            match start.take() {
                None => start = Some(x),
                Some(s) => visit(s..x),
            }
        });
    }
    if let Some(s) = start {
        visit(s..64 * row.len());
    }
}

/// Adds to a row of `count` voxels those within `reach` of its members.
fn dilate_row(row: &mut [u64], reach: usize, count: usize) {
    for _ in 0..reach {
        let mut before = 0;
        for n in 0..row.len() {
            let here = row[n];
            let next = row.get(n + 1).copied().unwrap_or(0);
            row[n] = here | here << 1 | before >> 63 | here >> 1 | next << 63;
            before = here;
        }
    }
    // Padding bits are not voxels.
    if let (Some(last), 1..) = (row.last_mut(), count % 64) {
        *last &= (1 << (count % 64)) - 1;
    }
}

/// Sets a range of bits.
fn fill(row: &mut [u64], r: Range<usize>) {
    let words = r.start / 64..r.end.div_ceil(64);
    for (word, n) in row[words.clone()].iter_mut().zip(words) {
        let (lo, hi) = (r.start.saturating_sub(64 * n), (r.end - 64 * n).min(64));
        let upto = if hi == 64 { u64::MAX } else { (1 << hi) - 1 };
        *word |= upto & (u64::MAX << lo);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::uniform;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        /// Compares numbers, runs and dilation with a plain list of flags.
        #[test]
        fn is_a_list_of_flags(
            nx in prop::sample::select(vec![1usize, 3, 63, 64, 65, 130]), ny in 1usize..6, nz in 1usize..6,
            seed: u64, share in 0.0f64..1.0, reach in 0usize..3, margin in prop::array::uniform2(0usize..4),
        ) {
            let dims = [nx, ny, nz];
            // Rows before and after those of the members are not kept.
            let is_amid = |n: usize| {
                let (j, k) = (n / nx % ny, n / nx / ny);
                j >= margin[0] && j + margin[1] < ny && k >= margin[1] && k + margin[0] < nz
            };
            let flags: Vec<bool> =
                (0..nx * ny * nz).map(|n| is_amid(n) && uniform(seed, n as u64) < share).collect();
            let set = VoxelSet::from_fn(dims, |n| flags[n]).unwrap();
            let at = |n: usize| [(n % nx) as i64, (n / nx % ny) as i64, (n / nx / ny) as i64];
            let members: Vec<usize> = (0..flags.len()).filter(|&n| flags[n]).collect();
            prop_assert_eq!(set.len(), members.len());
            let mut seen = Vec::new();
            set.for_each(|number, v| seen.push((number, v[0] + nx * (v[1] + ny * v[2]))));
            prop_assert_eq!(&seen, &members.iter().copied().enumerate().collect::<Vec<_>>());
            for (number, &n) in members.iter().enumerate() {
                prop_assert_eq!(set.number(at(n)), Some(number));
                prop_assert_eq!(set.voxel(number), at(n));
            }
            let mut runs = Vec::new();
            for (j, k) in (0..nz).flat_map(|k| (0..ny).map(move |j| (j, k))) {
                prop_assert_eq!(set.row_start(j, k), members.partition_point(|&n| n < nx * (j + ny * k)));
                each_run(set.row(j, k), |r| runs.push((j, k, r)));
            }
            prop_assert_eq!(&VoxelSet::from_runs(dims, runs.into_iter()).unwrap(), &set);
            prop_assert_eq!(set.bits().count(), members.len());
            let wide = set.bits().dilated(reach);
            let r = reach as i64;
            for n in 0..flags.len() {
                let [i, j, k] = at(n);
                let near = members.iter().any(|&m| {
                    let [a, b, c] = at(m);
                    (a - i).abs() <= r && (b - j).abs() <= r && (c - k).abs() <= r
                });
                prop_assert_eq!(wide.contains([i, j, k]), near);
            }
            prop_assert!(!set.contains([-1, 0, 0]) && !set.contains([nx as i64, 0, 0]));
        }
    }
}
