//! A sparse picture over another: only the pixels that are not transparent, ready for blending.

use std::ops::Range;

use fearless_simd::Level;
use rayon::prelude::*;

use crate::render::Frame;
use crate::render::words::to_words;

/// Rows per task.
const ROWS: usize = 32;
/// At least so many transparent pixels part runs.
const GAP: usize = 16;

/// A pixel in the format of the window's painter: blue, green and red, multiplied by alpha, then alpha.
pub(crate) type Bgra = [u8; 4];

/// A horizontal run of pixels.
#[derive(Clone, Debug)]
struct Run {
    /// Columns in their row.
    columns: Range<usize>,
    /// Index of the first pixel in [`Layer::pixels`].
    first: usize,
}

/// The pixels of a layer that are not transparent.
#[derive(Clone, Debug, Default)]
pub(crate) struct Layer {
    /// Runs of each row.
    rows: Vec<Vec<Run>>,
    /// `0xAARRGGBB`, colours multiplied by alpha.
    pixels: Vec<u32>,
}

impl Layer {
    /// Takes the pixels of a canvas that are not transparent, in place of what the layer held, whose memory is used again. The canvas has
    /// `width` pixels per row.
    pub(crate) fn fill(&mut self, canvas: &[Bgra], width: usize) {
        fearless_simd::dispatch!(Level::new(), _simd => self.extract(canvas, width));
    }

    #[inline(always)]
    fn extract(&mut self, canvas: &[Bgra], width: usize) {
        let Self { rows, pixels } = self;
        pixels.clear();
        let lines = canvas.chunks_exact(width.max(1));
        rows.resize_with(lines.len(), Vec::new);
        for (row, runs) in lines.zip(rows) {
            runs.clear();
            let mut x = 0;
            while let Some(columns) = next_run(row, x) {
                x = columns.end;
                let first = pixels.len();
                // Limit colours to alpha, so that no sum of two overflows.
                pixels.extend(
                    row[columns.clone()]
                        .iter()
                        .map(|&[b, g, r, a]| u32::from_le_bytes([b.min(a), g.min(a), r.min(a), a])),
                );
                runs.push(Run { columns, first });
            }
        }
    }

    /// Blends it over a picture.
    pub(crate) fn cover_frame(&self, picture: &mut Frame) {
        let width = picture.width().max(1);
        let rows = picture.buffers().0.chunks_exact_mut(width);
        for (pixels, runs) in rows.zip(&self.rows) {
            for run in runs {
                let over = &self.pixels[run.first..][..run.columns.len()];
                for (pixel, &over) in pixels[run.columns.clone()].iter_mut().zip(over) {
                    let [r, g, b] = pixel.map(u32::from);
                    let [_, r, g, b] = blend(r << 16 | g << 8 | b, over).to_be_bytes();
                    *pixel = [r, g, b];
                }
            }
        }
    }

    /// Blends it over row `y` of a picture of `0x00RRGGBB`.
    #[inline(always)]
    fn cover(&self, y: usize, out: &mut [u32]) {
        for run in self.rows.get(y).into_iter().flatten() {
            let over = &self.pixels[run.first..][..run.columns.len()];
            // A wider layer is cut off.
            let Some(out) = out.get_mut(run.columns.start..) else { continue };
            for (out, &over) in out.iter_mut().zip(over) {
                *out = blend(*out, over);
            }
        }
    }
}

/// Returns the next run of pixels from column `x` on. A few transparent pixels within one cost less than another run.
#[inline(always)]
fn next_run(row: &[Bgra], x: usize) -> Option<Range<usize>> {
    let is_clear = |p: &Bgra| u32::from_le_bytes(*p) == 0;
    // Several at once, without a branch for each.
    let are_clear = |part: &[Bgra]| part.iter().fold(0, |all, p| all | u32::from_le_bytes(*p)) == 0;
    let clear = row[x..].chunks_exact(GAP).take_while(|part| are_clear(part)).count() * GAP;
    let start = x + clear + row[x + clear..].iter().position(|p| !is_clear(p))?;
    let part = |end: usize| row.get(end..end + GAP).unwrap_or(&row[end..]);
    let mut end = start;
    while !are_clear(part(end)) {
        end += part(end).len();
    }
    let beyond = row[start..end].iter().rev().take_while(|p| is_clear(p)).count();
    Some(start..end - beyond)
}

/// Computes `over + under · (1 − alpha)`, two colours at a time.
#[inline(always)]
fn blend(under: u32, over: u32) -> u32 {
    const TWO: u32 = 0x00ff_00ff;
    let clear = 255 - (over >> 24);
    // x / 255, rounded, is (x + 128 + ((x + 128) >> 8)) >> 8.
    let part = |two: u32| {
        let x = two * clear + 0x0080_0080;
        ((x + ((x >> 8) & TWO)) >> 8) & TWO
    };
    let (red_blue, green) = (part(under & TWO), part((under >> 8) & TWO));
    (over & 0x00ff_ffff) + red_blue + ((green & 0xff) << 8)
}

/// A picture placed in a window.
#[derive(Clone, Copy)]
pub(crate) struct Placed<'a> {
    /// Its upper left corner, pixels.
    pub at: (usize, usize),
    /// The picture.
    pub frame: &'a Frame,
}

impl Placed<'_> {
    /// Returns its pixels in row `y` of the window; `None` if it does not cover that row.
    fn row(&self, y: usize) -> Option<&[[u8; 3]]> {
        let row = y.checked_sub(self.at.1).filter(|&r| r < self.frame.height())?;
        self.frame.pixels().get(row * self.frame.width()..(row + 1) * self.frame.width())
    }
}

/// Fills `out`, `0x00RRGGBB` and `width` pixels per row, with the `pictures`, black around them, and blends the layer over them.
pub(crate) fn compose(pictures: &[Placed<'_>], layer: &Layer, out: &mut [u32], width: usize) {
    if width == 0 {
        return;
    }
    let level = Level::new();
    out.par_chunks_mut(ROWS * width).enumerate().for_each(|(band, out)| {
        fearless_simd::dispatch!(level, _simd => fill(level, (band * ROWS, out), pictures, layer, width));
    });
}

/// Fills the rows from `first` on.
#[inline(always)]
fn fill(level: Level, (first, out): (usize, &mut [u32]), pictures: &[Placed<'_>], layer: &Layer, width: usize) {
    for (n, row) in out.chunks_exact_mut(width).enumerate() {
        let y = first + n;
        fill_between(pictures, y, row);
        for picture in pictures {
            if let (Some(pixels), Some(out)) = (picture.row(y), row.get_mut(picture.at.0..)) {
                to_words(level, pixels, out);
            }
        }
        layer.cover(y, row);
    }
}

/// Fills with black what no picture covers in row `y`; where they overlap, or come in no order, also some of what one covers.
#[inline(always)]
fn fill_between(pictures: &[Placed<'_>], y: usize, row: &mut [u32]) {
    let mut done = 0;
    for picture in pictures {
        if let Some(pixels) = picture.row(y) {
            let begin = picture.at.0.min(row.len());
            if let Some(gap) = row.get_mut(done..begin) {
                gap.fill(0);
            }
            if begin >= done {
                done = (begin + pixels.len()).min(row.len());
            }
        }
    }
    row[done..].fill(0);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blending_is_that_of_each_colour() {
        for alpha in [0u32, 1, 77, 128, 254, 255] {
            for c in [0u32, 1, 100, 254, 255] {
                let over = (c * alpha).div_ceil(255).min(alpha);
                for under in [0u32, 3, 128, 255] {
                    let out =
                        blend(under << 16 | (255 - under) << 8 | under, alpha << 24 | over << 16 | over << 8 | over);
                    let one = |u: u32| over + (f64::from(u * (255 - alpha)) / 255.0).round() as u32;
                    let expected = one(under) << 16 | one(255 - under) << 8 | one(under);
                    assert_eq!(out, expected, "{under} under {over} of {alpha}");
                }
            }
        }
    }

    #[test]
    fn only_what_is_not_clear_is_laid_over() {
        // What the layer held before, a larger canvas, leaves nothing behind.
        let mut layer = Layer::default();
        layer.fill(&vec![[9, 9, 9, 255]; 50 * 80], 50);
        assert_eq!((layer.rows.len(), layer.pixels.len()), (80, 50 * 80));
        let mut canvas = vec![[0u8; 4]; 40 * 70];
        canvas[40 * 33 + 5..40 * 33 + 9].fill([10, 20, 30, 255]);
        canvas[40 * 69 + 39] = [0, 0, 100, 128];
        layer.fill(&canvas, 40);
        assert_eq!((layer.rows.len(), layer.pixels.len()), (70, 5));
        let mut out = vec![9; 40 * 70];
        compose(&[], &layer, &mut out, 40);
        for (n, &p) in out.iter().enumerate() {
            let expected = match n {
                1325..1329 => 0x001e_140a,
                2799 => 0x0064_0000,
                _ => 0,
            };
            assert_eq!(p, expected, "{n}");
        }
        compose(&[], &layer, &mut [], 0);
    }

    #[test]
    fn pictures_lie_where_they_are_placed() {
        let colour = |c: u8| {
            let mut frame = Frame::new(5, 4);
            frame.buffers().0.fill([c, 0, 1]);
            frame
        };
        let (a, b) = (colour(1), colour(2));
        for (left, top) in [(0, 0), (3, 2), (8, 5), (9, 0), (40, 40)] {
            let mut out = vec![9; 12 * 7];
            let placed = [Placed { at: (left, top), frame: &a }, Placed { at: (6, 3), frame: &b }];
            compose(&placed, &Layer::default(), &mut out, 12);
            for (n, &p) in out.iter().enumerate() {
                let (x, y) = (n % 12, n / 12);
                let on = |at: (usize, usize)| (at.0..at.0 + 5).contains(&x) && (at.1..at.1 + 4).contains(&y);
                let expected = if on((6, 3)) {
                    0x0002_0001
                } else if on((left, top)) {
                    0x0001_0001
                } else {
                    0
                };
                assert_eq!(p, expected, "{left} {top}: {x} {y}");
            }
        }
    }
}
