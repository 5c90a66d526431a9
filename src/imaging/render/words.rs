//! Pixels as words, as screens take them.

use fearless_simd::{Level, Simd, prelude::*, u8x16, u8x64};

/// Pixels that are converted at once.
const LANES: usize = 16;
/// Bytes that are moved within.
pub(super) const BLOCK: usize = 16;
/// Picks blue, green and red of four pixels, and a byte more of each.
const PICKED: [u8; 64] = {
    let mut picked = [15; 64];
    let mut n = 0;
    while n < LANES {
        let mut colour = 0;
        while colour < 3 {
            picked[4 * n + colour] = (n % 4 * 3 + 2 - colour) as u8;
            colour += 1;
        }
        n += 1;
    }
    picked
};

/// Returns four blocks of bytes.
#[inline(always)]
pub(super) fn blocks<S: Simd>(simd: S, of: [&[u8; BLOCK]; 4]) -> u8x64<S> {
    let [a, b, c, d] = of;
    let first = u8x16::load_array_ref(simd, a).combine(u8x16::load_array_ref(simd, b));
    first.combine(u8x16::load_array_ref(simd, c).combine(u8x16::load_array_ref(simd, d)))
}

/// Converts red, green and blue to `0x00RRGGBB`, as many as both have.
pub fn to_words(level: Level, pixels: &[[u8; 3]], out: &mut [u32]) {
    let count = pixels.len().min(out.len());
    fearless_simd::dispatch!(level, simd => convert(simd, &pixels[..count], &mut out[..count]));
}

#[inline(always)]
fn convert<S: Simd>(simd: S, pixels: &[[u8; 3]], out: &mut [u32]) {
    let word = |&[r, g, b]: &[u8; 3]| u32::from_be_bytes([0, r, g, b]);
    // The last block of sixteen pixels has four bytes of those after them, which the last ones do not have.
    let whole = pixels.len().saturating_sub(2) / LANES * LANES;
    let picked = u8x64::load_array_ref(simd, &PICKED);
    let (words, rest) = out.split_at_mut(whole);
    for (out, pixels) in words.as_chunks_mut::<LANES>().0.iter_mut().zip(pixels.windows(LANES + 2).step_by(LANES)) {
        let Some(bytes) = pixels.as_flattened().first_chunk::<{ 3 * (LANES + 2) }>() else { return };
        let four = |n: usize| bytes[12 * n..].first_chunk().unwrap_or(&[0; BLOCK]);
        let picked = blocks(simd, [four(0), four(1), four(2), four(3)]).swizzle_dyn_within_blocks(picked);
        for (out, bytes) in out.iter_mut().zip(picked.to_array().as_chunks().0) {
            *out = u32::from_le_bytes(*bytes) & 0x00ff_ffff;
        }
    }
    for (out, pixel) in rest.iter_mut().zip(&pixels[whole..]) {
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
