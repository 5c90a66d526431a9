//! Colours pixels by what was found at a few rays.
//!
//! At each of these rays the picture's own pixel gives its light, the largest of its channels, and the *gains*: by how much each channel
//! must be multiplied to have the ink's colour in that light. Gains are bilinear between four rays, so a pixel takes
//! one multiplication a channel, whatever channel it is.

use fearless_simd::{Simd, f32x16, i16x32, i32x16, prelude::*, u8x16, u8x32, u8x64, u16x8, u16x32};

use super::Cover;
use super::field::Sum;
use crate::render::transfer::PALETTE;

/// Pixels between two rays at which the colour is found; gains change evenly in between.
pub(super) const STEP: usize = 8;
/// Factors for red, green and blue, times [`ONE`]; the last one means nothing.
pub(super) type Gains = [u16; 4];
/// A gain of 1.
pub(super) const ONE: u16 = 1024;
/// The largest gain: a pixel's multiplication has 8 bits for it.
const MOST: u16 = 255 << 3;
/// The light of the wall's usual colour that is added to a pixel before its channels are compared, so that dark ones, whose channels are
/// small whole numbers, have about its gains.
const USUAL: f32 = 24.0;
/// Rays at once.
const LANES: usize = 16;

/// Finds the gains that give pixels their inks' colours: those of the rays `columns` of a row, whose pixels are in the row `pixels`.
#[inline(never)]
pub(super) fn find<S: Simd>(
    simd: S,
    (inks, cover): (&[Sum], Cover),
    pixels: &[[u8; 3]],
    columns: std::ops::Range<usize>,
    gains: &mut [Gains],
) {
    simd.vectorize(
        #[inline(always)]
        || {
            for first in columns.clone().step_by(LANES) {
                let lanes = (columns.end - first).min(LANES);
                let mut copy = [[0; 4]; LANES];
                let inks = first_of(&inks[first..], &mut copy);
                let mut own = [0; LANES];
                let bytes = pixels.as_flattened().get(3 * STEP * first..).and_then(|bytes| bytes.first_chunk::<OWN>());
                if let Some(bytes) = bytes {
                    for (n, own) in own.iter_mut().enumerate() {
                        let at = 3 * STEP * n;
                        *own = i32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
                    }
                } else {
                    for (n, own) in own.iter_mut().enumerate() {
                        let [r, g, b] = pixels[((first + n) * STEP).min(pixels.len() - 1)];
                        *own = i32::from_le_bytes([r, g, b, 0]);
                    }
                }
                let all = gains_of(simd, inks, &own, cover);
                if lanes == LANES {
                    gains[first..first + LANES].copy_from_slice(&all);
                } else {
                    gains[first..first + lanes].copy_from_slice(&all[..lanes]);
                }
            }
        },
    );
}

/// Bytes from the pixel of the first of the rays at once to that of the last, and one more.
const OWN: usize = 3 * STEP * (LANES - 1) + 4;

/// Returns the first rays of a row; in `copy` if there are less, and then what was there stands for the others.
#[inline(always)]
fn first_of<'a, const N: usize>(row: &'a [[u16; 4]], copy: &'a mut [[u16; 4]; N]) -> &'a [[u16; 4]; N] {
    // Most are not copied: a wide load soon after the narrow stores of a copy waits for them.
    row.first_chunk().unwrap_or_else(|| {
        copy[..row.len()].copy_from_slice(row);
        copy
    })
}

/// Returns the gains of sixteen rays. Each of their pixels is a number whose lowest three bytes are red, green and blue.
#[inline(always)]
fn gains_of<S: Simd>(simd: S, inks: &[Sum; LANES], own: &[i32; LANES], cover: Cover) -> [Gains; LANES] {
    let (one, usual) = (f32x16::splat(simd, 1.0), PALETTE[1]);
    let half = |from: usize| -> i32x16<S> { u16x32::from_slice(simd, &inks.as_flattened()[from..from + 32]).bitcast() };
    // Red and green of each ray, and blue and how much there is.
    let (even, odd) = half(0).deinterleave(half(32));
    let low = |both: i32x16<S>| -> f32x16<S> { (both & 0xffff).to_float() };
    let high = |both: i32x16<S>| -> f32x16<S> { ((both >> 16) & 0xffff).to_float() };
    let (ink, all) = ([low(even), high(even), low(odd)], high(odd));
    let mut out = [[ONE; 4]; LANES];
    if !all.simd_gt(0.0).any_true() {
        return out;
    }
    let covered = (all * (1.0 / cover.full_at)).min(one) * cover.most;
    let pixels = i32x16::load_array_ref(simd, own);
    let own: [f32x16<S>; 3] = [
        (pixels & 255).to_float::<f32x16<S>>() + USUAL * usual[0],
        (pixels >> 8 & 255).to_float::<f32x16<S>>() + USUAL * usual[1],
        (pixels >> 16 & 255).to_float::<f32x16<S>>() + USUAL * usual[2],
    ];
    let light = covered * own[0].max(own[1]).max(own[2]) / all.max(one) * f32::from(ONE);
    let rest = (one - covered) * f32::from(ONE) + 0.5;
    let most = f32x16::splat(simd, f32::from(MOST));
    let gain = |n: usize| -> i32x16<S> { (rest + light * ink[n] / own[n]).min(most).to_int() };
    let (first, second) = (gain(0) | gain(1) << 16).interleave(gain(2) | i32::from(ONE) << 16);
    let numbers = out.as_flattened_mut();
    first.bitcast::<u16x32<S>>().store_slice(&mut numbers[..32]);
    second.bitcast::<u16x32<S>>().store_slice(&mut numbers[32..]);
    out
}

/// Blocks between rays that are coloured at once: their bytes fill whole vectors.
const BLOCKS: usize = 4;
/// Their pixels across, and the bytes of these.
const WIDE: usize = BLOCKS * STEP;
const BYTES: usize = 3 * WIDE;
/// For each of those bytes the two of its channel's gain, of the left ray and of the right one. Eight bytes that follow one another belong
/// to one block, whose two rays have sixteen bytes of gains.
const CHANNELS: [[[u8; 64]; 2]; 3] = {
    let mut all = [[[0; 64]; 2]; 3];
    let mut n = 0;
    while n < BYTES {
        let (vector, at, c) = (n / 32, 2 * (n % 32), (n % 3) as u8);
        let mut side = 0;
        while side < 2 {
            all[vector][side][at] = 8 * side as u8 + 2 * c;
            all[vector][side][at + 1] = 8 * side as u8 + 2 * c + 1;
            side += 1;
        }
        n += 1;
    }
    all
};
/// The weights of the left ray and of the right one; they add up to eight.
const WEIGHTS: [[[u16; 32]; 2]; 3] = {
    let mut all = [[[0; 32]; 2]; 3];
    let mut n = 0;
    while n < BYTES {
        let right = n / 3 % STEP;
        all[n / 32][0][n % 32] = (STEP - right) as u16;
        all[n / 32][1][n % 32] = right as u16;
        n += 1;
    }
    all
};
/// Eight times a gain of 1 is [`ONE`] · 8; without these bits it has 7 bits.
const COARSE: u32 = 6;
/// A multiplication's bits below 1.
const BITS: u32 = 7;

/// Colours eight rows of pixels, or fewer at the picture's lower edge, from the gains of the rays in their first row and in the row after
/// the last. In each row the pixels of its span are coloured: from the first to the one before the second.
#[inline(never)]
pub(super) fn band<S: Simd>(
    simd: S,
    pixels: &mut [[u8; 3]],
    width: usize,
    spans: &[[usize; 2]; STEP],
    [above, below]: [&[Gains]; 2],
) {
    simd.vectorize(
        #[inline(always)]
        || {
            let mut first = spans[0][0];
            let (mut last, mut begin, mut end) = (0, 0, width);
            for [from, to] in spans {
                (first, last) = (first.min(*from), last.max(*to));
                (begin, end) = (begin.max(*from), end.min(*to));
            }
            let bytes = pixels.as_flattened_mut();
            for column in (first / STEP..last.div_ceil(STEP)).step_by(BLOCKS) {
                let mut copies = [[[ONE; 4]; BLOCKS + 1]; 2];
                let [copy, other] = &mut copies;
                let (top, low) = (first_of(&above[column..], copy), first_of(&below[column..], other));
                if top.iter().chain(low).all(|ray| *ray == [ONE; 4]) {
                    continue;
                }
                let here = column * STEP;
                let (mut gains, after) = (across(simd, top), across(simd, low));
                // To the next row; eight of these steps.
                let change = [eighth(gains[0], after[0]), eighth(gains[1], after[1]), eighth(gains[2], after[2])];
                let is_whole = here >= begin && here + WIDE <= end;
                for (row, span) in bytes.chunks_exact_mut(3 * width).zip(spans) {
                    if is_whole {
                        if let Some(bytes) = row[3 * here..].first_chunk_mut() {
                            multiply(simd, bytes, gains);
                        }
                    } else {
                        let [from, to] = [span[0].max(here), span[1].min(here + WIDE)];
                        if from < to {
                            let (some, at) = (&mut row[3 * from..3 * to], 3 * (from - here));
                            let mut all = [0; BYTES];
                            all[at..at + some.len()].copy_from_slice(some);
                            multiply(simd, &mut all, gains);
                            some.copy_from_slice(&all[at..at + some.len()]);
                        }
                    }
                    gains = [gains[0] + change[0], gains[1] + change[1], gains[2] + change[2]];
                }
            }
        },
    );
}

/// Returns eight times the gains for each byte of the pixels between rays.
#[inline(always)]
fn across<S: Simd>(simd: S, rays: &[Gains; BLOCKS + 1]) -> [u16x32<S>; 3] {
    let rays = rays.as_flattened();
    let pair = |n: usize| -> u8x16<S> { u16x8::from_slice(simd, &rays[4 * n..4 * n + 8]).bitcast() };
    let [a, b, c, d] = [pair(0), pair(1), pair(2), pair(3)];
    let between = |n: usize, rays: u8x64<S>| -> u16x32<S> {
        let pick = |side: usize| -> u16x32<S> {
            rays.swizzle_dyn_within_blocks(u8x64::load_array_ref(simd, &CHANNELS[n][side])).bitcast()
        };
        let weight = |side: usize| u16x32::load_array_ref(simd, &WEIGHTS[n][side]);
        pick(0) * weight(0) + pick(1) * weight(1)
    };
    // Three times eight bytes for each block.
    [
        between(0, a.combine(a).combine(a.combine(b))),
        between(1, b.combine(b).combine(c.combine(c))),
        between(2, c.combine(d).combine(d.combine(d))),
    ]
}

/// Returns an eighth of the change from `a` to `b`, as a number that may wrap round.
#[inline(always)]
fn eighth<S: Simd>(a: u16x32<S>, b: u16x32<S>) -> u16x32<S> {
    let change: i16x32<S> = (b - a).bitcast();
    (change >> 3).bitcast()
}

/// Multiplies bytes with eighths of gains.
#[inline(always)]
fn multiply<S: Simd>(simd: S, bytes: &mut [u8; BYTES], gains: [u16x32<S>; 3]) {
    let (most, rest) = bytes.split_at_mut(64);
    let (a, b) = u8x64::from_slice(simd, most).widen();
    let (c, d) = u8x32::from_slice(simd, rest).widen();
    let a = (a * (gains[0] >> COARSE)) >> BITS;
    let b = (b * (gains[1] >> COARSE)) >> BITS;
    let c: u16x32<S> = (c.combine(d) * (gains[2] >> COARSE)) >> BITS;
    let (c, d) = c.split();
    a.saturating_narrow(b).store_slice(most);
    c.saturating_narrow(d).store_slice(rest);
}
