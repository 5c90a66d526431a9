//! From packets of rays to pictures.

use std::array::from_fn;
use std::sync::{Mutex, PoisonError};

use fearless_simd::{Level, Simd, f32x16, i32x16, prelude::*};
use rayon::prelude::*;

use super::cells::Cells;
use super::lattice::{BLOCK, Block, Point, WEIGHTS};
use super::packet::{Light, Rays};
use crate::render::transfer::{PALETTE, PALETTE_HU};
use crate::render::{View, Work};

/// Side of a packet, rays.
const SIDE: usize = 4;

/// Does something on the SIMD level that is there: AVX-512, AVX2 or NEON, else on what every processor of the kind has.
/// More levels would take long to compile, for processors that are hardly about.
macro_rules! on_level {
    ($level:expr, $simd:ident => $part:expr) => {
        match $level {
            #[cfg(target_arch = "x86_64")]
            Level::Avx512($simd) => $part,
            #[cfg(target_arch = "x86_64")]
            Level::Avx2($simd) => $part,
            #[cfg(target_arch = "aarch64")]
            Level::Neon($simd) => $part,
            _ => match Level::baseline() {
                #[cfg(target_arch = "x86_64")]
                Level::Sse2($simd) => $part,
                #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
                Level::Fallback($simd) => $part,
                // Every processor of these two kinds has the level above.
                _ => {}
            },
        }
    };
}

/// Runs `part` with the cache of this thread.
fn with_cells<T>(all: &[Mutex<Cells>], part: impl FnOnce(&mut Cells) -> T) -> T {
    let thread = rayon::current_thread_index().unwrap_or(0) % all.len().max(1);
    part(&mut all[thread].lock().unwrap_or_else(PoisonError::into_inner))
}

/// A packet of rays `apart` pixels from each other, the first through the centre of pixel (`x`, `y`); nothing may be met
/// before `from` steps.
#[inline(always)]
fn packet<S: Simd>(simd: S, rays: &Rays<'_>, [x, y]: [usize; 2], apart: usize, from: f32, cells: &mut Cells) -> Light {
    let at = |first: usize, n: usize| (first + n * apart) as f32 + 0.5;
    let mut light = Light::default();
    rays.cast(simd, [&from_fn(|n| at(x, n % SIDE)), &from_fn(|n| at(y, n / SIDE))], from, cells, &mut light);
    light
}

/// A ray for every pixel, or for those of the `wanted` packets, row by row of packets.
pub fn pixels_of(
    rays: &Rays<'_>,
    view: &View,
    pixels: &mut [[u8; 3]],
    cells: &[Mutex<Cells>],
    level: Level,
    wanted: Option<&[bool]>,
) -> Work {
    let width = view.width();
    let across = width.div_ceil(SIDE);
    let is_wanted = |n: usize| wanted.is_none_or(|w| w.get(n).copied().unwrap_or(true));
    let bands = pixels.par_chunks_mut(width * SIDE).enumerate().map(|(n, band)| {
        with_cells(cells, |cells| {
            let mut work = Work::default();
            on_level!(level, simd => {
                for left in (0..width).step_by(SIDE).filter(|left| is_wanted(n * across + left / SIDE)) {
                    let light = packet(simd, rays, [left, n * SIDE], 1, 0.0, cells);
                    work = work + fill(simd, &light, left, width, band);
                }
            });
            work
        })
    });
    bands.reduce(Work::default, |a, b| a + b)
}

/// Writes a packet's pixels into the band of rows that it lies in.
#[inline(never)]
fn fill<S: Simd>(simd: S, light: &Light, left: usize, width: usize, band: &mut [[u8; 3]]) -> Work {
    simd.vectorize(
        #[inline(always)]
        || {
            let load = f32x16::load_array_ref;
            paint(simd, load(simd, &light.bright), load(simd, &light.tone), left, width, band);
        },
    );
    let rays = SIDE.min(width - left) * (band.len() / width);
    Work { rays: rays as u64, samples: u64::from(light.samples), ..Work::default() }
}

/// The rays through the corners and centres of a picture's blocks.
#[derive(Default)]
pub struct Lattice {
    /// Corners in a row, of blocks and up to the next whole packet.
    stride: usize,
    corners: Vec<Point>,
    centres: Vec<Point>,
    /// How many steps nothing is met by any ray among those of a packet of the lattice.
    starts: Vec<f32>,
}

impl Lattice {
    /// Renders a picture with rays where they are needed.
    pub fn render(
        &mut self,
        rays: &Rays<'_>,
        view: &View,
        pixels: &mut [[u8; 3]],
        cells: &[Mutex<Cells>],
        level: Level,
    ) -> Work {
        let (width, height) = (view.width(), view.height());
        self.stride = (width.div_ceil(BLOCK) + 1).next_multiple_of(SIDE);
        let rows = (height.div_ceil(BLOCK) + 1).next_multiple_of(SIDE);
        self.corners.resize(self.stride * rows, Point::default());
        self.centres.resize(self.stride * rows, Point::default());
        self.starts.resize(self.stride / SIDE * rows / SIDE, 0.0);
        let stride = self.stride;
        let groups = self.corners.par_chunks_mut(stride * SIDE).zip(self.centres.par_chunks_mut(stride * SIDE));
        let groups = groups.zip(self.starts.par_chunks_mut(stride / SIDE));
        let first = groups.enumerate().with_max_len(1).map(|(n, ((corners, centres), starts))| {
            with_cells(cells, |cells| {
                let mut work = Work::default();
                on_level!(level, simd => {
                    for (left, start) in (0..stride).step_by(SIDE).zip(starts) {
                        let (x, y) = (left * BLOCK, n * SIDE * BLOCK);
                        *start = rays.start(simd, x as f32, y as f32, (SIDE * BLOCK) as f32);
                        let light = packet(simd, rays, [x, y], BLOCK, *start, cells);
                        work = work + keep(&light, rays.step(), left, stride, corners);
                        let light = packet(simd, rays, [x + BLOCK / 2, y + BLOCK / 2], BLOCK, *start, cells);
                        work = work + keep(&light, rays.step(), left, stride, centres);
                    }
                });
                work
            })
        });
        let first = first.reduce(Work::default, |a, b| a + b);
        let (corners, centres, starts) = (&self.corners, &self.centres, &self.starts);
        let side = view.pixel() as f32 * BLOCK as f32;
        let bands = pixels.par_chunks_mut(width * BLOCK).enumerate().with_max_len(2).map(|(n, band)| {
            with_cells(cells, |cells| {
                let mut work = Work::default();
                on_level!(level, simd => {
                    for left in (0..width).step_by(BLOCK) {
                        let at = n * stride + left / BLOCK;
                        let at_start = n / SIDE * (stride / SIDE) + left / BLOCK / SIDE;
                        let block = Block {
                            corners: [corners[at], corners[at + 1], corners[at + stride], corners[at + stride + 1]],
                            centre: centres[at],
                        };
                        if block.is_smooth(side) {
                            interpolate(simd, &block, left, width, band);
                        } else {
                            let light = packet(simd, rays, [left, n * BLOCK], 1, starts[at_start], cells);
                            work = work + fill(simd, &light, left, width, band);
                        }
                    }
                });
                work
            })
        });
        first + bands.reduce(Work::default, |a, b| a + b)
    }

    /// Memory taken.
    pub fn bytes(&self) -> usize {
        (self.corners.len() + self.centres.len()) * size_of::<Point>() + size_of_val(self.starts.as_slice())
    }
}

/// Keeps the rays of a packet of the lattice.
fn keep(light: &Light, step: f32, left: usize, stride: usize, points: &mut [Point]) -> Work {
    for n in 0..SIDE * SIDE {
        points[n / SIDE * stride + left + n % SIDE] = Point::new(light, n, step);
    }
    Work { rays: (SIDE * SIDE) as u64, samples: u64::from(light.samples), ..Work::default() }
}

/// Fills a block's pixels from its rays.
#[inline(never)]
fn interpolate<S: Simd>(simd: S, block: &Block, left: usize, width: usize, band: &mut [[u8; 3]]) {
    simd.vectorize(
        #[inline(always)]
        || {
            let (mut bright, mut tone) = (f32x16::splat(simd, 0.0), f32x16::splat(simd, 0.0));
            let [a, b, c, d] = block.corners;
            for (point, weights) in [a, b, c, d, block.centre].iter().zip(&WEIGHTS) {
                let weights = f32x16::load_array_ref(simd, weights);
                bright += weights * point.bright;
                tone += weights * point.tone;
            }
            paint(simd, bright, tone, left, width, band);
        },
    );
}

/// Writes the colours of a packet's pixels into the band of rows that it lies in, as far as the picture reaches.
#[inline(always)]
fn paint<S: Simd>(simd: S, bright: f32x16<S>, tone: f32x16<S>, left: usize, width: usize, band: &mut [[u8; 3]]) {
    let [base, top] = PALETTE;
    let mut packed = i32x16::splat(simd, 0);
    for channel in [2, 1, 0] {
        let slope = (top[channel] - base[channel]) / (PALETTE_HU[1] - PALETTE_HU[0]);
        let c = (bright * base[channel] + tone * slope) * 255.0 + 0.5;
        let c = c.max(f32x16::splat(simd, 0.0)).min(f32x16::splat(simd, 255.0));
        packed = (packed << 8) | c.to_int::<i32x16<S>>();
    }
    let packed = packed.as_array();
    for (y, row) in band.chunks_exact_mut(width).enumerate() {
        for (out, c) in row[left..].iter_mut().take(SIDE).zip(&packed[SIDE * y..]) {
            let [r, g, b, _] = c.to_le_bytes();
            *out = [r, g, b];
        }
    }
}
