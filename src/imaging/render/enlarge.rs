//! Bilinear stretching of a picture to a larger one.

use fearless_simd::{Level, Simd, prelude::*, u8x64, u16x32};
use rayon::prelude::*;

use super::frame::Frame;
use super::words::{BLOCK, blocks};

/// Rows of a task.
const ROWS: usize = 32;

/// The position of a pixel of the larger picture in the smaller one.
///
/// It is the first of two neighbours and the weight of the second, out of 256. The weight is 0 if there is no second one.
#[derive(Clone, Copy, Debug)]
struct Between {
    low: u32,
    share: u16,
}

/// Returns the neighbours of each of `n` pixels in a line of `m`. Pixels are squares, so their centres are at halves.
fn between(n: usize, m: usize) -> impl Fn(usize) -> Between {
    let scale = m as f64 / n.max(1) as f64;
    move |x| {
        let at = ((x as f64 + 0.5) * scale - 0.5).clamp(0.0, m.saturating_sub(1) as f64);
        let low = at as usize;
        Between { low: low as u32, share: ((at - low as f64) * 256.0) as u16 }
    }
}

/// Returns bytes interpolated between two; `share` is the weight of the second, out of 256, for each pair of bytes.
#[inline(always)]
fn mix<S: Simd>(simd: S, a: u8x64<S>, b: u8x64<S>, share: u16x32<S>) -> u8x64<S> {
    let (a, b): (u16x32<S>, u16x32<S>) = (a.bitcast(), b.bitcast());
    let low = u16x32::splat(simd, 0xff);
    let (even, odd) =
        (between_two(simd, a & low, b & low, share) >> 8, between_two(simd, a >> 8, b >> 8, share) & !low);
    (even | odd).bitcast()
}

/// Returns 256 times what lies between two, and a half more. No sum is below zero or above sixteen bits.
#[inline(always)]
fn between_two<S: Simd>(simd: S, a: u16x32<S>, b: u16x32<S>, share: u16x32<S>) -> u16x32<S> {
    (a << 8) + (b - a) * share + u16x32::splat(simd, 0x80)
}

/// Returns bytes interpolated between two.
#[inline(always)]
fn mixed<S: Simd>(simd: S, a: &[u8; 64], b: &[u8; 64], share: u16x32<S>) -> [u8; 64] {
    mix(simd, u8x64::load_array_ref(simd, a), u8x64::load_array_ref(simd, b), share).to_array()
}

/// Pixels that are stretched at once.
const LANES: usize = 16;
/// Those of them that are next to each other in one block of bytes.
const OF_BLOCK: usize = 4;
/// Picks four pixels of three bytes from four words.
const PACKED: [u8; 64] = {
    let mut picked = [0; 64];
    let mut n = 0;
    while n < 64 {
        let byte = n % BLOCK;
        picked[n] = if byte < 12 { byte + byte / 3 } else { 15 } as u8;
        n += 1;
    }
    picked
};

/// Sixteen columns of the larger picture; those beyond its edge are as the last one.
#[derive(Clone, Debug)]
struct Columns {
    /// Where the bytes of each four of them begin in a row of the smaller picture.
    first: [u32; OF_BLOCK],
    /// The left and the right neighbours of each, as bytes from there on.
    picked: [[u8; 64]; 2],
    /// The weight of the right one, out of 256, twice.
    shares: [u16; 32],
}

impl Columns {
    /// Returns the columns at `places` of a picture that is not wider than the larger one, so that the neighbours of four lie
    /// within a block.
    fn new(places: [Between; LANES]) -> Self {
        let fours = places.as_chunks::<OF_BLOCK>().0;
        let first = std::array::from_fn(|n| 3 * fours[n][0].low);
        let picked = [0, 1].map(|right| {
            std::array::from_fn(|byte| {
                let place = places[byte / 4];
                (3 * (place.low + right) - first[byte / BLOCK]) as u8 + byte as u8 % 4
            })
        });
        Self { first, picked, shares: std::array::from_fn(|n| places[n / 2].share) }
    }
}

/// Stretches pictures and keeps its working memory from one to the next.
#[derive(Clone, Debug, Default)]
pub(crate) struct Enlarger {
    columns: Vec<Columns>,
    bands: Vec<Band>,
}

/// Working memory for a band of the larger picture's rows.
#[derive(Clone, Debug, Default)]
struct Band {
    /// A row of the smaller picture, and as many bytes more as are read together.
    row: Vec<u8>,
    /// The two stretched rows of the smaller picture that surround a row of the larger one, and as many bytes more as are written
    /// together.
    wide: [Vec<u8>; 2],
}

impl Band {
    /// Stretches a row of the smaller picture horizontally into one of the two.
    #[inline(always)]
    fn widen<S: Simd>(&mut self, simd: S, n: usize, row: &[[u8; 3]], columns: &[Columns]) {
        self.row.clear();
        self.row.extend_from_slice(row.as_flattened());
        self.row.extend_from_slice(&[0; 2 * BLOCK]);
        let wide = &mut self.wide[n];
        wide.resize(columns.len() * LANES * 3 + BLOCK, 0);
        let packed = u8x64::load_array_ref(simd, &PACKED);
        for (n, Columns { first, picked, shares }) in columns.iter().enumerate() {
            let near = blocks(simd, first.map(|at| self.row[at as usize..].first_chunk().unwrap_or(&[0; BLOCK])));
            let left = near.swizzle_dyn_within_blocks(u8x64::load_array_ref(simd, &picked[0]));
            let right = near.swizzle_dyn_within_blocks(u8x64::load_array_ref(simd, &picked[1]));
            let mixed = mix(simd, left, right, u16x32::load_array_ref(simd, shares));
            let mixed = mixed.swizzle_dyn_within_blocks(packed).to_array();
            // Each writes over what the one before it wrote beyond its four pixels.
            for (four, bytes) in mixed.as_chunks::<BLOCK>().0.iter().enumerate() {
                if let Some(out) = wide[(n * OF_BLOCK + four) * 12..].first_chunk_mut() {
                    *out = *bytes;
                }
            }
        }
    }

    /// Fills rows `first..` of the larger picture.
    #[inline(always)]
    fn fill<S: Simd>(
        &mut self,
        simd: S,
        (first, rows): (usize, &mut [[u8; 3]]),
        (width, columns): (usize, &[Columns]),
        small: &Frame,
        row_of: impl Fn(usize) -> Between,
    ) {
        let row = |y: u32| &small.pixels()[y as usize * small.width()..][..small.width()];
        let last = small.height() as u32 - 1;
        let mut held = [u32::MAX; 2];
        for (n, out) in rows.chunks_exact_mut(width).enumerate() {
            let y = row_of(first + n);
            // The lower row becomes the upper one, now or soon.
            if held[1] == y.low {
                held.swap(0, 1);
                self.wide.swap(0, 1);
            }
            for (n, y) in [y.low, (y.low + 1).min(last)].into_iter().enumerate() {
                if held[n] != y {
                    held[n] = y;
                    self.widen(simd, n, row(y), columns);
                }
            }
            let share = u16x32::splat(simd, y.share);
            let [above, below] = self.wide.each_ref().map(|row| row.as_chunks::<64>());
            let (out, rest) = out.as_flattened_mut().as_chunks_mut::<64>();
            for ((out, above), below) in out.iter_mut().zip(above.0).zip(below.0) {
                *out = mixed(simd, above, below, share);
            }
            if !rest.is_empty() {
                let done = 64 * out.len();
                let [above, below] = self.wide.each_ref().map(|row| {
                    let mut bytes = [0; 64];
                    bytes[..rest.len()].copy_from_slice(&row[done..][..rest.len()]);
                    bytes
                });
                rest.copy_from_slice(&mixed(simd, &above, &below, share)[..rest.len()]);
            }
        }
    }
}

impl Enlarger {
    /// Returns the memory in use, bytes.
    pub(crate) fn bytes(&self) -> usize {
        let band = |b: &Band| b.row.len() + b.wide[0].len() + b.wide[1].len();
        size_of_val(self.columns.as_slice()) + self.bands.iter().map(band).sum::<usize>()
    }

    /// Fills `out` at its current size with `small` stretched to fit, leaving its depth alone. A picture without pixels
    /// fills nothing.
    ///
    /// Each row is stretched horizontally once for all the rows around it, so a coarse picture costs little more than
    /// writing the result.
    pub(crate) fn enlarge(&mut self, small: &Frame, out: &mut Frame) {
        let (width, height, w, h) = (out.width(), out.height(), small.width(), small.height());
        if width == 0 || height == 0 || w == 0 || h == 0 {
            return;
        }
        let (row_of, column_of) = (between(height, h), between(width, w));
        if w > width {
            return shrink(small, out, column_of, row_of);
        }
        self.columns.clear();
        self.columns.extend(
            (0..width)
                .step_by(LANES)
                .map(|first| Columns::new(std::array::from_fn(|n| column_of((first + n).min(width - 1))))),
        );
        self.bands.resize(height.div_ceil(ROWS), Band::default());
        let (columns, level) = ((width, &self.columns[..]), Level::new());
        let tasks = out.buffers().0.par_chunks_mut(ROWS * width).zip(&mut self.bands);
        tasks.enumerate().for_each(|(n, (rows, band))| {
            fearless_simd::dispatch!(level, simd => band.fill(simd, (n * ROWS, rows), columns, small, &row_of));
        });
    }
}

/// Fills `out` with a picture that is wider, pixel by pixel.
fn shrink(small: &Frame, out: &mut Frame, column_of: impl Fn(usize) -> Between, row_of: impl Fn(usize) -> Between) {
    let (w, last, width) = (small.width(), [small.width() - 1, small.height() - 1], out.width());
    let mix = |a: u8, b: u8, share: u16| ((u16::from(a) * (256 - share) + u16::from(b) * share + 128) >> 8) as u8;
    for (n, pixel) in out.buffers().0.iter_mut().enumerate() {
        let (x, y) = (column_of(n % width), row_of(n / width));
        let [xs, ys] = [(x, last[0]), (y, last[1])].map(|(b, last)| [b.low as usize, (b.low as usize + 1).min(last)]);
        *pixel = std::array::from_fn(|c| {
            let row = |y: usize| mix(small.pixels()[y * w + xs[0]][c], small.pixels()[y * w + xs[1]][c], x.share);
            mix(row(ys[0]), row(ys[1]), y.share)
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Red from left to right, green from top to bottom.
    fn ramp(w: usize, h: usize) -> Frame {
        let mut frame = Frame::new(w, h);
        for (n, p) in frame.buffers().0.iter_mut().enumerate() {
            let share = |at: usize, of: usize| (255.0 * (at as f64 + 0.5) / of as f64) as u8;
            *p = [share(n % w, w), share(n / w, h), 7];
        }
        frame
    }

    #[test]
    fn a_ramp_stays_a_ramp() {
        for (w, h) in [(32, 24), (64, 48), (43, 31), (16, 12)] {
            let mut out = Frame::new(64, 48);
            Enlarger::default().enlarge(&ramp(w, h), &mut out);
            let whole = ramp(64, 48);
            for (n, (o, e)) in out.pixels().iter().zip(whole.pixels()).enumerate() {
                let inner = (6..58).contains(&(n % 64)) && (6..42).contains(&(n / 64));
                let near = (0..3).all(|c| o[c].abs_diff(e[c]) <= 5);
                assert!(o[2] == 7 && (near || !inner), "{w}x{h} at {n}: {o:?} {e:?}");
            }
        }
        let mut same = Frame::new(9, 5);
        Enlarger::default().enlarge(&ramp(9, 5), &mut same);
        assert_eq!(same, ramp(9, 5));
    }

    /// Computes each pixel directly, without intermediate rounding: rounding twice is off by at most one grey level.
    #[test]
    fn rows_and_columns_are_those_of_each_pixel() {
        for (w, h, width, height) in [(7, 50, 29, 131), (40, 3, 41, 97), (1, 9, 5, 70), (64, 64, 48, 40)] {
            let mut small = Frame::new(w, h);
            for (n, p) in small.buffers().0.iter_mut().enumerate() {
                *p = [(n * 89 % 256) as u8, (n * n % 251) as u8, if n % 3 == 0 { 255 } else { 0 }];
            }
            let mut out = Frame::new(width, height);
            // Data kept from another size must not show.
            let mut enlarger = Enlarger::default();
            enlarger.enlarge(&ramp(33, 70), &mut Frame::new(90, 200));
            enlarger.enlarge(&small, &mut out);
            let (column, row) = (between(width, w), between(height, h));
            for (n, o) in out.pixels().iter().enumerate() {
                let (x, y) = (column(n % width), row(n / width));
                let of = |b: Between, last: usize| [b.low as usize, (b.low as usize + 1).min(last)];
                let (xs, ys) = (of(x, w - 1), of(y, h - 1));
                let part = |b: Between| [1.0 - f64::from(b.share) / 256.0, f64::from(b.share) / 256.0];
                for c in 0..3 {
                    let value =
                        |i: usize, j: usize| f64::from(small.pixels()[ys[j] * w + xs[i]][c]) * part(x)[i] * part(y)[j];
                    let exact = value(0, 0) + value(1, 0) + value(0, 1) + value(1, 1);
                    assert!((f64::from(o[c]) - exact).abs() <= 1.01, "{w}x{h} at {n}: {o:?}, {exact}");
                }
            }
        }
    }

    #[test]
    fn nothing_is_no_fault() {
        Enlarger::default().enlarge(&ramp(4, 4), &mut Frame::new(0, 0));
        let mut out = ramp(4, 2);
        Enlarger::default().enlarge(&Frame::new(0, 0), &mut out);
        assert_eq!(out, ramp(4, 2));
        Enlarger::default().enlarge(&ramp(1, 1), &mut out);
        assert!(out.pixels().iter().all(|p| *p == [127, 127, 7]));
    }

    /// Measures stretching to 1600×1000. Run it by name to see the time.
    #[test]
    fn stretching_is_cheap() {
        let (mut out, mut enlarger) = (Frame::new(1600, 1000), Enlarger::default());
        for (w, h) in [(1200, 750), (800, 500), (200, 125)] {
            let small = ramp(w, h);
            let mut best = f64::INFINITY;
            for _ in 0..40 {
                let begun = std::time::Instant::now();
                enlarger.enlarge(&small, &mut out);
                best = best.min(begun.elapsed().as_secs_f64() * 1e3);
            }
            println!("{w}x{h}: {best:.2} ms");
            assert!(best < 100.0);
        }
    }
}
