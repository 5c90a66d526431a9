//! Image metrics: SSIM, the share of displaced wall, and the error map.

use rayon::prelude::*;

use crate::output::png;
use crate::render::Frame;

/// Side of the SSIM window, pixels.
const WINDOW: usize = 11;
/// Standard deviation of its Gaussian, pixels.
const SIGMA: f64 = 1.5;

/// Returns the structural similarity of two pictures of the same size, averaged over all windows that fit (Wang, Bovik, Sheikh,
/// Simoncelli 2004). It uses luminance, an 11×11 Gaussian of 1.5 pixels, K₁ = 0.01, K₂ = 0.03 and L = 255. Equal pictures have
/// the value 1. For a picture narrower than the window, the window has the picture's width.
pub(crate) fn ssim(a: &Frame, b: &Frame) -> f64 {
    let (w, h) = (a.width(), a.height());
    let (x, y) = (luminance(a), luminance(b));
    let product = |p: &[f64], q: &[f64]| -> Vec<f64> { p.iter().zip(q).map(|(p, q)| p * q).collect() };
    let maps = [x.clone(), y.clone(), product(&x, &x), product(&y, &y), product(&x, &y)];
    let [mx, my, xx, yy, xy] = maps.map(|m| blurred(&m, w, h));
    let (c1, c2) = ((0.01f64 * 255.0).powi(2), (0.03f64 * 255.0).powi(2));
    let mut sum = 0.0;
    for n in 0..mx.len() {
        let (mx, my) = (mx[n], my[n]);
        let (vx, vy, cov) = (xx[n] - mx * mx, yy[n] - my * my, xy[n] - mx * my);
        sum += (2.0 * mx * my + c1) * (2.0 * cov + c2) / ((mx * mx + my * my + c1) * (vx + vy + c2));
    }
    sum / mx.len() as f64
}

/// Returns the luminance (ITU-R BT.601) of each pixel, 0 to 255.
fn luminance(f: &Frame) -> Vec<f64> {
    f.pixels().iter().map(|&[r, g, b]| 0.299 * f64::from(r) + 0.587 * f64::from(g) + 0.114 * f64::from(b)).collect()
}

/// Returns the Gaussian-weighted mean over every window inside the picture.
fn blurred(map: &[f64], w: usize, h: usize) -> Vec<f64> {
    let kernel = |side: usize| -> Vec<f64> {
        let n = WINDOW.min(side);
        let weight = |k: usize| (-0.5 * ((k as f64 - 0.5 * (n as f64 - 1.0)) / SIGMA).powi(2)).exp();
        let sum: f64 = (0..n).map(weight).sum();
        (0..n).map(|k| weight(k) / sum).collect()
    };
    let (kx, ky) = (kernel(w), kernel(h));
    let (ow, oh) = (w + 1 - kx.len(), h + 1 - ky.len());
    let along: Vec<f64> = map
        .par_chunks(w)
        .flat_map_iter(|row| row.windows(kx.len()).map(|r| r.iter().zip(&kx).map(|(v, k)| v * k).sum::<f64>()))
        .collect();
    (0..oh)
        .into_par_iter()
        .flat_map_iter(|y| {
            let (along, ky) = (&along, &ky);
            (0..ow).map(move |x| ky.iter().enumerate().map(|(n, k)| k * along[(y + n) * ow + x]).sum::<f64>())
        })
        .collect()
}

/// Returns the share of pixels, 0 to 1, whose wall distance differs by more than `tolerance` mm. A wall in only one of the two
/// pictures counts as different.
pub(crate) fn displaced(a: &[f32], b: &[f32], tolerance: f64) -> f64 {
    let off = |(a, b): (&f32, &f32)| match (a.is_finite(), b.is_finite()) {
        (true, true) => f64::from((a - b).abs()) > tolerance,
        (a, b) => a != b,
    };
    a.iter().zip(b).filter(|&p| off(p)).count() as f64 / a.len().max(1) as f64
}

/// Converts a PSNR to the root mean square error, grey levels.
pub(crate) fn rms(psnr: f64) -> f64 {
    255.0 * 10f64.powf(-psnr / 20.0)
}

/// Error that is shown white, grey levels.
pub(crate) const WHITE_ERROR: u8 = 64;

/// Encodes reference, method and error side by side as a PNG. The error is the largest of the three colours', from black over
/// blue and orange to white at [`WHITE_ERROR`] levels. Pictures wider than `side` are reduced: colours to their mean, the error
/// to its maximum, so that no error is averaged away.
pub(crate) fn error_map(reference: &Frame, method: &Frame, side: usize) -> Vec<u8> {
    let (w, h) = (reference.width(), reference.height());
    let by = w.max(h).div_ceil(side.max(1)).max(1);
    let (pw, ph) = (w.div_ceil(by), h.div_ceil(by));
    const GAP: usize = 4;
    let full = 3 * pw + 2 * GAP;
    let mut out = vec![255u8; full * ph * 3];
    for y in 0..ph {
        for x in 0..pw {
            let cell = || {
                let ys = y * by..((y + 1) * by).min(h);
                ys.flat_map(move |j| (x * by..((x + 1) * by).min(w)).map(move |i| j * w + i))
            };
            let mean = |f: &Frame| {
                let n = cell().count() as u32;
                let sum = |c: usize| cell().map(|i| u32::from(f.pixels()[i][c])).sum::<u32>();
                [0, 1, 2].map(|c| ((sum(c) + n / 2) / n) as u8)
            };
            let apart = |i: usize| {
                let (a, b) = (reference.pixels()[i], method.pixels()[i]);
                (0..3).map(|c| a[c].abs_diff(b[c])).max().unwrap_or(0)
            };
            let error = cell().map(apart).max().unwrap_or(0);
            for (n, colour) in [mean(reference), mean(method), heat(error)].into_iter().enumerate() {
                let at = (y * full + n * (pw + GAP) + x) * 3;
                out[at..at + 3].copy_from_slice(&colour);
            }
        }
    }
    encoded(&out, full, ph)
}

/// Returns the colour of an error: black, blue, orange, white.
fn heat(error: u8) -> [u8; 3] {
    const STOPS: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [40.0, 60.0, 200.0], [255.0, 150.0, 30.0], [255.0; 3]];
    let t = (f32::from(error) / f32::from(WHITE_ERROR)).min(1.0) * 3.0;
    let n = (t as usize).min(2);
    std::array::from_fn(|c| (STOPS[n][c] + (STOPS[n + 1][c] - STOPS[n][c]) * (t - n as f32)).round() as u8)
}

/// Encodes red, green and blue bytes as a PNG.
fn encoded(rgb: &[u8], width: usize, height: usize) -> Vec<u8> {
    let mut out = Vec::new();
    // Writing to memory cannot fail, and the size matches the bytes.
    let _ = png::encode(&mut out, rgb, [width, height], png::ColorType::Rgb, png::Compression::High);
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash;
    use crate::render::psnr;

    fn frame(w: usize, h: usize, f: impl Fn(usize, usize) -> f64) -> Frame {
        let mut frame = Frame::new(w, h);
        for (n, p) in frame.buffers().0.iter_mut().enumerate() {
            *p = [f(n % w, n / w).clamp(0.0, 255.0).round() as u8; 3];
        }
        frame
    }

    fn pattern(x: usize, y: usize) -> f64 {
        128.0 + 60.0 * (0.3 * x as f64).sin() * (0.2 * y as f64).cos()
    }

    #[test]
    fn ssim_of_flat_pictures_is_its_formula() {
        // Without variance only the luminance term remains.
        for (a, b) in [(100.0, 100.0), (100.0, 120.0), (0.0, 255.0), (10.0, 200.0)] {
            let (fa, fb) = (frame(20, 15, |_, _| a), frame(20, 15, |_, _| b));
            let c1 = 6.5025;
            let expected = (2.0 * a * b + c1) / (a * a + b * b + c1);
            assert!((ssim(&fa, &fb) - expected).abs() < 1e-9, "{a} {b}");
        }
    }

    #[test]
    fn ssim_of_contrast_is_its_formula() {
        // y = x/2 + m/2 about the window's mean m preserves the mean, so only variances differ. A checkerboard's windows all have
        // the same mean and variance, up to the Gaussian's last digits.
        let board =
            |contrast: f64| frame(64, 64, move |x, y| 128.0 + if (x + y) % 2 == 0 { contrast } else { -contrast });
        let (vx, vy) = (40.0f64 * 40.0, 20.0f64 * 20.0);
        let c2 = 58.5225;
        let expected = (2.0 * 40.0 * 20.0 + c2) / (vx + vy + c2);
        assert!((ssim(&board(40.0), &board(20.0)) - expected).abs() < 1e-3);
    }

    #[test]
    fn ssim_is_symmetric_at_most_one_and_falls_with_noise() {
        let clean = frame(70, 50, pattern);
        let noisy = |s: f64| frame(70, 50, |x, y| pattern(x, y) + s * hash::normal(3, (x + 70 * y) as u64));
        assert!((ssim(&clean, &clean) - 1.0).abs() < 1e-12);
        let values: Vec<f64> = [2.0, 8.0, 30.0].iter().map(|&s| ssim(&clean, &noisy(s))).collect();
        assert!(values[0] < 1.0 && values[0] > values[1] && values[1] > values[2] && values[2] > 0.0, "{values:?}");
        assert!((ssim(&noisy(8.0), &clean) - values[1]).abs() < 1e-12);
        // The publication's point: a shift of brightness reduces SSIM less than noise of the same error.
        let shifted = frame(70, 50, |x, y| pattern(x, y) + 30.0);
        assert!(ssim(&clean, &shifted) > values[2] + 0.2);
        let tiny = frame(3, 1, |x, _| 40.0 * x as f64);
        assert!((ssim(&tiny, &tiny) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn displaced_counts_walls_that_appear_or_vanish() {
        let inf = f32::INFINITY;
        assert_eq!(displaced(&[1.0, 2.0, inf, inf], &[1.1, 2.3, inf, 5.0], 0.25), 0.5);
        assert_eq!(displaced(&[], &[], 0.25), 0.0);
    }

    #[test]
    fn rms_is_psnr_turned_round() {
        let (a, b) = (frame(9, 9, |_, _| 100.0), frame(9, 9, |_, _| 107.0));
        assert!((rms(psnr(&a, &b)) - 7.0).abs() < 1e-9);
        assert_eq!(rms(f64::INFINITY), 0.0);
    }

    #[test]
    fn an_error_map_has_three_panels_and_keeps_the_worst_pixel() {
        let a = frame(100, 60, pattern);
        let mut b = a.clone();
        b.buffers().0[33 * 100 + 71] = [255; 3];
        let map = image::load_from_memory(&error_map(&a, &b, 50)).unwrap().to_rgb8();
        assert_eq!(map.dimensions(), (158, 30));
        let lit: Vec<_> = map.enumerate_pixels().filter(|(x, _, p)| *x >= 108 && p.0 != [0; 3]).collect();
        assert_eq!(lit.len(), 1);
        assert_eq!((lit[0].0, lit[0].1), (108 + 35, 16));
    }
}
