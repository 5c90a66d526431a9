//! Colours pixels by what was found at a few rays.
//!
//! At each of these rays the picture's own pixel gives its light, the largest of its channels, and the *gains*: by how much each channel
//! must be multiplied to have the ink's colour in that light. Gains are bilinear between four rays, so a pixel takes
//! one multiplication a channel, whatever channel it is.

use fearless_simd::{Simd, f32x16, i32x16, prelude::*, u8x16, u8x32, u16x8, u16x16};

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
                let (mut ink, mut own) = ([[0.0f32; LANES]; 4], [[0.0f32; LANES]; 3]);
                for lane in 0..lanes {
                    let [column, pixel] = [first + lane, ((first + lane) * STEP).min(pixels.len() - 1)];
                    for (to, from) in ink.iter_mut().zip(inks[column]) {
                        to[lane] = f32::from(from);
                    }
                    for (to, from) in own.iter_mut().zip(pixels[pixel]) {
                        to[lane] = f32::from(from);
                    }
                }
                let all = gains_of(simd, &ink, &own, cover);
                for (lane, gains) in gains[first..first + lanes].iter_mut().enumerate() {
                    *gains = [all[0][lane] as u16, all[1][lane] as u16, all[2][lane] as u16, ONE];
                }
            }
        },
    );
}

/// Returns the gains of sixteen rays.
#[inline(always)]
fn gains_of<S: Simd>(simd: S, ink: &[[f32; LANES]; 4], own: &[[f32; LANES]; 3], cover: Cover) -> [[i32; LANES]; 3] {
    let load = f32x16::load_array_ref;
    let (one, usual) = (f32x16::splat(simd, 1.0), PALETTE[1]);
    let all = load(simd, &ink[3]);
    let covered = (all * (1.0 / cover.full_at)).min(one) * cover.most;
    let own = [
        load(simd, &own[0]) + USUAL * usual[0],
        load(simd, &own[1]) + USUAL * usual[1],
        load(simd, &own[2]) + USUAL * usual[2],
    ];
    let light = covered * own[0].max(own[1]).max(own[2]) / all.max(one) * f32::from(ONE);
    let rest = (one - covered) * f32::from(ONE) + 0.5;
    let most = f32x16::splat(simd, f32::from(MOST));
    let mut out = [[0; LANES]; 3];
    for n in 0..3 {
        let gain = rest + light * load(simd, &ink[n]) / own[n];
        out[n] = gain.min(most).to_int::<i32x16<S>>().to_array();
    }
    out
}

/// For each byte of eight pixels, and eight more of the pixels after them: the bytes of its channel's gain, of the left ray and of the
/// right one, which lie side by side in sixteen bytes.
const CHANNELS: [[u8; 32]; 4] = {
    let mut all = [[0; 32]; 4];
    let mut n = 0;
    while n < 32 {
        // Beyond the eight pixels, anything: its weight is 0.
        let c = (n % 3) as u8;
        let (half, at) = (n / 16, n % 16);
        all[half][2 * at] = 2 * c;
        all[half][2 * at + 1] = 2 * c + 1;
        all[2 + half][2 * at] = 8 + 2 * c;
        all[2 + half][2 * at + 1] = 9 + 2 * c;
        n += 1;
    }
    all
};
/// The weights of the left ray and of the right one, and what is added: a gain of 1 to bytes beyond the eight pixels.
const WEIGHTS: [[u16; 32]; 3] = {
    let mut all = [[0; 32]; 3];
    let mut n = 0;
    while n < 32 {
        if n < 3 * STEP {
            all[0][n] = (STEP - n / 3) as u16;
            all[1][n] = (n / 3) as u16;
        } else {
            all[2][n] = STEP as u16 * ONE;
        }
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
            for column in first / STEP..last.div_ceil(STEP) {
                let [top, low] = [above, below].map(|line| [line[column], line[column + 1]]);
                let here = column * STEP;
                let mut gains = across(simd, top);
                let after = across(simd, low);
                // To the next row; eight of these steps.
                let change = [eighth(gains[0], after[0]), eighth(gains[1], after[1])];
                // Whole blocks are written with the bytes after them, which stay as they are.
                let is_whole = here >= begin && here + 11 <= end;
                for (row, span) in bytes.chunks_exact_mut(3 * width).zip(spans) {
                    if is_whole {
                        if let Some(bytes) = row[3 * here..].first_chunk_mut::<32>() {
                            multiply(simd, bytes, gains);
                        }
                    } else {
                        let [from, to] = [span[0].max(here), span[1].min(here + STEP)];
                        if from < to {
                            some(&mut row[3 * from..3 * to], 3 * (from - here), &all(gains));
                        }
                    }
                    gains = [gains[0] + change[0], gains[1] + change[1]];
                }
            }
        },
    );
}

/// Returns eight times the gains for each byte of eight pixels from one ray to the next.
#[inline(always)]
fn across<S: Simd>(simd: S, [left, right]: [Gains; 2]) -> [u16x16<S>; 2] {
    let mut both = [0; 8];
    both[..4].copy_from_slice(&left);
    both[4..].copy_from_slice(&right);
    let both: u8x16<S> = u16x8::load_array_ref(simd, &both).bitcast();
    let both: u8x32<S> = both.combine(both);
    let pick =
        |n: usize| -> u16x16<S> { both.swizzle_dyn_within_blocks(u8x32::load_array_ref(simd, &CHANNELS[n])).bitcast() };
    let weight = |n: usize, half: usize| u16x16::from_slice(simd, &WEIGHTS[n][16 * half..16 * half + 16]);
    [
        pick(0) * weight(0, 0) + pick(2) * weight(1, 0) + weight(2, 0),
        pick(1) * weight(0, 1) + pick(3) * weight(1, 1) + weight(2, 1),
    ]
}

/// Returns an eighth of the change from `a` to `b`, as a number that may wrap round.
#[inline(always)]
fn eighth<S: Simd>(a: u16x16<S>, b: u16x16<S>) -> u16x16<S> {
    let change: fearless_simd::i16x16<S> = (b - a).bitcast();
    (change >> 3).bitcast()
}

#[inline(always)]
fn all<S: Simd>(gains: [u16x16<S>; 2]) -> [u16; 32] {
    let mut out = [0; 32];
    out[..16].copy_from_slice(gains[0].as_slice());
    out[16..].copy_from_slice(gains[1].as_slice());
    out
}

/// Multiplies bytes with eighths of gains.
#[inline(always)]
fn multiply<S: Simd>(simd: S, bytes: &mut [u8; 32], gains: [u16x16<S>; 2]) {
    let (low, high) = u8x32::load_array_ref(simd, bytes).widen();
    let low = (low * (gains[0] >> COARSE)) >> BITS;
    let high = (high * (gains[1] >> COARSE)) >> BITS;
    *bytes = low.saturating_narrow(high).to_array();
}

/// Like [`multiply`], for the bytes from `first` on.
#[inline(never)]
fn some(bytes: &mut [u8], first: usize, gains: &[u16; 32]) {
    for (byte, gain) in bytes.iter_mut().zip(&gains[first..]) {
        *byte = ((u16::from(*byte) * (gain >> COARSE)) >> BITS).min(255) as u8;
    }
}
