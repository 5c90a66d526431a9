//! A sparse picture over another: only the pixels that are not transparent, ready for blending.

use std::ops::Range;

use rayon::prelude::*;

use crate::render::Frame;

/// Rows per task.
const ROWS: usize = 32;

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
    /// Extracts the pixels of a canvas that are not transparent. The canvas has `width` pixels per row.
    pub(crate) fn of(canvas: &[Bgra], width: usize) -> Self {
        let mut layer = Self::default();
        for row in canvas.chunks_exact(width.max(1)) {
            let mut runs: Vec<Run> = Vec::new();
            let mut x = 0;
            while let Some(start) = row[x..].iter().position(|p| *p != [0; 4]).map(|n| x + n) {
                let end = row[start..].iter().position(|p| *p == [0; 4]).map_or(row.len(), |n| start + n);
                runs.push(Run { columns: start..end, first: layer.pixels.len() });
                // Limit colours to alpha, so that no sum of two overflows.
                layer.pixels.extend(
                    row[start..end].iter().map(|&[b, g, r, a]| u32::from_le_bytes([b.min(a), g.min(a), r.min(a), a])),
                );
                x = end;
            }
            layer.rows.push(runs);
        }
        layer
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
    fn cover(&self, y: usize, out: &mut [u32]) {
        for run in self.rows.get(y).into_iter().flatten() {
            let over = &self.pixels[run.first..][..run.columns.len()];
            // A wider layer is cut off.
            for (out, &over) in out.iter_mut().skip(run.columns.start).zip(over) {
                *out = blend(*out, over);
            }
        }
    }
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
    out.par_chunks_mut(ROWS * width).enumerate().for_each(|(band, out)| {
        for (n, row) in out.chunks_exact_mut(width).enumerate() {
            let y = band * ROWS + n;
            if !pictures.iter().any(|p| p.at.0 == 0 && p.row(y).is_some_and(|r| r.len() >= width)) {
                row.fill(0);
            }
            for picture in pictures {
                if let (Some(pixels), Some(out)) = (picture.row(y), row.get_mut(picture.at.0..)) {
                    let shown = pixels.len().min(out.len());
                    copy(&pixels[..shown], &mut out[..shown]);
                }
            }
            layer.cover(y, row);
        }
    });
}

/// Converts red, green and blue to `0x00RRGGBB`. Four pixels are twelve bytes, read as words.
fn copy(pixels: &[[u8; 3]], out: &mut [u32]) {
    let (four, rest) = pixels.as_chunks::<4>();
    let (out_four, out_rest) = out.as_chunks_mut::<4>();
    for (out, four) in out_four.iter_mut().zip(four) {
        let b = four.as_flattened();
        *out = [
            u32::from_be_bytes([b[0], b[1], b[2], b[3]]) >> 8,
            u32::from_be_bytes([b[3], b[4], b[5], b[6]]) >> 8,
            u32::from_be_bytes([b[6], b[7], b[8], b[9]]) >> 8,
            u32::from_be_bytes([b[8], b[9], b[10], b[11]]) & 0x00ff_ffff,
        ];
    }
    for (out, &[r, g, b]) in out_rest.iter_mut().zip(rest) {
        *out = u32::from_be_bytes([0, r, g, b]);
    }
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
        let mut canvas = vec![[0u8; 4]; 40 * 70];
        canvas[40 * 33 + 5..40 * 33 + 9].fill([10, 20, 30, 255]);
        canvas[40 * 69 + 39] = [0, 0, 100, 128];
        let layer = Layer::of(&canvas, 40);
        assert_eq!(layer.pixels.len(), 5);
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

    #[test]
    fn red_stays_red() {
        for n in 1..9 {
            let pixels: Vec<[u8; 3]> = (0..n).map(|n| [200 + n, 100 + n, n]).collect();
            let mut out = vec![0; pixels.len()];
            copy(&pixels, &mut out);
            for (o, &[r, g, b]) in out.iter().zip(&pixels) {
                assert_eq!(*o, u32::from(r) << 16 | u32::from(g) << 8 | u32::from(b));
            }
        }
    }
}
