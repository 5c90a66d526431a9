//! The solid voxels as bits, and the edges between voxels that the wall crosses.
//!
//! Positions are *grown* voxel coordinates: voxel coordinates plus one, so that a layer of air surrounds the volume. The vertices
//! of the mesh are the crossed edges, numbered plane by plane, row by row, along x, y, z. A vertex's number is the count of crossed
//! edges before it, which is found by counting bits, without a table of the volume's size.

use rayon::prelude::*;

use crate::fields::voxels::VoxelSet;
use crate::volume::{AIR_HU, Volume};

/// A bit for each grown voxel.
pub(super) struct Signs {
    /// Grown voxels along each axis.
    pub dims: [usize; 3],
    /// 64-bit words in a row.
    words: usize,
    bits: Vec<u64>,
}

impl Signs {
    /// Marks the voxels of at least `iso` HU as solid.
    pub(crate) fn new(volume: &Volume, iso: f64) -> Self {
        let [nx, ny, nz] = volume.grid().dims();
        let dims = [nx + 2, ny + 2, nz + 2];
        let words = dims[0].div_ceil(64);
        let least = iso.ceil().clamp(-32768.0, 32767.0) as i16;
        let solid_air = f64::from(AIR_HU) >= iso;
        let air = |n: usize| if solid_air { u64::MAX >> (64 - n) } else { 0 };
        let mut bits = vec![0u64; words * dims[1] * dims[2]];
        bits.par_chunks_mut(words).enumerate().for_each(|(row, bits)| {
            let (y, z) = (row % dims[1], row / dims[1]);
            for (w, b) in bits.iter_mut().enumerate() {
                *b = air((dims[0] - 64 * w).min(64));
            }
            if !(1..=ny).contains(&y) || !(1..=nz).contains(&z) {
                return;
            }
            let first = volume.grid().index(0, y - 1, z - 1);
            for (x, &v) in volume.data()[first..first + nx].iter().enumerate() {
                let (w, bit) = ((x + 1) / 64, (x + 1) % 64);
                bits[w] = bits[w] & !(1 << bit) | u64::from(v >= least) << bit;
            }
        });
        Self { dims, words, bits }
    }

    /// Marks the voxels of a set as solid, and nothing beyond its grid.
    pub(crate) fn of_set(set: &VoxelSet) -> Self {
        let [nx, ny, nz] = set.dims();
        let dims = [nx + 2, ny + 2, nz + 2];
        let words = dims[0].div_ceil(64);
        let mut bits = vec![0u64; words * dims[1] * dims[2]];
        bits.par_chunks_mut(words).enumerate().for_each(|(row, bits)| {
            let (y, z) = (row % dims[1], row / dims[1]);
            if !(1..=ny).contains(&y) || !(1..=nz).contains(&z) {
                return;
            }
            let from = set.row(y - 1, z - 1);
            for (w, b) in bits.iter_mut().enumerate() {
                let before = w.checked_sub(1).and_then(|w| from.get(w)).map_or(0, |f| f >> 63);
                *b = from.get(w).map_or(0, |f| f << 1) | before;
            }
        });
        Self { dims, words, bits }
    }

    /// Returns the number of words in a row.
    pub(crate) fn words(&self) -> usize {
        self.words
    }

    fn row(&self, y: usize, z: usize) -> &[u64] {
        let at = (y + self.dims[1] * z) * self.words;
        &self.bits[at..at + self.words]
    }

    /// Returns the bits of word `w` of a row, each moved down by one voxel.
    fn ahead(&self, y: usize, z: usize, w: usize) -> u64 {
        let row = self.row(y, z);
        row[w] >> 1 | row.get(w + 1).map_or(0, |next| next << 63)
    }

    /// Returns the bits of word `w` whose voxel has another one ahead along x.
    fn inner(&self, w: usize) -> u64 {
        let n = (self.dims[0] - 1).saturating_sub(64 * w);
        if n >= 64 { u64::MAX } else { (1 << n) - 1 }
    }

    /// Returns the edges along `axis` from the voxels of word `w` of row (`y`, `z`) that the wall crosses.
    pub(crate) fn crossed(&self, axis: usize, y: usize, z: usize, w: usize) -> u64 {
        let here = self.row(y, z)[w];
        match axis {
            0 => (here ^ self.ahead(y, z, w)) & self.inner(w),
            1 if y + 1 < self.dims[1] => here ^ self.row(y + 1, z)[w],
            2 if z + 1 < self.dims[2] => here ^ self.row(y, z + 1)[w],
            _ => 0,
        }
    }

    /// Returns the cells from the voxels of word `w` of row (`y`, `z`) whose corners are not all equal. `y` and `z`
    /// must have a next row.
    pub(crate) fn mixed(&self, y: usize, z: usize, w: usize) -> u64 {
        let rows = [(y, z), (y + 1, z), (y, z + 1), (y + 1, z + 1)];
        let (mut any, mut all) = (0, u64::MAX);
        for (y, z) in rows {
            let (here, ahead) = (self.row(y, z)[w], self.ahead(y, z, w));
            any |= here | ahead;
            all &= here & ahead;
        }
        any & !all & self.inner(w)
    }

    /// Returns the solid corners of the cell at a grown voxel, bit c for corner c.
    pub(crate) fn corners(&self, x: usize, y: usize, z: usize) -> u8 {
        let pair = |y: usize, z: usize| {
            let row = self.row(y, z);
            let bit = |x: usize| (row[x / 64] >> (x % 64) & 1) as u8;
            bit(x) | bit(x + 1) << 1
        };
        pair(y, z) | pair(y + 1, z) << 2 | pair(y, z + 1) << 4 | pair(y + 1, z + 1) << 6
    }
}

/// Words of a row between two kept counts. With a count for each, the counts would take half as much memory again as the bits.
const WORDS: usize = 8;

/// Numbers of the vertices: for each row and axis the number before its first, and for every eighth word the count of vertices
/// before it in the row.
pub(super) struct Numbers {
    /// Counts in a row.
    counts: usize,
    rows: Vec<u64>,
    before: Vec<u32>,
}

impl Numbers {
    /// Counts the crossed edges.
    pub(crate) fn new(signs: &Signs) -> Self {
        let words = signs.words();
        let rows = signs.dims[1] * signs.dims[2];
        let counts = words.div_ceil(WORDS);
        let mut before = vec![0u32; rows * 3 * counts];
        let mut totals = vec![0u64; rows * 3 + 1];
        before.par_chunks_mut(counts).zip(totals[1..].par_iter_mut()).enumerate().for_each(|(n, (before, total))| {
            let (axis, y, z) = (n % 3, n / 3 % signs.dims[1], n / 3 / signs.dims[1]);
            let mut count = 0;
            for w in 0..words {
                if w % WORDS == 0 {
                    before[w / WORDS] = count;
                }
                count += signs.crossed(axis, y, z, w).count_ones();
            }
            *total = u64::from(count);
        });
        for n in 1..totals.len() {
            totals[n] += totals[n - 1];
        }
        Self { counts, rows: totals, before }
    }

    /// Returns the number of vertices.
    pub(crate) fn total(&self) -> u64 {
        self.rows.last().copied().unwrap_or(0)
    }

    /// Returns the number of vertices before plane `z`.
    pub(crate) fn before_plane(&self, signs: &Signs, z: usize) -> usize {
        self.rows[3 * signs.dims[1] * z] as usize
    }

    /// Returns the number of the vertex on the crossed edge along `axis` from a grown voxel.
    pub(crate) fn of(&self, signs: &Signs, axis: usize, [x, y, z]: [usize; 3]) -> u32 {
        let row = 3 * (y + signs.dims[1] * z) + axis;
        let (w, bit) = (x / 64, x % 64);
        let kept = w / WORDS;
        let since: u32 = (kept * WORDS..w).map(|w| signs.crossed(axis, y, z, w).count_ones()).sum();
        let within = signs.crossed(axis, y, z, w) & ((1 << bit) - 1);
        self.rows[row] as u32 + self.before[row * self.counts + kept] + since + within.count_ones()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash;

    #[test]
    fn vertices_are_numbered_in_their_order_also_in_rows_of_many_words() {
        let dims = [1300, 4, 3];
        // Dense and sparse stretches, and an empty row.
        let is_in = |n: usize| {
            let share = if n % 1300 < 600 { 0.5 } else { 0.01 };
            n / 1300 != 5 && hash::uniform(n as u64, 1) < share
        };
        let signs = Signs::of_set(&VoxelSet::from_fn(dims, is_in).unwrap());
        let numbers = Numbers::new(&signs);
        let mut count = 0;
        for z in 0..signs.dims[2] {
            assert_eq!(numbers.before_plane(&signs, z), count as usize);
            for y in 0..signs.dims[1] {
                for axis in 0..3 {
                    for x in 0..signs.dims[0] {
                        if signs.crossed(axis, y, z, x / 64) >> (x % 64) & 1 == 1 {
                            assert_eq!(numbers.of(&signs, axis, [x, y, z]), count, "{axis} {x} {y} {z}");
                            count += 1;
                        }
                    }
                }
            }
        }
        assert!(count > 1000 && numbers.total() == u64::from(count));
    }
}
