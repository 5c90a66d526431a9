//! HU for grey values that carry none: contrast enhancement and normalisation, which the paper's section 1.2 applies to
//! the cross-sections before everything else.
//!
//! Grey values are 0 to 65535, stored minus 32768.

use rayon::prelude::*;

use super::raw::to_hu;

/// HU of the two landmarks of an abdominal histogram.
const AIR: f64 = -1000.0;
const SOFT_TISSUE: f64 = 40.0;
/// Number of histogram bins.
const BINS: usize = 256;

/// Maps black (0) and white (65535) linearly.
pub(crate) fn linear(data: &mut [i16], black: f64, white: f64) {
    map(data, |grey| black + (white - black) * grey / 65535.0);
}

fn map(data: &mut [i16], hu: impl Fn(f64) -> f64) {
    let table: Vec<i16> = (0..=u16::MAX).map(|g| to_hu(hu(f64::from(g)))).collect();
    data.par_iter_mut().for_each(|v| *v = table[(i32::from(*v) + 32768) as usize]);
}

/// Finds air (the darkest large mode) and soft tissue (the largest mode well above it), stretches the contrast between
/// them to their HU, and returns a note about it.
pub(crate) fn by_histogram(data: &mut [i16]) -> String {
    let (air, tissue, note) = match landmarks(data) {
        Some((air, tissue)) => {
            let said = format!(
                "has no HU: grey {:.0} of 255 was taken as air and {:.0} as soft tissue; --hu LO,HI sets them",
                air / 257.0,
                tissue / 257.0
            );
            (air, tissue, said)
        }
        // Air and tissue cannot be separated, so use the usual display window: black −1000 to white 400 HU.
        None => {
            let white = (SOFT_TISSUE - AIR) / 1400.0 * 65535.0;
            (0.0, white, "has no HU and too little contrast: black was taken as -1000 HU, white as 400".to_owned())
        }
    };
    map(data, |grey| AIR + (SOFT_TISSUE - AIR) * (grey - air) / (tissue - air));
    note
}

/// Returns the grey values of air and of soft tissue.
fn landmarks(data: &[i16]) -> Option<(f64, f64)> {
    let mut histogram = vec![0u64; 65536];
    data.iter().for_each(|v| histogram[(i32::from(*v) + 32768) as usize] += 1);
    let low = histogram.iter().position(|n| *n > 0)?;
    let high = histogram.iter().rposition(|n| *n > 0)?;
    if high - low < 16 * 257 {
        return None;
    }
    let width = (high - low + 1) as f64 / BINS as f64;
    let mut bins = [0f64; BINS];
    for (grey, n) in histogram.iter().enumerate().take(high + 1).skip(low) {
        bins[(((grey - low) as f64 / width) as usize).min(BINS - 1)] += *n as f64;
    }
    // A triangular filter of five bins: eight-bit slices leave every other bin empty.
    let at = |k: isize| usize::try_from(k).ok().and_then(|k| bins.get(k)).copied().unwrap_or(0.0);
    let smooth: Vec<f64> = (0..BINS as isize)
        .map(|k| (at(k - 2) + 2.0 * at(k - 1) + 3.0 * at(k) + 2.0 * at(k + 1) + at(k + 2)) / 9.0)
        .collect();
    let peaks: Vec<usize> = (0..BINS)
        .filter(|&k| {
            let left = if k > 0 { smooth[k - 1] } else { -1.0 };
            let right = smooth.get(k + 1).copied().unwrap_or(-1.0);
            smooth[k] > left && smooth[k] >= right && smooth[k] > 0.0
        })
        .collect();
    let highest = peaks.iter().map(|k| smooth[*k]).fold(0.0, f64::max);
    // Large: at least a twentieth of the highest mode.
    let air = *peaks.iter().find(|k| smooth[**k] >= 0.05 * highest)?;
    // Well above: lung and fat are in between; bone and contrast agent are rarer than soft tissue.
    let apart = air + BINS / 5;
    let tissue = *peaks.iter().filter(|k| **k >= apart).max_by(|a, b| smooth[**a].total_cmp(&smooth[**b]))?;
    let grey = |k: usize| low as f64 + (k as f64 + 0.5) * width;
    Some((if air == 0 { low as f64 } else { grey(air) }, grey(tissue)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::normal;

    fn grey(v: f64) -> i16 {
        (v.clamp(0.0, 65535.0) as i32 - 32768) as i16
    }

    #[test]
    fn air_and_tissue_are_found() {
        // Of 255: a third is air around 30, a twentieth fat around 140, the rest tissue around 170, some bone.
        let class = |i: u64| match i % 60 {
            0..20 => 30.0,
            20..23 => 140.0,
            23..58 => 170.0,
            _ => 240.0,
        };
        let mut data: Vec<i16> = (0..60_000).map(|i| grey(257.0 * (class(i) + 3.0 * normal(1, i)))).collect();
        by_histogram(&mut data);
        let mean = |m: u64| {
            let v: Vec<f64> = (0..60_000).filter(|i| i % 60 == m).map(|i| f64::from(data[i as usize])).collect();
            v.iter().sum::<f64>() / v.len() as f64
        };
        assert!((mean(0) - AIR).abs() < 30.0, "{}", mean(0));
        assert!((mean(30) - SOFT_TISSUE).abs() < 30.0, "{}", mean(30));
    }

    #[test]
    fn flat_images_are_no_division_by_zero() {
        for v in [0.0, 30000.0, 65535.0] {
            let mut data = vec![grey(v); 100];
            assert!(by_histogram(&mut data).contains("too little contrast"));
            assert!((-1000..=400).contains(&data[0]));
        }
    }

    #[test]
    fn black_and_white_are_mapped() {
        let mut data = vec![grey(0.0), grey(65535.0), grey(257.0 * 51.0)];
        linear(&mut data, -1000.0, 500.0);
        assert_eq!(data, [-1000, 500, -700]);
    }

    #[test]
    fn a_few_black_pixels_are_not_air() {
        // Air around 40 and tissue around 170 of 255; one pixel in three thousand is text of an overlay, around 10.
        let class = |i: u64| match (i % 3000, i % 3) {
            (0, _) => 10.0,
            (_, 1) => 40.0,
            _ => 170.0,
        };
        let mut data: Vec<i16> = (0..60_000).map(|i| grey(257.0 * (class(i) + 2.0 * normal(1, i)))).collect();
        by_histogram(&mut data);
        let air: Vec<f64> = data.iter().skip(1).step_by(3).map(|v| f64::from(*v)).collect();
        let mean = air.iter().sum::<f64>() / air.len() as f64;
        assert!((mean - AIR).abs() < 30.0, "{mean}");
    }
}
