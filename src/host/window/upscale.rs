//! Stretches an image over the window, bilinearly.

use rayon::prelude::*;

use crate::render::Frame;

/// Rows of a task.
const ROWS: usize = 16;

/// A pixel of the window: blue, green, red and a byte that is not shown, the order of softbuffer's `0x00RRGGBB`.
pub type Bgrx = [u8; 4];

/// Where a pixel of the window lies in the image: the two neighbours, and the share of the second of 256.
#[derive(Clone, Copy, Debug)]
struct Between {
    low: usize,
    high: usize,
    share: u32,
}

/// Neighbours of each of `n` pixels in a line of `m`; pixels are squares, so their centres lie at halves.
fn between(n: usize, m: usize) -> impl Fn(usize) -> Between {
    let scale = m as f64 / n.max(1) as f64;
    move |x| {
        let at = ((x as f64 + 0.5) * scale - 0.5).clamp(0.0, m.saturating_sub(1) as f64);
        let low = at as usize;
        Between { low, high: (low + 1).min(m.saturating_sub(1)), share: ((at - low as f64) * 256.0) as u32 }
    }
}

/// Fills `out`, a picture of `width` pixels a row, with `frame` stretched to fit. An image of the same size is copied.
pub fn upscale(frame: &Frame, out: &mut [Bgrx], width: usize) {
    let (w, h) = (frame.width(), frame.height());
    if width == 0 || out.is_empty() || w == 0 || h == 0 {
        return;
    }
    let height = out.len() / width;
    if (w, h) == (width, height) {
        let rows = out.par_chunks_mut(ROWS * width).zip(frame.pixels().par_chunks(ROWS * width));
        rows.for_each(|(out, pixels)| {
            for (o, &[r, g, b]) in out.iter_mut().zip(pixels) {
                *o = [b, g, r, 0];
            }
        });
        return;
    }
    let row_of = between(height, h);
    let columns: Vec<Between> = (0..width).map(between(width, w)).collect();
    out.par_chunks_mut(ROWS * width).enumerate().for_each(|(band, out)| {
        // One row of the image between two of its rows, with 8 more bits.
        let mut line = vec![[0u32; 3]; w];
        for (n, out) in out.chunks_exact_mut(width).enumerate() {
            let y = row_of(band * ROWS + n);
            let [above, below] = [y.low, y.high].map(|y| &frame.pixels()[y * w..][..w]);
            for ((l, a), b) in line.iter_mut().zip(above).zip(below) {
                for c in 0..3 {
                    l[c] = u32::from(a[c]) * (256 - y.share) + u32::from(b[c]) * y.share;
                }
            }
            for (o, x) in out.iter_mut().zip(&columns) {
                let (a, b) = (line[x.low], line[x.high]);
                let [r, g, b] = [0, 1, 2].map(|c| ((a[c] * (256 - x.share) + b[c] * x.share + 0x8000) >> 16) as u8);
                *o = [b, g, r, 0];
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::{Settings, Space, View, Wall, render};
    use crate::volume::{Grid, Volume};
    use glam::{DMat3, DVec3};
    use std::sync::Arc;

    /// A wall to the left of the camera, nothing to the right.
    fn frame(width: usize, height: usize) -> Frame {
        let grid = Grid::new([16, 16, 16], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let data = (0..16 * 16 * 16).map(|n| if n % 16 < 4 { 100 } else { -1000 }).collect();
        let space = Space::new(Arc::new(Volume::new(grid, data)), Wall::default());
        // Looking to +y with +z up, right is +x.
        let view = View::new(DVec3::splat(8.0), DVec3::Y, DVec3::Z, 90.0, width, height).unwrap();
        let mut frame = Frame::new(width, height, false);
        render(&space, &view, &Settings::default(), &mut frame);
        frame
    }

    #[test]
    fn left_stays_left_and_red_stays_red() {
        let frame = frame(24, 16);
        for (w, h) in [(24, 16), (72, 48), (50, 33), (7, 5)] {
            let mut out = vec![[1u8; 4]; w * h];
            upscale(&frame, &mut out, w);
            let [left, right] = [0, w - 1].map(|x| out[h / 2 * w + x]);
            assert!(left[2] > 60 && left[2] > left[0], "{w}x{h}: the wall is pink: {left:?}");
            assert_eq!(right, [0; 4], "{w}x{h}");
        }
    }

    #[test]
    fn a_ramp_stays_a_ramp() {
        let b = between(9, 3);
        assert_eq!((b(0).low, b(0).share), (0, 0), "the border is not mixed with anything");
        assert_eq!((b(4).low, b(4).share), (1, 0), "centre on centre");
        assert_eq!((b(5).low, b(5).high, b(5).share), (1, 2, 85));
        assert_eq!((b(8).low, b(8).high), (2, 2));
    }

    #[test]
    fn nothing_is_no_fault() {
        upscale(&frame(4, 4), &mut [], 0);
        upscale(&Frame::new(0, 0, false), &mut [[0; 4]; 4], 2);
    }
}
