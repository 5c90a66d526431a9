//! The occupancy of cells, which shows where something may be visible: a bit for each cell, in bricks of 4×4×4 cells,
//! and each brick's distance to the next brick in which a bit is set.
//!
//! Cells are counted from the border of the volume grown by a voxel of air, as in [`march`](crate::render::march): cell
//! g of an axis is between the voxels g − 1 and g, so that n voxels have n + 1 cells. A cell's bit is set if the voxel
//! at one of its eight corners is above the ramp's foot. If it is not set, every trilinear value in the cell is empty.
//!
//! The distance is the chessboard distance in bricks ([`chessboard`]). All bricks nearer than that are empty, so rays
//! may leap to where they leave their cube. The bits take 1/16 of the 16-bit volume, the distances 1/128.
//!
//! Rays go in all directions, so a cache line holds a cube: the bits of 2×2×2 bricks, or the distances of 4×4×4.
//!
//! The homogeneous-region [`flags`](crate::render::flags) cannot be used here. They describe a voxel's 3³ neighbours,
//! in rows, while sixteen rays need single cells, in cubes, and a distance to leap by.

use rayon::prelude::*;

use crate::render::leap::chessboard::{FAR, Outside, chessboard};
use crate::space::TransferFunction;
use crate::space::flags::above;
use crate::volume::{AIR_HU, Volume};

/// Cells along a brick's edge, as a power of two.
pub(crate) const BRICK_SHIFT: u32 = 2;
/// Layers of bricks that one task fills.
const SLAB: usize = 4;

/// The entries of the bricks of a cube, in one cache line. The cube's side is a power of two.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Line<T, const N: usize>([T; N]);

/// Positions of bricks in a list of [`Line`]s, each a cube of `1 << SHIFT` bricks a side.
#[derive(Clone, Copy, Debug)]
struct Lines<const SHIFT: u32> {
    /// Lines along x, and in a layer.
    row: usize,
    layer: usize,
}

impl<const SHIFT: u32> Lines<SHIFT> {
    /// Returns the layout for this many bricks along each axis, and its number of layers.
    fn new(bricks: [usize; 3]) -> (Self, usize) {
        let [x, y, z] = bricks.map(|n| n.div_ceil(1 << SHIFT));
        (Self { row: x, layer: x * y }, z)
    }

    /// Returns the line of a brick, and its index there.
    #[inline(always)]
    fn at(self, [x, y, z]: [usize; 3]) -> (usize, usize) {
        let within = |c: usize| c & ((1 << SHIFT) - 1);
        let line = (x >> SHIFT) + self.row * (y >> SHIFT) + self.layer * (z >> SHIFT);
        (line, within(x) | within(y) << SHIFT | within(z) << (2 * SHIFT))
    }

    /// Returns the first brick of a line.
    fn first(self, line: usize) -> [usize; 3] {
        [line % self.row, line % self.layer / self.row, line / self.layer].map(|c| c << SHIFT)
    }
}

/// The bits of all cells, and the distances of all bricks.
#[derive(Clone, Debug)]
pub(crate) struct Occupancy {
    /// Bricks along each axis.
    bricks: [usize; 3],
    /// Bit `x + 4·y + 16·z` of a brick is that of its cell (x, y, z).
    bits: Vec<Line<u64, 8>>,
    bit_lines: Lines<1>,
    /// Chessboard distance to the next brick with a bit set, bricks; 0 in such a brick.
    distance: Vec<Line<u8, 64>>,
    distance_lines: Lines<2>,
}

impl Occupancy {
    /// Finds the cells of `volume` with a corner above `wall`'s foot. Runs in parallel, in time linear in the voxels.
    pub(crate) fn new(volume: &Volume, wall: TransferFunction) -> Self {
        let lo = wall.lo().floor() as i16;
        let dims = volume.grid().dims();
        let bricks = dims.map(|n| (n + 1).div_ceil(1 << BRICK_SHIFT));
        let (bit_lines, layers) = Lines::new(bricks);
        // By all threads, since the first touch of fresh memory has to wait for it.
        let mut bits: Vec<_> = (0..bit_lines.layer * layers).into_par_iter().map(|_| Line([0u64; 8])).collect();
        bits.par_chunks_mut(bit_lines.layer * SLAB / 2).enumerate().for_each(|(n, out)| {
            Slab::new(volume, lo, bricks).fill(n * SLAB, out, bit_lines);
        });
        let [nx, ny, nz] = bricks;
        // Row by row, as the transform needs them.
        let mut rows = vec![0; nx * ny * nz];
        rows.par_chunks_mut(nx).enumerate().for_each(|(n, row)| {
            for (x, to) in row.iter_mut().enumerate() {
                let (line, at) = bit_lines.at([x, n % ny, n / ny]);
                *to = if bits[line].0[at] == 0 { FAR } else { 0 };
            }
        });
        chessboard(&mut rows, bricks, Outside::Unmarked);
        let (distance_lines, layers) = Lines::<2>::new(bricks);
        let line_of = |n: usize| {
            let [x, y, z] = distance_lines.first(n);
            let mut line = Line([0; 64]);
            for (n, four) in line.0.chunks_exact_mut(4).enumerate() {
                let (y, z) = (y + (n & 3), z + (n >> 2));
                if y < ny && z < nz {
                    let row = &rows[nx * (y + ny * z)..][..nx];
                    for (to, d) in four.iter_mut().zip(&row[x..]) {
                        *to = *d;
                    }
                }
            }
            line
        };
        let distance = (0..distance_lines.layer * layers).into_par_iter().map(line_of).collect();
        Self { bricks, bits, bit_lines, distance, distance_lines }
    }

    /// Returns the number of bricks along each axis.
    pub(crate) fn bricks(&self) -> [usize; 3] {
        self.bricks
    }

    /// Returns the bits of all bricks: cubes of 2×2×2 bricks. Cubes, and bricks within a cube, are ordered with x fastest.
    pub(crate) fn bit_cubes(&self) -> &[Line<u64, 8>] {
        &self.bits
    }

    /// Returns the distances of all bricks: cubes of 4×4×4 bricks. Cubes, and bricks within a cube, are ordered with x fastest.
    pub(crate) fn distance_cubes(&self) -> &[Line<u8, 64>] {
        &self.distance
    }

    /// Returns the bits of the brick `b`.
    #[inline(always)]
    pub(crate) fn bits(&self, b: [usize; 3]) -> u64 {
        let (line, n) = self.bit_lines.at(b);
        self.bits.get(line).map_or(u64::MAX, |l| l.0[n & 7])
    }

    /// True if a bit is set between the cells `first` and `last`, both included. Both must be within the bricks.
    #[inline(always)]
    pub(crate) fn any(&self, first: [i32; 3], last: [i32; 3]) -> bool {
        // Along each axis: the bricks, and the cells within one of them, as the bits that a whole brick has there.
        let bricks = |a: usize| first[a] >> BRICK_SHIFT..=last[a] >> BRICK_SHIFT;
        let cells = |a: usize, brick: i32| {
            let (from, until) = ((first[a] - 4 * brick).max(0) as u32, (last[a] - 4 * brick).min(3) as u32);
            let bits = [1, 4, 16][a];
            (u64::MAX << (bits * from)) & (u64::MAX >> (64 - bits * (until + 1)))
        };
        for z in bricks(2) {
            let slices = cells(2, z);
            for y in bricks(1) {
                let rows = (cells(1, y) & 0xffff) * 0x0001_0001_0001_0001;
                for x in bricks(0) {
                    let columns = (cells(0, x) & 15) * 0x1111_1111_1111_1111;
                    if self.bits([x as usize, y as usize, z as usize]) & slices & rows & columns != 0 {
                        return true;
                    }
                }
            }
        }
        false
    }

    /// Returns the distance of the brick `b`, bricks.
    #[inline(always)]
    pub(crate) fn distance(&self, b: [i32; 3]) -> u8 {
        let (line, n) = self.distance_lines.at(b.map(|c| c as usize));
        self.distance.get(line).map_or(0, |l| l.0[n & 63])
    }

    /// Returns the least distance of the bricks from `first` to `last`, both included, bricks.
    #[inline(always)]
    pub(crate) fn nearest(&self, first: [i32; 3], last: [i32; 3]) -> u8 {
        let mut least = FAR;
        for z in first[2]..=last[2] {
            for y in first[1]..=last[1] {
                for x in first[0]..=last[0] {
                    least = least.min(self.distance([x, y, z]));
                }
            }
        }
        least
    }

    /// Returns the memory taken, bytes.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.bits.as_slice()) + size_of_val(self.distance.as_slice())
    }
}

/// Computes the bits of some layers of bricks.
struct Slab<'a> {
    volume: &'a Volume,
    lo: i16,
    bricks: [usize; 3],
    /// 64-bit words in a row of cells.
    words: usize,
}

impl<'a> Slab<'a> {
    fn new(volume: &'a Volume, lo: i16, bricks: [usize; 3]) -> Self {
        Self { volume, lo, bricks, words: (bricks[0] << BRICK_SHIFT).div_ceil(64) }
    }

    /// Fills as many layers of bricks, from `first` on, as `out` has room for.
    fn fill(&self, first: usize, out: &mut [Line<u64, 8>], lines: Lines<1>) {
        let [nx, ny, nz] = self.volume.grid().dims();
        let rows = self.bricks[1] << BRICK_SHIFT;
        let plane = rows * self.words;
        // Two slices of voxels are or-ed into a layer of cells.
        let mut ring = vec![vec![0u64; plane]; 2];
        let mut raw = vec![0u64; self.words * (ny + 2)];
        // The bits of everything outside the volume.
        let air = if AIR_HU > self.lo { u64::MAX } else { 0 };
        let mut slice = |k: isize, to: &mut Vec<u64>| {
            // A row of air before, and one after.
            if (0..nz as isize).contains(&k) {
                let data = &self.volume.data()[nx * ny * k as usize..nx * ny * (k as usize + 1)];
                raw.fill(0);
                let mut scratch = vec![0u64; self.words];
                for (row, to) in data.chunks_exact(nx).zip(raw[self.words..].chunks_exact_mut(self.words)) {
                    above(row, self.lo, &mut scratch);
                    spread(&scratch, to);
                }
                if AIR_HU > self.lo {
                    self.close(&mut raw, nx, ny);
                }
                for (j, to) in to.chunks_exact_mut(self.words).enumerate() {
                    for (w, to) in to.iter_mut().enumerate() {
                        let at = |r: usize| raw.get((j + r) * self.words + w).copied().unwrap_or(air);
                        *to = at(0) | at(1);
                    }
                }
            } else {
                to.fill(air);
            }
        };
        let z0 = (first << BRICK_SHIFT) as isize;
        slice(z0 - 1, &mut ring[0]);
        for b in 0..(2 * out.len() / lines.layer).min(self.bricks[2] - first) {
            for z in 0..4 {
                let n = 4 * b + z;
                slice(z0 + n as isize, &mut ring[(n + 1) % 2]);
                for y in 0..rows {
                    let shift = 16 * z + 4 * (y & 3);
                    let (line, first) = lines.at([0, y >> 2, b]);
                    let row = &mut out[line..line + lines.row];
                    for w in 0..self.words {
                        let at = y * self.words + w;
                        let word = ring[0][at] | ring[1][at];
                        if word == 0 {
                            continue;
                        }
                        for (n, line) in row.iter_mut().skip(8 * w).take(8).enumerate() {
                            line.0[first] |= (word >> (8 * n) & 15) << shift;
                            line.0[first | 1] |= (word >> (8 * n + 4) & 15) << shift;
                        }
                    }
                }
            }
        }
    }

    /// Sets the cells around the volume, for transfer functions to which air itself is not empty.
    fn close(&self, raw: &mut [u64], nx: usize, ny: usize) {
        for (j, row) in raw.chunks_exact_mut(self.words).enumerate() {
            if (1..=ny).contains(&j) {
                for x in [0].into_iter().chain(nx..self.words * 64) {
                    row[x / 64] |= 1 << (x % 64);
                }
            } else {
                row.fill(u64::MAX);
            }
        }
    }
}

/// Turns the bits of voxels into those of cells along a row: cell g is between the voxels g − 1 and g.
fn spread(voxels: &[u64], cells: &mut [u64]) {
    for (w, to) in cells.iter_mut().enumerate() {
        let left = if w > 0 { voxels[w - 1] } else { 0 };
        *to = voxels[w] | voxels[w] << 1 | left >> 63;
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};
    use proptest::prelude::*;

    use super::*;
    use crate::math::hash;
    use crate::volume::Grid;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn bits_and_distances_are_what_they_say(
            nx in 1usize..150, ny in 1usize..20, nz in 1usize..40, seed: u64, share in 0.0..0.01f64,
            lo in prop_oneof![Just(-800.0f32), Just(-1100.0)],
        ) {
            let grid = Grid::new([nx, ny, nz], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
            let data = (0..grid.len() as u64)
                .map(|n| if hash::uniform(seed, n) < share { 0 } else if lo < -1024.0 { -1500 } else { -1000 })
                .collect();
            let volume = Volume::new(grid, data);
            let o = Occupancy::new(&volume, TransferFunction::new(lo, -500.0).unwrap());
            let [bx, by, bz] = o.bricks();
            // Up to the end of the last bricks, beyond the volume.
            for z in 0..4 * bz { for y in 0..4 * by { for x in 0..4 * bx {
                let near = (0..8).any(|n| {
                    let [i, j, k] = [x + (n & 1), y + (n >> 1 & 1), z + (n >> 2)].map(|c| c as i64 - 1);
                    f32::from(volume.get(i, j, k)) > lo
                });
                let bits = o.bits([x / 4, y / 4, z / 4]);
                prop_assert_eq!(bits >> (x % 4 + 4 * (y % 4) + 16 * (z % 4)) & 1 != 0, near, "{} {} {}", x, y, z);
            }}}
            for n in 0..bx * by * bz {
                let at = |n: usize| [n % bx, n / bx % by, n / bx / by];
                let far = |m: usize| (0..3).map(|a| at(n)[a].abs_diff(at(m)[a])).max().unwrap_or(0);
                let least = (0..bx * by * bz).filter(|&m| o.bits(at(m)) != 0).map(far).min().unwrap_or(255);
                prop_assert_eq!(usize::from(o.distance(at(n).map(|c| c as i32))), least);
            }
        }
    }
}
