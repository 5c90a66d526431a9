//! Lookup of voxels and of empty cells for sixteen rays at once. This is the only module of the crate with unsafe code.
//!
//! A trilinear sample needs four pairs of voxels that are neighbours along x. Each pair is one unaligned 32-bit load,
//! and sixteen of them are one gather where the processor has it. All arithmetic around it is `fearless_simd`'s,
//! without fused multiplications, so that every SIMD level gives the same bits.

#![expect(
    unsafe_code,
    reason = "gathers have no checked form, and bounds checks for each lane cost a third of a sample"
)]

use fearless_simd::{Level, Simd, f32x16, i16x32, i32x8, i32x16, i64x8, mask32x16, prelude::*};

use super::occupancy::{BRICK_SHIFT, Line, Occupancy};
use crate::volume::Volume;

// The first of two numbers is the lower half of what is loaded.
#[cfg(target_endian = "big")]
compile_error!("packets of rays load pairs of numbers as little-endian processors do");

const _: () =
    assert!(size_of::<Line<u64, 8>>() == 2 * PIECES as usize && size_of::<Line<u8, 64>>() == 2 * PIECES as usize);

/// Voxels whose pairs can be gathered: at least two along each axis and no more than an `i32` can count.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Voxels<'a> {
    data: &'a [i16],
    /// For each axis, the last cell with all corners in the volume: voxels − 1. The first is 1.
    last: [i32; 3],
    row: i32,
    slice: i32,
}

/// Eight corners of a cell for each lane, as pairs along x: at (y, z) = (0, 0), (1, 0), (0, 1), (1, 1).
pub(crate) type Corners<S> = [i32x16<S>; 4];

/// The scale of the weights in [`interpolate`]. They are integers so that one instruction weights a pair.
const ONE: f32 = (1 << 14) as f32;

impl<'a> Voxels<'a> {
    /// Returns the voxels of `volume`; `None` if an axis has fewer than two of them, or if there are more than an `i32` can count.
    pub(crate) fn new(volume: &'a Volume) -> Option<Self> {
        Self::of(volume.data(), volume.grid().dims())
    }

    /// As [`Voxels::new`], of `dims` voxels along the axes, x fastest.
    pub(crate) fn of(data: &'a [i16], dims: [usize; 3]) -> Option<Self> {
        let fits = i32::try_from(data.len()).is_ok() && dims.iter().product::<usize>() == data.len();
        let [row, slice] = [dims[0] as i32, (dims[0] * dims[1]) as i32];
        (fits && dims.iter().all(|&n| n >= 2)).then(|| Self { data, last: dims.map(|n| n as i32 - 1), row, slice })
    }

    /// Returns, for each axis, the last cell that is wholly within the volume. The first is 1.
    #[inline(always)]
    pub(crate) fn last(&self) -> [i32; 3] {
        self.last
    }

    /// Returns the corners of the cells `g` (counted from cell −1) of the lanes in `wanted`.
    ///
    /// A cell outside the volume is replaced by the nearest one within. Unwanted lanes get the first cell: rays that
    /// have ended would otherwise keep reading memory that is not in the processor's cache.
    #[inline(always)]
    pub(crate) fn corners<S: Simd>(&self, simd: S, g: [i32x16<S>; 3], wanted: mask32x16<S>) -> Corners<S> {
        let [x, y, z] = g;
        let [nx, ny, nz] = self.last;
        let (x, y, z) = (x.max(1).min(nx) - 1, y.max(1).min(ny) - 1, z.max(1).min(nz) - 1);
        let at = wanted.select(x + y * self.row + z * self.slice, i32x16::splat(simd, 0));
        // SAFETY: x ≤ n_x − 2, y ≤ n_y − 2 and z ≤ n_z − 2, so the pair at (x, y + 1, z + 1) ends at the last voxel at most, and no
        // index is below 0. `new` ensured that the product of the n is the length of `data` and fits an i32.
        unsafe {
            [
                pairs(simd, self.data.as_ptr(), at),
                pairs(simd, self.data.as_ptr(), at + self.row),
                pairs(simd, self.data.as_ptr(), at + self.slice),
                pairs(simd, self.data.as_ptr(), at + (self.slice + self.row)),
            ]
        }
    }
}

/// For each lane, the position of a 4×4×4 block of voxels that is wholly within the volume.
pub(crate) struct Blocks<'a, S: Simd> {
    voxels: &'a Voxels<'a>,
    first: i32x16<S>,
}

impl<'a> Voxels<'a> {
    /// Returns the blocks around the cells `g` (counted from cell −1) of the lanes in `wanted`; `None` if one of them
    /// leaves the volume. Other lanes get the volume's first block.
    #[inline(always)]
    pub(crate) fn blocks<S: Simd>(&'a self, simd: S, g: [i32x16<S>; 3], wanted: mask32x16<S>) -> Option<Blocks<'a, S>> {
        let [x, y, z] = g;
        let [nx, ny, nz] = self.last;
        if nx.min(ny).min(nz) < 3 {
            return None;
        }
        let first = |g: i32x16<S>, last: i32| g.max(2).min(last - 1) - 2;
        let [fx, fy, fz] = [first(x, nx), first(y, ny), first(z, nz)];
        let within = fx.simd_eq(x - 2) & fy.simd_eq(y - 2) & fz.simd_eq(z - 2);
        let first = wanted.select(fx + fy * self.row + fz * self.slice, i32x16::splat(simd, 0));
        (within | !wanted).all_true().then_some(Blocks { voxels: self, first })
    }
}

impl<S: Simd> Blocks<'_, S> {
    /// Returns the four voxels of the block's row (`y`, `z`), HU. Both indices are from 0 to 3.
    #[inline(always)]
    pub(crate) fn row(&self, simd: S, [y, z]: [usize; 2]) -> [f32x16<S>; 4] {
        let Voxels { data, row, slice, .. } = *self.voxels;
        let at = self.first + ((y as i32 & 3) * row + (z as i32 & 3) * slice);
        let at = at.as_array();
        // One load for each lane, since all eight bytes are used: two gathers of pairs take longer.
        // SAFETY: `blocks` ensured that the block's first voxel is at least three voxels before the last along each
        // axis, and no more than 3 is added here along x, y and z.
        let four = |n: usize| unsafe { data.as_ptr().offset(at[n] as isize).cast::<i64>().read_unaligned() };
        let low: i64x8<S> = [four(0), four(1), four(2), four(3), four(4), four(5), four(6), four(7)].simd_into(simd);
        let high: i64x8<S> =
            [four(8), four(9), four(10), four(11), four(12), four(13), four(14), four(15)].simd_into(simd);
        let (left, right) = low.bitcast::<i32x16<S>>().deinterleave(high.bitcast::<i32x16<S>>());
        [
            (left << 16 >> 16).to_float(),
            (left >> 16).to_float(),
            (right << 16 >> 16).to_float(),
            (right >> 16).to_float(),
        ]
    }
}

/// An [`Occupancy`] that sixteen rays look up at once, each at its own cell. A cell outside the volume is replaced by
/// the nearest one within.
pub(crate) struct OccupancyLanes<'a> {
    /// The last cell of each axis.
    last: [i32; 3],
    bits: &'a [Line<u64, 8>],
    /// Cubes of bits along x, and in a layer. `distance_cubes` has the same for distances.
    bit_cubes: [i32; 2],
    distances: &'a [Line<u8, 64>],
    distance_cubes: [i32; 2],
}

/// 16-bit pieces in a cache line.
const PIECES: i32 = 32;

impl<'a> OccupancyLanes<'a> {
    /// Wraps `occupancy`; `None` if it has more 16-bit pieces than an `i32` can count.
    pub(crate) fn new(occupancy: &'a Occupancy) -> Option<Self> {
        let (bits, distances) = (occupancy.bit_cubes(), occupancy.distance_cubes());
        let bricks = occupancy.bricks();
        // Cubes with sides of 2 and of 4 bricks.
        let cubes = |shift: u32, lines: usize| {
            let [x, y, z] = bricks.map(|n| n.div_ceil(1 << shift));
            let fits = x * y * z == lines && i32::try_from(lines * PIECES as usize).is_ok();
            fits.then_some([x as i32, (x * y) as i32])
        };
        Some(Self {
            last: bricks.map(|n| (n << BRICK_SHIFT) as i32 - 1),
            bits,
            bit_cubes: cubes(1, bits.len())?,
            distances,
            distance_cubes: cubes(2, distances.len())?,
        })
    }

    /// True if the bit of one of the cells `g` of the lanes in `wanted` is set.
    #[inline(always)]
    pub(crate) fn any<S: Simd>(&self, simd: S, g: [i32x16<S>; 3], wanted: mask32x16<S>) -> bool {
        (wanted & self.set(simd, g)).any_true()
    }

    /// Returns the lanes whose cells `g` have their bit set.
    #[inline(always)]
    pub(crate) fn set<S: Simd>(&self, simd: S, g: [i32x16<S>; 3]) -> mask32x16<S> {
        let [x, y, z] = self.within(g);
        let line = (x >> 3) + (y >> 3) * self.bit_cubes[0] + (z >> 3) * self.bit_cubes[1];
        // A brick has four pieces, one for each layer; two layers are loaded.
        let at = line * PIECES + ((x & 4) + ((y & 4) << 1) + ((z & 4) << 2) + (z & 2));
        let bit = (x & 3) + ((y & 3) << 2) + ((z & 1) << 4);
        // SAFETY: the piece is one of the line's first 31. The line belongs to a cell within the bricks, and `new` ensured that
        // `bits` holds all of these and that their pieces fit an i32. A line is `repr(C)` and has no padding.
        let found = unsafe { pairs(simd, self.bits.as_ptr().cast(), at) };
        ((found >> bit) & 1).simd_eq(1)
    }

    /// Returns the least distance of the bricks around the cells `g` of the lanes in `wanted`, bricks.
    #[inline(always)]
    pub(crate) fn nearest<S: Simd>(&self, simd: S, g: [i32x16<S>; 3], wanted: mask32x16<S>) -> i32 {
        let [x, y, z] = self.within(g);
        let line = (x >> 4) + (y >> 4) * self.distance_cubes[0] + (z >> 4) * self.distance_cubes[1];
        // A row of four distances is two pieces.
        let at = line * PIECES + (((y >> 1) & 6) + ((z << 1) & 24));
        // SAFETY: as in `set`; the piece is one of the line's first 31.
        let found = unsafe { pairs(simd, self.distances.as_ptr().cast(), at) };
        let distance = (found >> ((x << 1) & 24)) & 255;
        wanted.select(distance, i32x16::splat(simd, 255)).reduce_min()
    }

    #[inline(always)]
    fn within<S: Simd>(&self, [x, y, z]: [i32x16<S>; 3]) -> [i32x16<S>; 3] {
        let [nx, ny, nz] = self.last;
        [x.max(0).min(nx), y.max(0).min(ny), z.max(0).min(nz)]
    }
}

/// Bytes that are gathered four at a time, of which the first is kept: the last three are there only for that.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Padded<'a>(&'a [u8]);

/// How many bytes follow the last one that is looked up.
pub(crate) const SPARE: usize = 3;

impl<'a> Padded<'a> {
    /// Wraps bytes with [`SPARE`] more at the end; `None` if there are none, or more than an `i32` can count.
    pub(crate) fn new(data: &'a [u8]) -> Option<Self> {
        (data.len() > SPARE && i32::try_from(data.len()).is_ok()).then_some(Self(data))
    }

    /// Returns the bytes at the places `at`, or the nearest ones.
    #[inline(always)]
    pub(crate) fn at<S: Simd>(&self, simd: S, at: i32x16<S>) -> i32x16<S> {
        self.four(simd, at) & 255
    }

    /// Returns the four bytes from each of the places `at` on, or from the nearest ones; the first is the lowest.
    #[inline(always)]
    pub(crate) fn four<S: Simd>(&self, simd: S, at: i32x16<S>) -> i32x16<S> {
        let at = at.max(0).min((self.0.len() - 1 - SPARE) as i32);
        // SAFETY: `new` ensured that the data are longer than what is spare, and four bytes at each index are within them.
        unsafe { gather::<S, 1>(simd, self.0.as_ptr().cast(), at) }
    }
}

/// Returns trilinear values within the cells, at the positions `t` (0 to 1 along each axis), HU.
#[inline(always)]
pub(crate) fn interpolate<S: Simd>(simd: S, corners: Corners<S>, t: [f32x16<S>; 3]) -> f32x16<S> {
    // The pair's weights as two 16-bit halves of one number: 1 − t below, t above.
    let tx: i32x16<S> = (t[0] * ONE + 0.5).to_int();
    let weights: i16x32<S> = ((tx << 16) + (i32x16::splat(simd, ONE as i32) - tx)).bitcast();
    let [a, b, c, d] = corners;
    let (a, b) = (weigh(simd, a, weights), weigh(simd, b, weights));
    let (c, d) = (weigh(simd, c, weights), weigh(simd, d, weights));
    let near = a + (b - a) * t[1];
    let far = c + (d - c) * t[1];
    (near + (far - near) * t[2]) * (1.0 / ONE)
}

/// Returns the weighted sum of each pair.
#[inline(always)]
fn weigh<S: Simd>(simd: S, pair: i32x16<S>, weights: i16x32<S>) -> f32x16<S> {
    simd.pairwise_dot_product_i16x32(pair.bitcast(), weights).to_float()
}

/// Returns the pairs of 16-bit numbers at `at` and `at + 1`, the first in the lower half.
///
/// # Safety
/// `data` must point to memory that holds the numbers at each index and at the one after it.
#[inline(always)]
unsafe fn pairs<S: Simd>(simd: S, data: *const i16, at: i32x16<S>) -> i32x16<S> {
    // SAFETY: that of the caller.
    unsafe { gather::<S, 2>(simd, data.cast(), at) }
}

/// Returns what is at `at` times `SCALE` bytes from `from`.
///
/// # Safety
/// Four bytes at each of these places must be readable.
#[inline(always)]
unsafe fn gather<S: Simd, const SCALE: i32>(simd: S, from: *const i32, at: i32x16<S>) -> i32x16<S> {
    match simd.level() {
        #[cfg(target_arch = "x86_64")]
        Level::Avx512(_) => {
            use std::arch::x86_64::{_mm512_i32gather_epi32, _mm512_loadu_si512};
            // SAFETY: the level guarantees that the processor has AVX-512; the caller guarantees that the loads are
            // within the data.
            let found =
                unsafe { _mm512_i32gather_epi32::<SCALE>(_mm512_loadu_si512(at.as_array().as_ptr().cast()), from) };
            found.simd_into(simd)
        }
        #[cfg(target_arch = "x86_64")]
        Level::Avx2(_) => {
            use std::arch::x86_64::{_mm256_i32gather_epi32, _mm256_loadu_si256};
            let at = at.as_array().as_ptr();
            // SAFETY: the level guarantees that the processor has AVX2; the caller guarantees that the loads are within the data.
            let (low, high) = unsafe {
                let (low, high) = (_mm256_loadu_si256(at.cast()), _mm256_loadu_si256(at.add(8).cast()));
                (_mm256_i32gather_epi32::<SCALE>(from, low), _mm256_i32gather_epi32::<SCALE>(from, high))
            };
            let (low, high): (i32x8<S>, i32x8<S>) = (low.simd_into(simd), high.simd_into(simd));
            low.combine(high)
        }
        _ => {
            let mut found = [0; 16];
            for (found, at) in found.iter_mut().zip(at.as_array()) {
                // SAFETY: the caller guarantees that the load is within the data.
                *found = unsafe { from.byte_offset(SCALE as isize * *at as isize).read_unaligned() };
            }
            found.simd_into(simd)
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};
    use proptest::prelude::*;

    use super::*;
    use crate::math::hash;
    use crate::render::packets::levels;
    use crate::space::TransferFunction;
    use crate::volume::Grid;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        /// Sixteen cells at once, some of them outside the volume, on every level.
        #[test]
        fn lanes_find_what_cells_hold(
            nx in 1usize..70, ny in 1usize..70, nz in 1usize..70, many in 0u64..20, wanted: u16, seed: u64,
        ) {
            let dims = [nx, ny, nz];
            let grid = Grid::new(dims, DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
            let random = |n: u64, a: usize| hash::uniform(seed, 3 * n + a as u64);
            let mut data = vec![-1000; grid.len()];
            for n in 0..many {
                let [x, y, z] = [0, 1, 2].map(|a| (random(n, a) * dims[a] as f64) as usize);
                data[x + nx * (y + ny * z)] = 0;
            }
            let occupancy = Occupancy::new(&Volume::new(grid, data), TransferFunction::default());
            let lanes = OccupancyLanes::new(&occupancy).unwrap();
            let cells: [[i32; 16]; 3] = std::array::from_fn(|a| {
                std::array::from_fn(|n| (random(100 + n as u64, a) * (dims[a] + 9) as f64) as i32 - 4)
            });
            let within = |n: usize| [0, 1, 2].map(|a| cells[a][n].clamp(0, 4 * occupancy.bricks()[a] as i32 - 1));
            let asked = || (0..16).filter(|n| wanted >> n & 1 != 0).map(within);
            let any = asked().any(|c| occupancy.any(c, c));
            let nearest = asked().map(|c| occupancy.distance(c.map(|c| c >> BRICK_SHIFT))).min().unwrap_or(255);
            for (name, level) in levels() {
                let found = fearless_simd::dispatch!(level, simd => {
                    let g = cells.map(|c| i32x16::load_array_ref(simd, &c));
                    let wanted: [i32; 16] = std::array::from_fn(|n| i32::from(wanted >> n & 1));
                    let wanted = i32x16::load_array_ref(simd, &wanted).simd_eq(1);
                    (lanes.any(simd, g, wanted), lanes.nearest(simd, g, wanted))
                });
                prop_assert_eq!(found, (any, i32::from(nearest)), "{}", name);
            }
        }
    }
}
