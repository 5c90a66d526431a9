//! Where something may be seen: a bit for each cell, in bricks of 4×4×4 cells, and each brick's distance to the next
//! brick in which a bit is set.
//!
//! Cells are counted from the border of the volume grown by a voxel of air, as in [`march`](crate::render::march): cell g of an
//! axis lies between the voxels g − 1 and g, so that n voxels have n + 1 cells. A cell's bit is set when any voxel at a
//! corner of it **or of one of its 26 neighbours** lies above the ramp's foot. A bit that is not set therefore tells that
//! everything within one voxel of the cell, along each axis, is empty: enough for a bundle of rays one voxel thick to
//! either side.
//!
//! The distance is the chessboard distance in bricks ([`chessboard`]);
//! all bricks nearer than it are empty, so a bundle may leap to where it leaves their cube. The bits take 1/16 of the
//! 16-bit volume, the distances 1/128.

use rayon::prelude::*;

use crate::render::flags::above;
use crate::render::leap::chessboard::{FAR, chessboard};
use crate::render::space::Wall;
use crate::volume::{AIR_HU, Volume};

/// Cells along a brick's edge, as a power of two.
pub const BRICK_SHIFT: u32 = 2;
/// Layers of bricks that one task fills.
const SLAB: usize = 4;

/// The bits of all cells, and the distances of all bricks.
#[derive(Clone, Debug)]
pub struct Occupancy {
    /// Bricks along each axis.
    bricks: [usize; 3],
    /// Bit `x + 4·y + 16·z` of a brick is that of its cell (x, y, z).
    bits: Vec<u64>,
    /// Chessboard distance to the next brick with a bit set, bricks; 0 in such a brick.
    distance: Vec<u8>,
}

impl Occupancy {
    /// The cells of `volume` near values above `wall`'s foot, in parallel and in time linear in the voxels.
    pub fn new(volume: &Volume, wall: Wall) -> Self {
        let lo = wall.lo().floor() as i16;
        let dims = volume.grid().dims();
        let bricks = dims.map(|n| (n + 1).div_ceil(1 << BRICK_SHIFT));
        let layer = bricks[0] * bricks[1];
        let mut bits = vec![0u64; layer * bricks[2]];
        bits.par_chunks_mut(layer * SLAB).enumerate().for_each(|(n, out)| {
            Slab::new(volume, lo, bricks).fill(n * SLAB, out);
        });
        let mut distance: Vec<u8> = bits.iter().map(|&b| if b == 0 { FAR } else { 0 }).collect();
        chessboard(&mut distance, bricks, false);
        Self { bricks, bits, distance }
    }

    /// Bricks along each axis.
    pub fn bricks(&self) -> [usize; 3] {
        self.bricks
    }

    /// The bits of brick `n` of the list (x fastest).
    #[inline(always)]
    pub fn bits(&self, n: usize) -> u64 {
        self.bits.get(n).copied().unwrap_or(u64::MAX)
    }

    /// The distance of brick `n` of the list, bricks.
    #[inline(always)]
    pub fn distance(&self, n: usize) -> u8 {
        self.distance.get(n).copied().unwrap_or(0)
    }

    /// Memory taken.
    pub fn bytes(&self) -> usize {
        size_of_val(self.bits.as_slice()) + self.distance.len()
    }
}

/// Makes the bits of some layers of bricks.
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

    /// Fills the layers of bricks from `first` on that `out` has room for.
    fn fill(&self, first: usize, out: &mut [u64]) {
        let [nx, ny, nz] = self.volume.grid().dims();
        let rows = self.bricks[1] << BRICK_SHIFT;
        let plane = rows * self.words;
        // Slices of voxels in a ring: four of them are or-ed to a layer of cells.
        let mut ring = vec![vec![0u64; plane]; 4];
        let mut raw = vec![0u64; self.words * (ny + 4)];
        let mut slice = |k: isize, to: &mut Vec<u64>| {
            // Two rows of air before, and two after.
            if (0..nz as isize).contains(&k) {
                let data = &self.volume.data()[nx * ny * k as usize..nx * ny * (k as usize + 1)];
                raw.fill(0);
                let mut scratch = vec![0u64; self.words];
                for (row, to) in data.chunks_exact(nx).zip(raw[2 * self.words..].chunks_exact_mut(self.words)) {
                    above(row, self.lo, &mut scratch);
                    spread(&scratch, to);
                }
                if AIR_HU > self.lo {
                    self.close(&mut raw, nx, ny);
                }
                for (j, to) in to.chunks_exact_mut(self.words).enumerate() {
                    for (w, to) in to.iter_mut().enumerate() {
                        let at = |r: usize| raw.get((j + r) * self.words + w).copied().unwrap_or(0);
                        *to = at(0) | at(1) | at(2) | at(3);
                    }
                }
            } else {
                to.fill(if AIR_HU > self.lo { u64::MAX } else { 0 });
            }
        };
        let z0 = (first << BRICK_SHIFT) as isize;
        for k in -2..1 {
            slice(z0 + k, &mut ring[(k + 2) as usize]);
        }
        for (b, layer) in out.chunks_exact_mut(self.bricks[0] * self.bricks[1]).enumerate() {
            for z in 0..4 {
                let n = 4 * b + z;
                slice(z0 + n as isize + 1, &mut ring[(n + 3) % 4]);
                for y in 0..rows {
                    let bricks = &mut layer[(y >> 2) * self.bricks[0]..][..self.bricks[0]];
                    let shift = 16 * z + 4 * (y & 3);
                    for w in 0..self.words {
                        let at = y * self.words + w;
                        let word = ring[0][at] | ring[1][at] | ring[2][at] | ring[3][at];
                        if word == 0 {
                            continue;
                        }
                        for (n, brick) in bricks.iter_mut().skip(16 * w).take(16).enumerate() {
                            *brick |= (word >> (4 * n) & 15) << shift;
                        }
                    }
                }
            }
        }
    }

    /// Sets the cells around the volume, where air itself is not empty.
    fn close(&self, raw: &mut [u64], nx: usize, ny: usize) {
        for (j, row) in raw.chunks_exact_mut(self.words).enumerate() {
            if (2..ny + 2).contains(&j) {
                for x in [0, 1].into_iter().chain(nx - 1..self.words * 64) {
                    row[x / 64] |= 1 << (x % 64);
                }
            } else {
                row.fill(u64::MAX);
            }
        }
    }
}

/// From the bits of voxels to those of cells along a row: cell g is near the voxels g − 2 to g + 1.
fn spread(voxels: &[u64], cells: &mut [u64]) {
    for (w, to) in cells.iter_mut().enumerate() {
        let left = if w > 0 { voxels[w - 1] } else { 0 };
        let right = voxels.get(w + 1).copied().unwrap_or(0);
        let here = voxels[w];
        *to = here | here << 1 | here << 2 | left >> 63 | left >> 62 | here >> 1 | right << 63;
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
            let o = Occupancy::new(&volume, Wall::new(lo, -500.0).unwrap());
            let [bx, by, bz] = o.bricks();
            for z in 0..=nz { for y in 0..=ny { for x in 0..=nx {
                let near = (0..64).any(|n| {
                    let [i, j, k] = [x + (n & 3), y + (n >> 2 & 3), z + (n >> 4)].map(|c| c as i64 - 2);
                    f32::from(volume.get(i, j, k)) > lo
                });
                let bits = o.bits(x / 4 + bx * (y / 4 + by * (z / 4)));
                prop_assert_eq!(bits >> (x % 4 + 4 * (y % 4) + 16 * (z % 4)) & 1 != 0, near, "{} {} {}", x, y, z);
            }}}
            for n in 0..bx * by * bz {
                let at = |n: usize| [n % bx, n / bx % by, n / bx / by];
                let far = |m: usize| (0..3).map(|a| at(n)[a].abs_diff(at(m)[a])).max().unwrap_or(0);
                let least = (0..bx * by * bz).filter(|&m| o.bits(m) != 0).map(far).min().unwrap_or(255);
                prop_assert_eq!(usize::from(o.distance(n)), least);
            }
        }
    }
}
