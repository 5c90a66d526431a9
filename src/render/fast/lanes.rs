//! Voxels for sixteen rays at once: the one place of the crate that is not checked by the compiler.
//!
//! A trilinear sample needs four pairs of voxels that are neighbours along x. Each pair is one unaligned 32-bit load, and
//! sixteen of them one gather where the processor has it. All arithmetic around it is `fearless_simd`'s, without fused
//! multiplications, so that every SIMD level gives the same bits.

#![expect(
    unsafe_code,
    reason = "gathers have no checked form, and bounds checks for each lane cost a third of a sample"
)]

use fearless_simd::{Level, Simd, f32x16, i16x32, i32x8, i32x16, mask32x16, prelude::*};

use crate::volume::Volume;

/// Voxels whose pairs can be gathered: at least two along each axis and no more than an `i32` counts.
pub struct Voxels<'a> {
    data: &'a [i16],
    /// The last cell with all corners in the volume, for each axis: voxels − 1. The first is 1.
    last: [i32; 3],
    row: i32,
    slice: i32,
}

/// Eight corners of a cell for each lane, as pairs along x: at (y, z) = (0, 0), (1, 0), (0, 1), (1, 1).
pub type Corners<S> = [i32x16<S>; 4];

/// The scale of the weights of [`interpolate`]: they are whole numbers so that one instruction weighs a pair.
const ONE: f32 = (1 << 14) as f32;

impl<'a> Voxels<'a> {
    /// The voxels of `volume`; `None` where an axis has fewer than two of them or there are more than an `i32` counts.
    pub fn new(volume: &'a Volume) -> Option<Self> {
        let dims = volume.grid().dims();
        let data = volume.data();
        let fits = i32::try_from(data.len()).is_ok() && dims.iter().product::<usize>() == data.len();
        let [row, slice] = [dims[0] as i32, (dims[0] * dims[1]) as i32];
        (fits && dims.iter().all(|&n| n >= 2)).then(|| Self { data, last: dims.map(|n| n as i32 - 1), row, slice })
    }

    /// The last cell of each axis that lies wholly within the volume; the first is 1.
    #[inline(always)]
    pub fn last(&self) -> [i32; 3] {
        self.last
    }

    /// The corners of the cells `g` (counted from cell −1); those of the nearest cell within where one is not in the volume.
    #[inline(always)]
    pub fn corners<S: Simd>(&self, simd: S, g: [i32x16<S>; 3]) -> Corners<S> {
        let [x, y, z] = g;
        let [nx, ny, nz] = self.last;
        let (x, y, z) = (x.max(1).min(nx) - 1, y.max(1).min(ny) - 1, z.max(1).min(nz) - 1);
        let at = x + y * self.row + z * self.slice;
        // SAFETY: x ≤ n_x − 2, y ≤ n_y − 2 and z ≤ n_z − 2, so that the pair at (x, y + 1, z + 1) ends at the last voxel
        // at most, and nothing is below 0; `new` made sure that the product of the n is the length of `data` and fits
        // an i32.
        unsafe {
            [
                pairs(simd, self.data, at),
                pairs(simd, self.data, at + self.row),
                pairs(simd, self.data, at + self.slice),
                pairs(simd, self.data, at + (self.slice + self.row)),
            ]
        }
    }
}

/// For each lane the place of a 4×4×4 block of voxels that lies wholly within the volume.
pub struct Blocks<'a, S: Simd> {
    voxels: &'a Voxels<'a>,
    first: i32x16<S>,
}

impl<'a> Voxels<'a> {
    /// The blocks about the cells `g` (counted from cell −1) of the lanes in `wanted`; `None` where one of them leaves the
    /// volume. Those of other lanes are moved into it.
    #[inline(always)]
    pub fn blocks<S: Simd>(&'a self, g: [i32x16<S>; 3], wanted: mask32x16<S>) -> Option<Blocks<'a, S>> {
        let [x, y, z] = g;
        let [nx, ny, nz] = self.last;
        if nx.min(ny).min(nz) < 3 {
            return None;
        }
        let first = |g: i32x16<S>, last: i32| g.max(2).min(last - 1) - 2;
        let [fx, fy, fz] = [first(x, nx), first(y, ny), first(z, nz)];
        let within = fx.simd_eq(x - 2) & fy.simd_eq(y - 2) & fz.simd_eq(z - 2);
        let all = (within | !wanted).all_true();
        all.then(|| Blocks { voxels: self, first: fx + fy * self.row + fz * self.slice })
    }
}

impl<S: Simd> Blocks<'_, S> {
    /// The block's voxels (`x`, `y`, `z`) and (`x` + 1, `y`, `z`), HU; `x` is 0 or 2, `y` and `z` go from 0 to 3.
    #[inline(always)]
    pub fn pair(&self, simd: S, [x, y, z]: [usize; 3]) -> [f32x16<S>; 2] {
        let Voxels { data, row, slice, .. } = *self.voxels;
        let at = self.first + ((x as i32 & 2) + (y as i32 & 3) * row + (z as i32 & 3) * slice);
        // SAFETY: `blocks` made sure that the block's first voxel is three voxels or more before the last along each axis,
        // and no more than 2 + 1, 3 and 3 are added here.
        let pair = unsafe { pairs(simd, data, at) };
        [(pair << 16 >> 16).to_float(), (pair >> 16).to_float()]
    }
}

/// Trilinear values within the corners' cells, at the places `t` (0 to 1 along each axis), HU.
#[inline(always)]
pub fn interpolate<S: Simd>(simd: S, corners: Corners<S>, t: [f32x16<S>; 3]) -> f32x16<S> {
    // The pair's weights, as two 16-bit numbers in one: 1 − t below, t above.
    let tx: i32x16<S> = (t[0] * ONE + 0.5).to_int();
    let weights: i16x32<S> = ((tx << 16) + (i32x16::splat(simd, ONE as i32) - tx)).bitcast();
    let [a, b, c, d] = corners;
    let (a, b) = (weigh(simd, a, weights), weigh(simd, b, weights));
    let (c, d) = (weigh(simd, c, weights), weigh(simd, d, weights));
    let near = a + (b - a) * t[1];
    let far = c + (d - c) * t[1];
    (near + (far - near) * t[2]) * (1.0 / ONE)
}

/// The weighted sum of each pair.
#[inline(always)]
fn weigh<S: Simd>(simd: S, pair: i32x16<S>, weights: i16x32<S>) -> f32x16<S> {
    simd.pairwise_dot_product_i16x32(pair.bitcast(), weights).to_float()
}

/// The pairs of voxels at `at` and the one after, the first in the lower half.
///
/// # Safety
/// Each index is at least 0 and at most two below the length of `data`.
#[inline(always)]
unsafe fn pairs<S: Simd>(simd: S, data: &[i16], at: i32x16<S>) -> i32x16<S> {
    let from = data.as_ptr().cast::<i32>();
    match simd.level() {
        #[cfg(target_arch = "x86_64")]
        Level::Avx512(_) => {
            use std::arch::x86_64::{_mm512_i32gather_epi32, _mm512_loadu_si512};
            // SAFETY: the level tells that the processor has AVX-512; the loads are within `data` by the caller's word.
            let found = unsafe { _mm512_i32gather_epi32::<2>(_mm512_loadu_si512(at.as_array().as_ptr().cast()), from) };
            found.simd_into(simd)
        }
        #[cfg(target_arch = "x86_64")]
        Level::Avx2(_) => {
            use std::arch::x86_64::{_mm256_i32gather_epi32, _mm256_loadu_si256};
            let at = at.as_array().as_ptr();
            // SAFETY: the level tells that the processor has AVX2; the loads are within `data` by the caller's word.
            let (low, high) = unsafe {
                let (low, high) = (_mm256_loadu_si256(at.cast()), _mm256_loadu_si256(at.add(8).cast()));
                (_mm256_i32gather_epi32::<2>(from, low), _mm256_i32gather_epi32::<2>(from, high))
            };
            let (low, high): (i32x8<S>, i32x8<S>) = (low.simd_into(simd), high.simd_into(simd));
            low.combine(high)
        }
        _ => {
            let mut found = [0; 16];
            for (found, at) in found.iter_mut().zip(at.as_array()) {
                // SAFETY: within `data` by the caller's word.
                *found = unsafe { from.byte_offset(2 * *at as isize).read_unaligned() };
            }
            found.simd_into(simd)
        }
    }
}
