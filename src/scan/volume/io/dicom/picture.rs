//! A small picture of one slice.

use super::pixels;
use super::slice::Slice;
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::io::source;
use crate::volume::io::study::Picture;

/// Maximum number of pixels of a slice that is decoded for a picture.
const MOST_PIXELS: usize = 1 << 24;
/// Maximum size of a compressed file that is read for a picture, bytes.
const MOST_BYTES: u64 = 1 << 28;
/// Level and width of the grey levels, HU: gas and soft tissue differ, as lungs and soft tissue do.
const WINDOW: (f32, f32) = (0.0, 2000.0);

/// Decodes a slice and shrinks it to at most `side` pixels a side. Its pixels are square. A slice of CT is shown by its HU, any
/// other from its least to its largest value. Fails with status 3 if the slice is too large or damaged, status 4 if cancelled.
pub(crate) fn picture(slice: &Slice, side: usize, progress: &Progress) -> Result<Picture> {
    let file = &slice.file;
    let (cols, rows) = (usize::from(file.cols), usize::from(file.rows));
    let too_large = || Error::file(&file.path, "is too large for a preview", "open the series");
    if cols * rows > MOST_PIXELS {
        return Err(too_large());
    }
    pixels::check_syntax(file)?;
    if file.pixels.length.is_none() {
        pixels::check_expansion(file)?;
    }
    if source::open(&file.path)?.1 > MOST_BYTES && file.pixels.length.is_none() {
        return Err(too_large());
    }
    let mut hu = vec![0; cols * rows];
    pixels::decode(std::slice::from_ref(slice), &mut hu, progress)?;
    let [dx, dy] = slice.spacing.unwrap_or([1.0; 2]);
    let (width_mm, height_mm) = (dx * cols as f64, dy * rows as f64);
    let scale = side as f64 / width_mm.max(height_mm);
    let pixels_of = |mm: f64| ((mm * scale).round() as usize).clamp(1, side.max(1));
    let (width, height) = (pixels_of(width_mm), pixels_of(height_mm));
    let (low, wide) = if slice.modality == "CT" {
        (WINDOW.0 - WINDOW.1 / 2.0, WINDOW.1)
    } else {
        let (low, high) = hu.iter().fold((i16::MAX, i16::MIN), |(lo, hi), v| (lo.min(*v), hi.max(*v)));
        (f32::from(low), (f32::from(high) - f32::from(low)).max(1.0))
    };
    let mut grey = Vec::with_capacity(width * height);
    for y in 0..height {
        for x in 0..width {
            let mean = mean(&hu, cols, span(x, width, cols), span(y, height, rows));
            grey.push((255.0 * ((mean - low) / wide).clamp(0.0, 1.0)).round() as u8);
        }
    }
    Ok(Picture { width, height, grey })
}

/// Returns the voxels that pixel `k` of `of` covers, at least one.
fn span(k: usize, of: usize, voxels: usize) -> std::ops::Range<usize> {
    let begin = (k * voxels / of).min(voxels - 1);
    begin..((k + 1) * voxels / of).clamp(begin + 1, voxels)
}

fn mean(hu: &[i16], cols: usize, xs: std::ops::Range<usize>, ys: std::ops::Range<usize>) -> f32 {
    let count = xs.len() * ys.len();
    let sum: i64 = ys.flat_map(|y| &hu[y * cols..][xs.clone()]).map(|v| i64::from(*v)).sum();
    sum as f32 / count as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_voxel_is_in_one_pixel_of_a_smaller_picture() {
        for (of, voxels) in [(72, 512), (3, 7), (5, 5), (1, 9)] {
            let all: Vec<usize> = (0..of).flat_map(|k| span(k, of, voxels)).collect();
            assert_eq!(all, (0..voxels).collect::<Vec<_>>(), "{of} of {voxels}");
        }
        // A larger picture repeats voxels.
        assert_eq!((0..4).map(|k| span(k, 4, 2)).collect::<Vec<_>>(), [0..1, 0..1, 1..2, 1..2]);
        let hu: Vec<i16> = (0..12).collect();
        assert_eq!(mean(&hu, 4, 1..3, 0..3), 5.5);
    }
}
