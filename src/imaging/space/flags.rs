//! The homogeneous-region flag (the paper's section 2.2): one bit per voxel, and a coarse level of bricks for leaping.
//!
//! A voxel's flag is set when its 3×3×3 neighbourhood, with air outside the volume, is entirely in one class: *empty* (≤ the wall's
//! `lo`) or *opaque* (≥ its `hi`). The voxel's own value shows which. The flags take 1/16 of the 16-bit volume.
//!
//! Rays see the volume grown by one voxel of air, since a trilinear cell at the border still mixes voxels with air.
//! Bricks therefore hold 8×8×8 *cells*, starting with cell −1 of each axis. A brick is empty when every voxel that one
//! of its cells touches is flagged empty. Then all voxels within two of any point in it are empty, which is enough for
//! both trilinear values and regressions over 3×3×3 neighbourhoods.
//!
//! These bricks of 8³ serve single rays, which check the voxel's own flag between them. Packets have separate bricks of 4³
//! (`render::packets`), since sixteen rays at once can afford neither the wider margin nor a check of single voxels.

use std::sync::OnceLock;

use rayon::prelude::*;

use crate::volume::{AIR_HU, Volume};

use super::transfer::TransferFunction;

/// Cells along a brick's edge, as a power of two.
pub(crate) const BRICK_SHIFT: u32 = 3;
/// Slices flagged by one task, which also reads one more on either side.
const SLAB: usize = 16;

/// Homogeneous-region flags and empty bricks of a volume.
#[derive(Clone, Debug)]
pub struct Flags {
    dims: [usize; 3],
    /// 64-bit words in a row of flags.
    words: usize,
    /// True if there is to be a bit per voxel.
    has_bits: bool,
    /// One bit per voxel, once [`Flags::fill`] was called.
    bits: OnceLock<Vec<u64>>,
    classes: Classes,
    bricks: [usize; 3],
    empty: Vec<bool>,
}

/// The values that are empty (`≤ lo`) and opaque (`≥ hi`), as whole HU.
#[derive(Clone, Copy, Debug)]
struct Classes {
    lo: i16,
    hi: i16,
}

impl Flags {
    /// Computes the flags of `volume` for the classes of `wall`, in parallel.
    pub fn new(volume: &Volume, wall: TransferFunction) -> Self {
        let flags = Self::deferred(volume, wall);
        flags.fill(volume);
        flags
    }

    /// Computes the bricks, and leaves the bits to [`Flags::fill`]: only renderers that cast single rays look at them, and many
    /// flights draw nothing.
    pub(crate) fn deferred(volume: &Volume, wall: TransferFunction) -> Self {
        Self { has_bits: true, ..Self::bricks_only(volume, wall) }
    }

    /// Computes the bits if there are to be some and they are missing. `volume` must be the one that was flagged.
    pub(crate) fn fill(&self, volume: &Volume) {
        if !self.has_bits || self.bits.get().is_some() {
            return;
        }
        let plane = self.words * self.dims[1];
        let mut bits = vec![0u64; plane * self.dims[2]];
        bits.par_chunks_mut(plane * SLAB).enumerate().for_each(|(n, slab)| {
            flag_slab(volume, self.classes, n * SLAB, self.words, slab);
        });
        // Not within the lock: while the pass waits for its threads, this one may take over work that fills the same flags.
        _ = self.bits.set(bits);
    }

    /// Computes the same bricks without the bits: 1/512 byte per voxel instead of 1/8. At no time does it hold more
    /// than a few layers of bits. [`Flags::homogeneous`] then reads the voxels themselves.
    pub fn bricks_only(volume: &Volume, wall: TransferFunction) -> Self {
        let mut flags = Self::unfilled(volume, wall);
        let [bx, by, bz] = flags.bricks;
        let plane = flags.words * flags.dims[1];
        let mut empty = vec![false; bx * by * bz];
        empty.par_chunks_mut(bx * by).enumerate().for_each(|(b, layer)| {
            let slices = voxels_of(b, flags.dims[2]);
            let mut bits = vec![0u64; plane * slices.len()];
            flag_slab(volume, flags.classes, slices.start, flags.words, &mut bits);
            let mut all = vec![0; flags.words];
            for (n, row) in layer.chunks_mut(bx).enumerate() {
                flags.empty_bricks(volume, (&bits, slices.start), [n, b], &mut all, row);
            }
        });
        flags.empty = empty;
        flags
    }

    /// Creates flags with nothing filled in yet.
    fn unfilled(volume: &Volume, wall: TransferFunction) -> Self {
        // `TransferFunction` keeps its bounds within ±32767, so both rounded values fit.
        let classes = Classes { lo: wall.lo().floor() as i16, hi: wall.hi().ceil() as i16 };
        let dims = volume.grid().dims();
        let bricks = dims.map(|n| (n + 1).div_ceil(1 << BRICK_SHIFT));
        let (words, bits) = (dims[0].div_ceil(64), OnceLock::new());
        Self { dims, words, has_bits: false, bits, classes, bricks, empty: Vec::new() }
    }

    /// Returns true if there is a bit for each voxel, or will be once a renderer looks at it.
    pub fn has_bits(&self) -> bool {
        self.has_bits
    }

    /// Returns true if the neighbourhood of voxel (`i`, `j`, `k`) is entirely in one class. `volume` must be the one
    /// that was flagged.
    #[inline]
    pub fn homogeneous(&self, volume: &Volume, i: usize, j: usize, k: usize) -> bool {
        match self.bits.get() {
            Some(bits) => bits[(k * self.dims[1] + j) * self.words + i / 64] >> (i % 64) & 1 != 0,
            None => self.look(volume, [i, j, k].map(|c| c as i64)),
        }
    }

    /// Computes [`Flags::homogeneous`] from the voxels.
    fn look(&self, volume: &Volume, [i, j, k]: [i64; 3]) -> bool {
        let Classes { lo, hi } = self.classes;
        let around = |test: &dyn Fn(i16) -> bool| {
            (-1..=1).all(|z| (-1..=1).all(|y| (-1..=1).all(|x| test(volume.get(i + x, j + y, k + z)))))
        };
        around(&|v| v <= lo) || around(&|v| v >= hi)
    }

    /// Returns the greatest voxel value that is empty, HU.
    #[inline]
    pub fn empty_up_to(&self) -> i16 {
        self.classes.lo
    }

    /// Returns true if brick `n` of the list (x fastest) is empty or does not exist. Brick `b` of an axis holds cells
    /// `8b − 1` to `8b + 6`.
    #[inline]
    pub fn empty_brick(&self, n: isize) -> bool {
        self.empty.get(n as usize).is_none_or(|&e| e)
    }

    /// Returns the number of bricks along each axis.
    pub fn bricks(&self) -> [usize; 3] {
        self.bricks
    }

    /// Returns the memory of all flags, bytes.
    pub fn bytes(&self) -> usize {
        self.bits.get().map_or(0, |bits| size_of_val(bits.as_slice())) + size_of_val(self.empty.as_slice())
    }

    /// Finds the empty bricks of a whole row at once.
    ///
    /// `by` and `bz` are the row's indices along y and z, `bits` starts at slice `first`, and `all` is working memory
    /// for a row of flags.
    fn empty_bricks(
        &self,
        volume: &Volume,
        (bits, first): (&[u64], usize),
        [by, bz]: [usize; 2],
        all: &mut [u64],
        row: &mut [bool],
    ) {
        let (y, z) = (voxels_of(by, self.dims[1]), voxels_of(bz, self.dims[2]));
        all.fill(u64::MAX);
        for k in z.clone() {
            for j in y.clone() {
                let at = ((k - first) * self.dims[1] + j) * self.words;
                for (all, word) in all.iter_mut().zip(&bits[at..at + self.words]) {
                    *all &= word;
                }
            }
        }
        for (b, empty) in row.iter_mut().enumerate() {
            let mut x = voxels_of(b, self.dims[0]);
            let first = x.start;
            // Neighbouring flagged voxels share voxels, so the whole brick is of one class and any voxel shows which.
            *empty = x.all(|i| all[i / 64] >> (i % 64) & 1 != 0)
                && volume.data()[volume.grid().index(first, y.start, z.start)] <= self.classes.lo;
        }
    }
}

/// Returns the voxels that the cells of brick `b` touch along an axis: 8b − 1 to 8b + 7, clipped to the volume.
fn voxels_of(b: usize, n: usize) -> std::ops::Range<usize> {
    let first = b << BRICK_SHIFT;
    first.saturating_sub(1)..(first + (1 << BRICK_SHIFT)).min(n)
}

/// The masks of one slice, one for each class, and-ed over each voxel's 3×3 neighbours in the slice.
struct Slice {
    empty: Vec<u64>,
    opaque: Vec<u64>,
}

/// Flags the slices from `first` on, as many as `out` holds.
fn flag_slab(volume: &Volume, classes: Classes, first: usize, words: usize, out: &mut [u64]) {
    let [_, ny, nz] = volume.grid().dims();
    let plane = words * ny;
    let mut ring = [(); 3].map(|()| Slice { empty: vec![0; plane], opaque: vec![0; plane] });
    let mut rows = [vec![0u64; plane], vec![0u64; plane]];
    let mut load = |z: usize, slice: &mut Slice| {
        // `z` counts from one below the first slice, so the air below has index 0.
        if (1..=nz).contains(&z) {
            slice_masks(volume, classes, z - 1, words, &mut rows, slice);
        } else {
            slice.empty.fill(if AIR_HU <= classes.lo { u64::MAX } else { 0 });
            slice.opaque.fill(if AIR_HU >= classes.hi { u64::MAX } else { 0 });
        }
    };
    load(first, &mut ring[0]);
    load(first + 1, &mut ring[1]);
    for (n, out) in out.chunks_mut(plane).enumerate() {
        load(first + n + 2, &mut ring[(n + 2) % 3]);
        let [a, b, c] = &ring;
        for (w, out) in out.iter_mut().enumerate() {
            *out = (a.empty[w] & b.empty[w] & c.empty[w]) | (a.opaque[w] & b.opaque[w] & c.opaque[w]);
        }
    }
}

/// Computes the class masks of slice `k`, and-ed over x and then over y.
fn slice_masks(volume: &Volume, c: Classes, k: usize, words: usize, rows: &mut [Vec<u64>; 2], out: &mut Slice) {
    let [nx, ny, _] = volume.grid().dims();
    let data = &volume.data()[nx * ny * k..nx * ny * (k + 1)];
    let [empty, opaque] = rows;
    let air = [AIR_HU <= c.lo, AIR_HU >= c.hi];
    let per_row = data.chunks_exact(nx).zip(empty.chunks_exact_mut(words)).zip(opaque.chunks_exact_mut(words));
    for ((row, empty), opaque) in per_row {
        for ((values, e), o) in row.chunks(64).zip(empty.iter_mut()).zip(opaque.iter_mut()) {
            *e = mask(values, |v| v <= c.lo);
            *o = mask(values, |v| v >= c.hi);
        }
        and_along_row(empty, nx, air[0]);
        and_along_row(opaque, nx, air[1]);
    }
    for (rows, out, air) in [(&*empty, &mut out.empty, air[0]), (&*opaque, &mut out.opaque, air[1])] {
        let outside = if air { u64::MAX } else { 0 };
        for j in 0..ny {
            for w in 0..words {
                let below = if j > 0 { rows[(j - 1) * words + w] } else { outside };
                let above = if j + 1 < ny { rows[(j + 1) * words + w] } else { outside };
                out[j * words + w] = below & rows[j * words + w] & above;
            }
        }
    }
}

/// Writes a bit for each value of a row, set if the value is above `lo`. Words beyond the row become 0.
pub(crate) fn above(row: &[i16], lo: i16, words: &mut [u64]) {
    words.fill(0);
    for (values, word) in row.chunks(64).zip(words) {
        *word = mask(values, |v| v > lo);
    }
}

/// Returns a bit for each of up to 64 values.
#[inline(always)]
fn mask(values: &[i16], test: impl Fn(i16) -> bool) -> u64 {
    let Some(values) = values.first_chunk::<64>() else {
        return values.iter().enumerate().fold(0, |word, (n, &v)| word | u64::from(test(v)) << n);
    };
    // Eight values at a time, with the tests of the k-th eight in bits k. This uses whole vectors, transposed once at the end.
    let mut eights = [0u16; 8];
    for k in 0..8 {
        for i in 0..8 {
            eights[i] |= if test(values[8 * k + i]) { 1 << k } else { 0 };
        }
    }
    transpose(u64::from_le_bytes(eights.map(|e| e as u8)))
}

/// Transposes an 8×8 matrix of bits (Warren, Hacker's Delight, section 7-3): bit `8i + k` moves to `8k + i`.
fn transpose(mut x: u64) -> u64 {
    for (shift, half) in [(7, 0x00AA_00AA_00AA_00AA), (14, 0x0000_CCCC_0000_CCCC), (28, 0x0000_0000_F0F0_F0F0)] {
        let swapped = (x ^ (x >> shift)) & half;
        x ^= swapped ^ (swapped << shift);
    }
    x
}

/// Replaces each bit with the and of itself and its two neighbours in a row of `n` bits. `outside` is the class bit of air.
fn and_along_row(row: &mut [u64], n: usize, outside: bool) {
    let last = row.len() - 1;
    let tail = (n - 1) % 64 + 1;
    if outside && tail < 64 {
        row[last] |= u64::MAX << tail;
    }
    let mut left = u64::from(outside);
    for w in 0..=last {
        let here = row[w];
        let right = if w < last { row[w + 1] & 1 } else { u64::from(outside) };
        row[w] = here & (here << 1 | left) & (here >> 1 | right << 63);
        left = here >> 63;
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};
    use proptest::prelude::*;

    use super::*;
    use crate::math::hash;
    use crate::volume::Grid;

    fn volume(dims: [usize; 3], f: impl Fn(usize) -> i16) -> Volume {
        let grid = Grid::new(dims, DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let data = (0..grid.len()).map(f).collect();
        Volume::new(grid, data)
    }

    fn naive(v: &Volume, wall: TransferFunction, i: usize, j: usize, k: usize) -> bool {
        let mut around = Vec::new();
        for z in -1..=1 {
            for y in -1..=1 {
                for x in -1..=1 {
                    around.push(f32::from(v.get(i as i64 + x, j as i64 + y, k as i64 + z)));
                }
            }
        }
        around.iter().all(|&h| h <= wall.lo()) || around.iter().all(|&h| h >= wall.hi())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn flags_are_what_they_say(
            nx in 1usize..140, ny in 1usize..14, nz in 1usize..40, seed: u64, share in 0.0..0.03f64,
            wall in prop_oneof![Just((-800.0, -500.0)), Just((-2000.0, -1100.0)), Just((-1100.0, -500.0))],
        ) {
            let wall = TransferFunction::new(wall.0, wall.1).unwrap();
            let inside = if hash::uniform(seed, u64::MAX) < 0.5 { -1000 } else { 40 };
            let v = volume([nx, ny, nz], |n| {
                if hash::uniform(seed, n as u64) < share { -650 } else { inside }
            });
            let flags = Flags::new(&v, wall);
            let bare = Flags::bricks_only(&v, wall);
            let deferred = Flags::deferred(&v, wall);
            prop_assert!(!bare.has_bits() && bare.empty == flags.empty && deferred.empty == flags.empty);
            prop_assert!(deferred.has_bits() && deferred.bytes() == bare.bytes());
            for k in 0..nz { for j in 0..ny { for i in 0..nx {
                prop_assert_eq!(flags.homogeneous(&v, i, j, k), naive(&v, wall, i, j, k), "{} {} {}", i, j, k);
                prop_assert_eq!(bare.homogeneous(&v, i, j, k), flags.homogeneous(&v, i, j, k));
                prop_assert_eq!(deferred.homogeneous(&v, i, j, k), flags.homogeneous(&v, i, j, k));
            }}}
            deferred.fill(&v);
            prop_assert_eq!(deferred.bits.get(), flags.bits.get());
            bare.fill(&v);
            prop_assert!(bare.bits.get().is_none());
            for n in 0..flags.empty.len() {
                let [bx, by, _] = flags.bricks;
                let b = [n % bx, n / bx % by, n / bx / by];
                let mut around = (0..729).map(|m| {
                    let at = |a: usize, o: usize| (8 * b[a] + o).checked_sub(1).filter(|&c| c < [nx, ny, nz][a]);
                    match (at(0, m % 9), at(1, m / 9 % 9), at(2, m / 81)) {
                        (Some(i), Some(j), Some(k)) => {
                            flags.homogeneous(&v, i, j, k) && f32::from(v.get(i as i64, j as i64, k as i64)) <= wall.lo()
                        }
                        _ => true,
                    }
                });
                prop_assert_eq!(flags.empty_brick(n as isize), around.all(|e| e));
                if flags.empty_brick(n as isize) {
                    for k in -2..=8 { for j in -2..=8 { for i in -2..=8 {
                        let at = |a: usize, o: i64| (8 * b[a]) as i64 + o;
                        prop_assert!(f32::from(v.get(at(0, i), at(1, j), at(2, k))) <= wall.lo());
                    }}}
                }
            }
        }
    }

    #[test]
    fn memory_is_an_eighth_of_the_volume_at_most() {
        for nx in [64, 65, 100, 128, 512] {
            let v = volume([nx, 64, 64], |_| -1000);
            let flags = Flags::new(&v, TransferFunction::default());
            assert!(flags.bytes() * 8 <= v.bytes(), "{nx}");
            assert!(flags.empty.iter().all(|&e| e));
        }
    }
}
