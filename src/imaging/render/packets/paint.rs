//! Turns light into pixels.

use fearless_simd::{Simd, f32x16, i32x16, prelude::*, u8x64};

use super::cells::Colours;
use super::rays::{PacketResult, SIDE};
use super::sampling::Rgb;
use crate::render::Work;
use crate::render::renderer::SQUARE;
use crate::render::transfer::{PALETTE, PALETTE_HU};

/// Bytes in a row of a block.
const BYTES: usize = 3 * SIDE;

/// The rows of a picture that are being filled.
pub(crate) struct Canvas<'a> {
    pixels: &'a mut [[u8; 3]],
    width: usize,
    /// Index of the first row in the picture.
    top: usize,
}

impl<'a> Canvas<'a> {
    /// Wraps the rows from `top` on of a picture that is `width` pixels wide.
    pub(crate) fn new(pixels: &'a mut [[u8; 3]], width: usize, top: usize) -> Self {
        Self { pixels, width, top }
    }

    /// True if the canvas holds the pixel (`x`, `y`) of the picture.
    pub(crate) fn holds(&self, [x, y]: [usize; 2]) -> bool {
        x < self.width && y >= self.top && (y - self.top) * self.width < self.pixels.len()
    }

    /// Fills the pixels of a packet whose rays are one pixel apart, the first through `at`.
    #[inline(never)]
    pub(crate) fn packet<S: Simd>(
        &mut self,
        simd: S,
        light: &PacketResult,
        own: Option<&Colours>,
        at: [usize; 2],
    ) -> Work {
        simd.vectorize(
            #[inline(always)]
            || self.block(&packed(simd, light, own), at),
        );
        let rows = self.pixels.len() / self.width - (at[1] - self.top);
        let rays = SIDE.min(self.width - at[0]) * SIDE.min(rows);
        Work { rays: rays as u64, samples: u64::from(light.samples), ..Work::default() }
    }

    /// Fills squares of [`SQUARE`] × [`SQUARE`] pixels with a packet's rays in turn.
    #[inline(never)]
    pub(crate) fn squares<S: Simd>(
        &mut self,
        simd: S,
        light: &PacketResult,
        own: Option<&Colours>,
        at: &[[usize; 2]],
    ) -> Work {
        simd.vectorize(
            #[inline(always)]
            || {
                let colours = packed(simd, light, own);
                for (square, &[x, y]) in colours.chunks_exact(SQUARE * SQUARE).zip(at) {
                    for (n, row) in square.chunks_exact(SQUARE).enumerate() {
                        self.row(row, [x, y + n]);
                    }
                }
            },
        );
        Work { rays: 4 * at.len() as u64, samples: u64::from(light.samples), ..Work::default() }
    }

    /// Fills the block from pixel `at` on with weighted sums of the rays' `light`, brightness and tone.
    #[inline(never)]
    pub(crate) fn blend<S: Simd, const N: usize>(
        &mut self,
        simd: S,
        light: [[f32; 2]; N],
        weights: &[[f32; SIDE * SIDE]; N],
        at: [usize; 2],
    ) {
        simd.vectorize(
            #[inline(always)]
            || {
                let (mut bright, mut tone) = (f32x16::splat(simd, 0.0), f32x16::splat(simd, 0.0));
                for ([b, t], weights) in light.iter().zip(weights) {
                    let weights = f32x16::load_array_ref(simd, weights);
                    bright += weights * *b;
                    tone += weights * *t;
                }
                self.block(&colours(simd, bright, tone), at);
            },
        );
    }

    /// Fills those of sixteen smooth blocks in a row whose bit is set, with a lane for each block. `light` is the brightness and the tone of
    /// the rays of each block, corners, then centre; the first block is at pixel `at`, and all are within the picture's width.
    ///
    /// A pixel's colour is a mean of its block's rays, weighted by [`WEIGHTS`](super::sampling::WEIGHTS), and is computed from its neighbour's.
    /// No weight is below 0: where all rays can be shown, so can all pixels.
    #[inline(always)]
    pub(crate) fn blend_row<S: Simd>(&mut self, simd: S, light: &[[f32x16<S>; 2]; 5], which: u16, [x, y]: [usize; 2]) {
        let mut pixels = [[i32x16::splat(simd, 0); SIDE]; SIDE];
        for channel in [2, 1, 0] {
            let a = shown(light[0], channel);
            let b = shown(light[1], channel);
            let c = shown(light[2], channel);
            let d = shown(light[3], channel);
            let centre = shown(light[4], channel);
            // The first column of pixels, the change along the rows, and the tent over the centre.
            let (mut left, down) = (a, (c - a) * 0.25);
            let (mut across, turn) = ((b - a) * 0.25, (d - c - (b - a)) * 0.0625);
            let bend = (centre - (a + b + c + d) * 0.25) * 0.25;
            let (least, most) = (a.min(b).min(c.min(d)).min(centre), a.max(b).max(c.max(d)).max(centre));
            let is_limited = (least.simd_lt(LEAST) | most.simd_gt(MOST)).any_true();
            for (v, row) in pixels.iter_mut().enumerate() {
                let tent = bend * [0.0, 1.0, 2.0, 1.0][v];
                let (up, over) = (across + tent, across - tent);
                let (second, third) = (left + up, left + up + up);
                let mut four = [left, second, third, third + over];
                if is_limited {
                    let (least, most) = (f32x16::splat(simd, LEAST), f32x16::splat(simd, MOST));
                    for value in &mut four {
                        *value = value.max(least).min(most);
                    }
                }
                for (pixel, value) in row.iter_mut().zip(four) {
                    *pixel = *pixel << 8 | value.to_int::<i32x16<S>>();
                }
                left += down;
                across += turn;
            }
        }
        for (v, [a, b, c, d]) in pixels.into_iter().enumerate() {
            let from = (y + v - self.top) * self.width;
            let Some(row) = self.pixels.get_mut(from + x..from + self.width) else { return };
            // Block by block in turn, four pixels of each.
            let ((even, even_high), (odd, odd_high)) = (a.interleave(c), b.interleave(d));
            let ((p, q), (r, s)) = (even.interleave(odd), even_high.interleave(odd_high));
            let blocks =
                [three_of_four(simd, p), three_of_four(simd, q), three_of_four(simd, r), three_of_four(simd, s)];
            let blocks = blocks.as_flattened().as_chunks::<16>().0;
            let row = row.as_flattened_mut();
            if let (u16::MAX, Some(row)) = (which, row.get_mut(..16 * BYTES)) {
                // Each block's last four bytes are overwritten by the next one's.
                for (n, block) in blocks[..15].iter().enumerate() {
                    row[n * BYTES..n * BYTES + 16].copy_from_slice(block);
                }
                row[15 * BYTES..].copy_from_slice(&blocks[15][..BYTES]);
                continue;
            }
            let mut left = which;
            while left != 0 {
                let n = left.trailing_zeros() as usize;
                left &= left - 1;
                row[n * BYTES..][..BYTES].copy_from_slice(&blocks[n][..BYTES]);
            }
        }
    }

    /// Like [`Canvas::blend`], with the colours that a custom shader has given to the rays.
    #[inline(never)]
    pub(crate) fn blend_colours<S: Simd, const N: usize>(
        &mut self,
        simd: S,
        colours: &[Rgb; N],
        weights: &[[f32; SIDE * SIDE]; N],
        at: [usize; 2],
    ) {
        simd.vectorize(
            #[inline(always)]
            || {
                let mut packed = i32x16::splat(simd, 0);
                for channel in [2, 1, 0] {
                    let mut light = f32x16::splat(simd, 0.0);
                    for (colour, weights) in colours.iter().zip(weights) {
                        light += f32x16::load_array_ref(simd, weights) * colour[channel];
                    }
                    packed = byte(simd, packed, light);
                }
                self.block(&packed.to_array(), at);
            },
        );
    }

    /// Writes a block's pixels, as far as the rows reach.
    #[inline(always)]
    fn block(&mut self, colours: &[i32; SIDE * SIDE], [x, y]: [usize; 2]) {
        for (row, colours) in colours.chunks_exact(SIDE).enumerate() {
            self.row(colours, [x, y + row]);
        }
    }

    /// Writes some pixels of a row, as far as they exist.
    #[inline(always)]
    fn row(&mut self, colours: &[i32], [x, y]: [usize; 2]) {
        let from = (y - self.top) * self.width;
        let Some(row) = self.pixels.get_mut(from + x..from + self.width) else {
            return;
        };
        if let (&[a, b, c, d], Some(row)) = (colours, row.get_mut(..SIDE)) {
            // Four pixels are three words.
            let words = [a | b << 24, b >> 8 | c << 16, c >> 16 | d << 8];
            for (out, word) in row.as_flattened_mut().chunks_exact_mut(4).zip(words) {
                out.copy_from_slice(&word.to_le_bytes());
            }
        } else {
            for (out, c) in row.iter_mut().zip(colours) {
                let [r, g, b, _] = c.to_le_bytes();
                *out = [r, g, b];
            }
        }
    }
}

/// Returns the pixels of a packet, coloured by the palette or by a custom shader.
#[inline(always)]
fn packed<S: Simd>(simd: S, light: &PacketResult, own: Option<&Colours>) -> [i32; SIDE * SIDE] {
    let load = f32x16::load_array_ref;
    match own {
        None => colours(simd, load(simd, &light.bright), load(simd, &light.tone)),
        Some(own) => {
            let mut packed = i32x16::splat(simd, 0);
            for channel in [2, 1, 0] {
                packed = byte(simd, packed, load(simd, &own[channel]));
            }
            packed.to_array()
        }
    }
}

/// Adds another byte below those already `packed`: a share of light, 0 to 1.
#[inline(always)]
fn byte<S: Simd>(simd: S, packed: i32x16<S>, light: f32x16<S>) -> i32x16<S> {
    let c = light * 255.0 + 0.5;
    let c = c.max(f32x16::splat(simd, 0.0)).min(f32x16::splat(simd, 255.0));
    (packed << 8) | c.to_int::<i32x16<S>>()
}

/// Moves the lower three bytes of four words together, in each quarter.
#[inline(always)]
fn three_of_four<S: Simd>(simd: S, words: i32x16<S>) -> [u8; 64] {
    let bytes: u8x64<S> = words.bitcast();
    bytes.swizzle_dyn_within_blocks(u8x64::load_array_ref(simd, &PICKED)).to_array()
}

/// The bytes that [`three_of_four`] picks, in each quarter.
const PICKED: [u8; 64] = {
    let mut picked = [15; 64];
    let mut n = 0;
    while n < 64 {
        if n % 16 < 12 {
            picked[n] = (n % 16 / 3 * 4 + n % 16 % 3) as u8;
        }
        n += 1;
    }
    picked
};

/// Returns a channel of what light is shown as, 0 to 255, with ½ added so that it is rounded where it is cut off.
#[inline(always)]
fn shown<S: Simd>(light: [f32x16<S>; 2], channel: usize) -> f32x16<S> {
    lit(light, channel) * 255.0 + 0.5
}

/// The least and the greatest values of [`shown`] that are shown as they are.
const LEAST: f32 = 0.5;
const MOST: f32 = 255.5;

/// Returns red, green and blue in the lower three bytes.
#[inline(always)]
fn colours<S: Simd>(simd: S, bright: f32x16<S>, tone: f32x16<S>) -> [i32; SIDE * SIDE] {
    let mut packed = i32x16::splat(simd, 0);
    for channel in [2, 1, 0] {
        packed = byte(simd, packed, lit([bright, tone], channel));
    }
    packed.to_array()
}

/// Returns the light of a channel, 0 to 1, of a brightness and a tone.
#[inline(always)]
fn lit<S: Simd>([bright, tone]: [f32x16<S>; 2], channel: usize) -> f32x16<S> {
    let [base, top] = PALETTE;
    let slope = (top[channel] - base[channel]) / (PALETTE_HU[1] - PALETTE_HU[0]);
    bright * base[channel] + tone * slope
}

#[cfg(test)]
mod tests {
    use std::array::from_fn;

    use proptest::prelude::*;

    use super::*;
    use crate::math::hash;
    use crate::render::packets::levels;
    use crate::render::packets::sampling::WEIGHTS;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        /// On every level, the blocks that are asked for are means of their rays, and no other pixel is touched.
        #[test]
        fn smooth_blocks_are_means_of_their_rays(seed: u64, some: u16, all: bool, left in 0usize..3, right in 0usize..9) {
            let which = if all { u16::MAX } else { some };
            let ray = |block: usize, n: usize| {
                let random = |a: u64| hash::uniform(seed, (5 * block + n) as u64 * 2 + a) as f32;
                // Some are brighter than what can be shown.
                let bright = 1.2 * random(0) - 0.05;
                [bright, bright * (PALETTE_HU[1] - PALETTE_HU[0]) * random(1)]
            };
            let (width, x) = (16 * SIDE + 4 * left + right, 4 * left);
            for (name, level) in levels() {
                let mut pixels = vec![[9; 3]; (SIDE + 2) * width];
                let mut canvas = Canvas::new(&mut pixels, width, 40);
                fearless_simd::dispatch!(level, simd => {
                    let light: [[f32x16<_>; 2]; 5] = from_fn(|n| {
                        [0, 1].map(|field| f32x16::load_array_ref(simd, &from_fn(|block| ray(block, n)[field])))
                    });
                    canvas.blend_row(simd, &light, which, [x, 41]);
                });
                for (n, pixel) in pixels.iter().enumerate() {
                    let [u, v] = [(n % width).wrapping_sub(x), (n / width).wrapping_sub(1)];
                    if u >= 16 * SIDE || v >= SIDE || which >> (u / SIDE) & 1 == 0 {
                        prop_assert_eq!(*pixel, [9; 3], "{} pixel {}", name, n);
                        continue;
                    }
                    let weight = |k: usize| WEIGHTS[k][SIDE * v + u % SIDE];
                    for channel in 0..3 {
                        let [base, top] = PALETTE;
                        let slope = (top[channel] - base[channel]) / (PALETTE_HU[1] - PALETTE_HU[0]);
                        let of = |[bright, tone]: [f32; 2]| (bright * base[channel] + tone * slope) * 255.0;
                        let mean: f32 = (0..5).map(|k| weight(k) * of(ray(u / SIDE, k))).sum::<f32>().clamp(0.0, 255.0);
                        prop_assert!((f32::from(pixel[channel]) - mean).abs() < 0.51, "{} pixel {}: {:?} {}", name, n, pixel, mean);
                    }
                }
            }
        }
    }
}
