//! Pixels as words, as screens take them.

use fearless_simd::{Level, Simd, i32x16, prelude::*};

use super::packets::lanes::Padded;

/// Pixels that are converted at once.
const LANES: usize = 16;

/// Converts red, green and blue to `0x00RRGGBB`, as many as both have.
pub fn to_words(level: Level, pixels: &[[u8; 3]], out: &mut [u32]) {
    let count = pixels.len().min(out.len());
    fearless_simd::dispatch!(level, simd => convert(simd, &pixels[..count], &mut out[..count]));
}

#[inline(always)]
fn convert<S: Simd>(simd: S, pixels: &[[u8; 3]], out: &mut [u32]) {
    let word = |&[r, g, b]: &[u8; 3]| u32::from_be_bytes([0, r, g, b]);
    // Each is read with the byte after it, which the last one does not have.
    let whole = out.len().saturating_sub(1) / LANES * LANES;
    let mut first = i32x16::load_array_ref(simd, &std::array::from_fn(|n| 3 * n as i32));
    if let Some(bytes) = Padded::new(pixels.as_flattened()) {
        for out in out[..whole].as_chunks_mut::<LANES>().0 {
            let rgb = bytes.four(simd, first);
            let words = ((rgb & 0xff) << 16) | (rgb & 0xff00) | ((rgb >> 16) & 0xff);
            *out = words.to_array().map(i32::cast_unsigned);
            first += 3 * LANES as i32;
        }
    }
    for (out, pixel) in out.iter_mut().zip(pixels).skip(whole) {
        *out = word(pixel);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::packets::levels;

    #[test]
    fn red_stays_red() {
        for n in (0..70).chain([1600]) {
            let pixels: Vec<[u8; 3]> = (0..n).map(|n| [n as u8, (n * 7 % 251) as u8, 255 - n as u8]).collect();
            for (name, level) in levels() {
                let mut out = vec![9; n + 2];
                to_words(level, &pixels, &mut out);
                for (o, &[r, g, b]) in out.iter().zip(&pixels) {
                    assert_eq!(*o, u32::from(r) << 16 | u32::from(g) << 8 | u32::from(b), "{name} {n}");
                }
                assert_eq!(out[n..], [9, 9]);
            }
        }
    }
}
