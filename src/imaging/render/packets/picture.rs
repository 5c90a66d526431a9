//! Turns packets of rays into pictures.

use std::array::from_fn;
use std::sync::{Mutex, PoisonError};

use fearless_simd::Level;
use rayon::prelude::*;

use super::cells::Cells;
use super::paint::Canvas;
use super::rays::{Rays, SIDE};
use super::refine::Band;
use super::sampling::{BLOCK, ImageSamples, LANES};
use super::wide;
use crate::render::renderer::SQUARE;
use crate::render::{Shader, View, Work};

/// Rows of blocks in a band of the picture.
const ROWS: usize = 2;
/// Side of the tiles in which squares are cast, pixels.
const TILE: usize = SIDE * BLOCK;

/// Runs `$part` on the available SIMD level: AVX-512, AVX2 or NEON, otherwise the baseline of the architecture. More
/// levels would take long to compile, for processors that are rare.
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
                // Every processor of these two architectures has the level above.
                _ => {}
            },
        }
    };
}

pub(crate) use on_level;

/// Runs `part` with the cache of this thread.
fn with_cells<T>(all: &[Mutex<Cells>], part: impl FnOnce(&mut Cells) -> T) -> T {
    let thread = rayon::current_thread_index().unwrap_or(0) % all.len().max(1);
    part(&mut all[thread].lock().unwrap_or_else(PoisonError::into_inner))
}

/// Casts a ray for every pixel.
pub(crate) fn pixels_of(
    rays: &Rays<'_>,
    view: &View,
    pixels: &mut [[u8; 3]],
    cells: &[Mutex<Cells>],
    level: Level,
) -> Work {
    let width = view.width();
    let bands = pixels.par_chunks_mut(width * SIDE).enumerate().map(|(n, band)| {
        with_cells(cells, |cells| {
            let mut canvas = Canvas::new(band, width, n * SIDE);
            let mut work = Work::default();
            on_level!(level, simd => {
                for left in (0..width).step_by(SIDE) {
                    let light = rays.packet(simd, [left, n * SIDE], 1, 0.0, cells);
                    work = work + canvas.packet(simd, &light, rays.colours(cells), [left, n * SIDE]);
                }
            });
            work
        })
    });
    bands.reduce(Work::default, |a, b| a + b)
}

/// Casts a ray for every pixel of the `wanted` squares, row by row of squares.
pub(crate) fn squares_of(
    rays: &Rays<'_>,
    view: &View,
    pixels: &mut [[u8; 3]],
    cells: &[Mutex<Cells>],
    level: Level,
    wanted: &[bool],
) -> Work {
    let width = view.width();
    let across = width.div_ceil(SQUARE);
    let bands = pixels.par_chunks_mut(width * TILE).zip(wanted.par_chunks(across * (TILE / SQUARE))).enumerate();
    let bands = bands.with_max_len(1).map(|(n, (band, wanted))| {
        with_cells(cells, |cells| {
            let mut work = Work::default();
            let top = n * TILE;
            let mut band = Band::new(rays, cells, Canvas::new(band, width, top));
            on_level!(level, simd => {
                // Tile by tile, so that squares that wait for each other are close, and the empty space in front of all
                // of them is leapt over once.
                for left in (0..across).step_by(TILE / SQUARE) {
                    let mut start = None;
                    for (row, wanted) in wanted.chunks(across).enumerate() {
                        for x in (left..across.min(left + TILE / SQUARE)).filter(|&x| wanted[x]) {
                            let corner = [left * SQUARE, top].map(|c| c as f32);
                            let start = start.get_or_insert_with(|| rays.start(simd, corner, [TILE as f32; 2], 0.0));
                            band.square(simd, [x * SQUARE, top + row * SQUARE], *start);
                        }
                    }
                }
                work = band.finish(simd);
            });
            work
        })
    });
    bands.reduce(Work::default, |a, b| a + b)
}

/// True if [`needed`] casts rays where they are needed.
pub(crate) fn is_sampled(rays: &Rays<'_>) -> bool {
    rays.pixel_turn().is_some() && rays.shader.is_none_or(Shader::is_smooth)
}

/// Casts rays where they are needed: those of `levels`, from the widest blocks to the picture's, and more where these are not enough.
///
/// Casts a ray for every pixel if it is unknown how far apart neighbouring rays are, or how a shader colours what lies
/// between them: it is not [smooth](crate::render::Shader::is_smooth).
pub(crate) fn needed(
    levels: &mut Vec<ImageSamples>,
    rays: &Rays<'_>,
    view: &View,
    pixels: &mut [[u8; 3]],
    cells: &[Mutex<Cells>],
    level: Level,
) -> Work {
    let Some(turn) = rays.pixel_turn().filter(|_| is_sampled(rays)) else {
        return pixels_of(rays, view, pixels, cells, level);
    };
    let width = view.width();
    let own_colours = rays.shader.is_some();
    let doublings = wide::doublings(turn);
    levels.resize_with(doublings + 1, ImageSamples::default);
    let side = |n: usize| BLOCK << (doublings - n);
    let blocks = |n: usize| [width, view.height()].map(|s| s.div_ceil(side(n)));
    for (n, level) in levels.iter_mut().enumerate() {
        level.resize([width, view.height()], side(n), own_colours);
    }
    let far = levels[0].rows().enumerate().with_max_len(1).map(|(n, mut rows)| {
        with_cells(cells, |cells| {
            let mut work = Work::default();
            on_level!(level, simd => work = wide::cast(simd, rays, cells, &mut rows, n, (side(0), blocks(0))));
            work
        })
    });
    let mut first = far.reduce(Work::default, |a, b| a + b);
    for n in 1..levels.len() {
        let (wide, narrow) = levels.split_at_mut(n);
        let wide = (&wide[n - 1], turn * side(n - 1) as f32);
        let own = (side(n), blocks(n));
        let more = narrow[0].rows().enumerate().with_max_len(1).map(|(n, mut rows)| {
            with_cells(cells, |cells| {
                let mut work = Work::default();
                on_level!(level, simd => work = wide::fill(simd, rays, cells, wide, &mut rows, n, own));
                work
            })
        });
        first = first + more.reduce(Work::default, |a, b| a + b);
    }
    let samples = &levels[doublings];
    let side = turn * BLOCK as f32;
    let blocks = blocks(doublings)[0];
    let bands = pixels.par_chunks_mut(width * BLOCK * ROWS).enumerate().with_max_len(1).map(|(n, band)| {
        with_cells(cells, |cells| {
            let mut work = Work::default();
            let rows = band.len().div_ceil(width * BLOCK);
            let mut band = Band::new(rays, cells, Canvas::new(band, width, n * ROWS * BLOCK));
            on_level!(level, simd => {
                for first in (0..blocks).step_by(LANES) {
                    let verdicts: [_; ROWS] = from_fn(|row| samples.judge(simd, [first, n * ROWS + row.min(rows - 1)], side));
                    // Most blocks are smooth: sixteen of them take little longer than one.
                    let whole = match (width / BLOCK).saturating_sub(first) {
                        some @ 0..LANES => (1 << some) - 1,
                        _ => u16::MAX,
                    };
                    let mut filled = [0; ROWS];
                    for (row, verdict) in verdicts.iter().enumerate().take(rows) {
                        let which = verdict.smooth & whole;
                        if which != 0 && !samples.has_colours() {
                            let block = [first, n * ROWS + row];
                            band.smooth_row(simd, samples, block, which, block.map(|b| b * BLOCK));
                            filled[row] = which;
                        }
                    }
                    // Column by column, so that blocks that wait for each other are close.
                    for (x, row) in (first..blocks.min(first + LANES)).flat_map(|x| (0..rows).map(move |row| (x, row))) {
                        let (block, bit) = ([x, n * ROWS + row], 1 << (x - first));
                        if filled[row] & bit != 0 {
                            continue;
                        }
                        let at = block.map(|b| b * BLOCK);
                        if verdicts[row].smooth & bit != 0 {
                            band.smooth(simd, &samples.block(block), samples.colours(block).as_ref(), at);
                        } else if verdicts[row].subdivided & bit != 0 {
                            band.coarse(simd, samples.block(block), samples.colours(block), at, samples.start(block));
                        } else {
                            band.rough(simd, at, samples.start(block));
                        }
                    }
                }
                work = band.finish(simd);
            });
            work
        })
    });
    first + bands.reduce(Work::default, |a, b| a + b)
}
