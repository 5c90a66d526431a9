//! Stretches a picture over a larger one, bilinearly.

use rayon::prelude::*;

use super::frame::Frame;

/// Rows of a task.
const ROWS: usize = 32;

/// Where a pixel of the larger picture lies in the smaller one: the first of two neighbours, and the share of the second
/// of 256.
#[derive(Clone, Copy, Debug)]
struct Between {
    low: usize,
    high: usize,
    share: u16,
}

/// Neighbours of each of `n` pixels in a line of `m`; pixels are squares, so their centres lie at halves.
fn between(n: usize, m: usize) -> impl Fn(usize) -> Between {
    let scale = m as f64 / n.max(1) as f64;
    move |x| {
        let at = ((x as f64 + 0.5) * scale - 0.5).clamp(0.0, m.saturating_sub(1) as f64);
        let low = at as usize;
        Between { low, high: (low + 1).min(m.saturating_sub(1)), share: ((at - low as f64) * 256.0) as u16 }
    }
}

/// The value between two, `share` of 256 of the second.
#[inline(always)]
fn mix(a: u8, b: u8, share: u16) -> u8 {
    ((u16::from(a) * (256 - share) + u16::from(b) * share + 128) >> 8) as u8
}

/// Fills `out`, as large as it is, with `small` stretched to fit; its depth is left alone. A picture without pixels fills
/// nothing.
pub fn enlarge(small: &Frame, out: &mut Frame) {
    let (width, height, w, h) = (out.width(), out.height(), small.width(), small.height());
    if width == 0 || height == 0 || w == 0 || h == 0 {
        return;
    }
    let row_of = between(height, h);
    let columns: Vec<Between> = (0..width).map(between(width, w)).collect();
    let (pixels, from) = (out.buffers().0, small.pixels());
    pixels.par_chunks_mut(ROWS * width).enumerate().for_each(|(band, out)| {
        let mut line = vec![[0u8; 3]; w];
        for (n, out) in out.chunks_exact_mut(width).enumerate() {
            let y = row_of(band * ROWS + n);
            let (above, below) = (&from[y.low * w..][..w], &from[y.high * w..][..w]);
            let pairs = above.as_flattened().iter().zip(below.as_flattened());
            for (l, (&a, &b)) in line.as_flattened_mut().iter_mut().zip(pairs) {
                *l = mix(a, b, y.share);
            }
            for (o, x) in out.iter_mut().zip(&columns) {
                let (a, b) = (line[x.low], line[x.high]);
                *o = [mix(a[0], b[0], x.share), mix(a[1], b[1], x.share), mix(a[2], b[2], x.share)];
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Red from left to right, green from top to bottom.
    fn ramp(w: usize, h: usize) -> Frame {
        let mut frame = Frame::new(w, h, false);
        for (n, p) in frame.buffers().0.iter_mut().enumerate() {
            let share = |at: usize, of: usize| (255.0 * (at as f64 + 0.5) / of as f64) as u8;
            *p = [share(n % w, w), share(n / w, h), 7];
        }
        frame
    }

    #[test]
    fn a_ramp_stays_a_ramp() {
        for (w, h) in [(32, 24), (64, 48), (43, 31), (16, 12)] {
            let mut out = Frame::new(64, 48, false);
            enlarge(&ramp(w, h), &mut out);
            let whole = ramp(64, 48);
            for (n, (o, e)) in out.pixels().iter().zip(whole.pixels()).enumerate() {
                let inner = (6..58).contains(&(n % 64)) && (6..42).contains(&(n / 64));
                let near = (0..3).all(|c| o[c].abs_diff(e[c]) <= 5);
                assert!(o[2] == 7 && (near || !inner), "{w}x{h} at {n}: {o:?} {e:?}");
            }
        }
        let mut same = Frame::new(9, 5, false);
        enlarge(&ramp(9, 5), &mut same);
        assert_eq!(same, ramp(9, 5));
    }

    #[test]
    fn nothing_is_no_fault() {
        enlarge(&ramp(4, 4), &mut Frame::new(0, 0, false));
        let mut out = ramp(4, 2);
        enlarge(&Frame::new(0, 0, false), &mut out);
        assert_eq!(out, ramp(4, 2));
        enlarge(&ramp(1, 1), &mut out);
        assert!(out.pixels().iter().all(|p| *p == [127, 127, 7]));
    }
}
