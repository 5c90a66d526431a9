//! Turns light into pixels.

use fearless_simd::{Simd, f32x16, i32x16, prelude::*};

use super::cells::Colours;
use super::rays::{PacketResult, SIDE};
use super::sampling::Rgb;
use crate::render::Work;
use crate::render::renderer::SQUARE;
use crate::render::transfer::{PALETTE, PALETTE_HU};

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

    /// Fills those of sixteen blocks in a row whose bit is set like [`Canvas::blend`] does, with a lane for each block. Their light is that of
    /// the rays of each block, in the order of the weights; the first block is at pixel `at`, and all are within the picture's width.
    #[inline(always)]
    pub(crate) fn blend_row<S: Simd, const N: usize>(
        &mut self,
        simd: S,
        light: &[[f32x16<S>; 2]; N],
        weights: &[[f32; SIDE * SIDE]; N],
        which: u16,
        [x, y]: [usize; 2],
    ) {
        for v in 0..SIDE {
            let from = (y + v - self.top) * self.width;
            let Some(row) = self.pixels.get_mut(from + x..from + self.width) else { return };
            // No closures: they do not inherit the level's instructions.
            let mut pixels = [i32x16::splat(simd, 0); SIDE];
            for (u, pixel) in pixels.iter_mut().enumerate() {
                let (mut bright, mut tone) = (f32x16::splat(simd, 0.0), f32x16::splat(simd, 0.0));
                for ([b, t], weights) in light.iter().zip(weights) {
                    let weight = f32x16::splat(simd, weights[SIDE * v + u]);
                    bright += weight * *b;
                    tone += weight * *t;
                }
                *pixel = packed_lanes(simd, bright, tone);
            }
            let [a, b, c, d] = pixels;
            // Four pixels are three words.
            let words = [(a | b << 24).to_array(), ((b >> 8) | c << 16).to_array(), ((c >> 16) | d << 8).to_array()];
            for (n, out) in row.as_flattened_mut().chunks_exact_mut(3 * SIDE).take(16).enumerate() {
                if which >> n & 1 == 1 {
                    for (out, words) in out.chunks_exact_mut(4).zip(&words) {
                        out.copy_from_slice(&words[n].to_le_bytes());
                    }
                }
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

/// Returns red, green and blue in the lower three bytes.
#[inline(always)]
fn colours<S: Simd>(simd: S, bright: f32x16<S>, tone: f32x16<S>) -> [i32; SIDE * SIDE] {
    packed_lanes(simd, bright, tone).to_array()
}

/// Same as [`colours`], as a vector.
#[inline(always)]
fn packed_lanes<S: Simd>(simd: S, bright: f32x16<S>, tone: f32x16<S>) -> i32x16<S> {
    let [base, top] = PALETTE;
    let mut packed = i32x16::splat(simd, 0);
    for channel in [2, 1, 0] {
        let slope = (top[channel] - base[channel]) / (PALETTE_HU[1] - PALETTE_HU[0]);
        packed = byte(simd, packed, bright * base[channel] + tone * slope);
    }
    packed
}
