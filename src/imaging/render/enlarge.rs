//! Bilinear stretching of a picture to a larger one.

use fearless_simd::{Level, Simd, i32x16, prelude::*};
use rayon::prelude::*;

use super::frame::Frame;
use super::packets::lanes::{Padded, SPARE};

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

/// Returns pixels interpolated between two, red in the lowest byte; `share` is the weight of the second, out of 256.
///
/// Red and blue share a number, in which no sum overflows its sixteen bits.
#[inline(always)]
fn mix<S: Simd>(a: i32x16<S>, b: i32x16<S>, share: i32x16<S>) -> i32x16<S> {
    let part = |a: i32x16<S>, b: i32x16<S>, half: i32, mask: i32| {
        let (a, b) = (a & mask, b & mask);
        (((a << 8) + (b - a) * share + half) >> 8) & mask
    };
    part(a, b, 0x0080_0080, 0x00ff_00ff) | (part(a >> 8, b >> 8, 0x80, 0xff) << 8)
}

/// Pixels that are stretched at once.
const LANES: usize = 16;

/// Columns of the larger picture, sixteen at a time; those beyond its edge are as the last one.
#[derive(Clone, Debug, Default)]
struct Columns {
    /// The first byte of the left neighbour in a row.
    bytes: Vec<i32>,
    shares: Vec<i32>,
}

/// Stretches pictures and keeps its working memory from one to the next.
#[derive(Clone, Debug, Default)]
pub(crate) struct Enlarger {
    columns: Columns,
    bands: Vec<Band>,
}

/// Working memory for a band of the larger picture's rows.
#[derive(Clone, Debug, Default)]
struct Band {
    /// A row of the smaller picture, and as many bytes more as are read together.
    row: Vec<u8>,
    /// The two stretched rows of the smaller picture that surround a row of the larger one: red in the lowest byte.
    wide: [Vec<i32>; 2],
}

impl Band {
    /// Stretches a row of the smaller picture horizontally into one of the two.
    #[inline(always)]
    fn widen<S: Simd>(&mut self, simd: S, n: usize, row: &[[u8; 3]], columns: &Columns) {
        self.row.clear();
        self.row.extend_from_slice(row.as_flattened());
        self.row.extend_from_slice(&[0; SPARE]);
        let wide = &mut self.wide[n];
        wide.resize(columns.bytes.len(), 0);
        let Some(row) = Padded::new(&self.row) else { return };
        let columns = columns.bytes.as_chunks::<LANES>().0.iter().zip(columns.shares.as_chunks::<LANES>().0);
        for (out, (bytes, shares)) in wide.as_chunks_mut::<LANES>().0.iter_mut().zip(columns) {
            let at = i32x16::load_array_ref(simd, bytes);
            let (pixel, next) = (row.four(simd, at), row.four(simd, at + 3));
            *out = mix(pixel, next, i32x16::load_array_ref(simd, shares)).to_array();
        }
    }

    /// Fills rows `first..` of the larger picture.
    #[inline(always)]
    fn fill<S: Simd>(
        &mut self,
        simd: S,
        (first, rows): (usize, &mut [[u8; 3]]),
        (width, columns): (usize, &Columns),
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
            let share = i32x16::splat(simd, y.share.into());
            let [above, below] = self.wide.each_ref().map(|row| row.as_chunks::<LANES>().0);
            for ((out, above), below) in out.chunks_mut(LANES).zip(above).zip(below) {
                let [above, below] = [above, below].map(|row| i32x16::load_array_ref(simd, row));
                pack(&mix(above, below, share).to_array(), out);
            }
        }
    }
}

/// Writes at most sixteen pixels. Four fit in three words.
#[inline(always)]
fn pack(pixels: &[i32; LANES], out: &mut [[u8; 3]]) {
    let bytes = |pixel: i32| {
        let [r, g, b, _] = pixel.to_le_bytes();
        [r, g, b]
    };
    let Some(out) = out.first_chunk_mut::<LANES>() else {
        out.iter_mut().zip(pixels).for_each(|(out, pixel)| *out = bytes(*pixel));
        return;
    };
    let words = pixels.as_chunks::<4>().0.iter().flat_map(|&[a, b, c, d]| {
        let [a, b, c, d] = [a, b, c, d].map(i32::cast_unsigned);
        [a | b << 24, b >> 8 | c << 16, c >> 16 | d << 8]
    });
    for (out, word) in out.as_flattened_mut().as_chunks_mut::<4>().0.iter_mut().zip(words) {
        *out = word.to_le_bytes();
    }
}

impl Enlarger {
    /// Returns the memory in use, bytes.
    pub(crate) fn bytes(&self) -> usize {
        let words = |words: &[&Vec<i32>]| words.iter().map(|w| size_of_val(w.as_slice())).sum::<usize>();
        let band = |b: &Band| b.row.len() + words(&[&b.wide[0], &b.wide[1]]);
        words(&[&self.columns.bytes, &self.columns.shares]) + self.bands.iter().map(band).sum::<usize>()
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
        let row_of = between(height, h);
        let columns = &mut self.columns;
        columns.bytes.clear();
        columns.shares.clear();
        for Between { low, share } in
            (0..width.next_multiple_of(LANES)).map(|x| x.min(width - 1)).map(between(width, w))
        {
            columns.bytes.push(3 * low as i32);
            columns.shares.push(share.into());
        }
        self.bands.resize(height.div_ceil(ROWS), Band::default());
        let (columns, level) = ((width, &self.columns), Level::new());
        let tasks = out.buffers().0.par_chunks_mut(ROWS * width).zip(&mut self.bands);
        tasks.enumerate().for_each(|(n, (rows, band))| {
            fearless_simd::dispatch!(level, simd => band.fill(simd, (n * ROWS, rows), columns, small, &row_of));
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
