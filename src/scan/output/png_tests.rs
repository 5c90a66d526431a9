use std::io::Cursor;

use ::png::BitDepth::{Eight, Four, One, Sixteen, Two};
use ::png::ColorType::{Grayscale, GrayscaleAlpha, Indexed, Rgb, Rgba};
use image::DynamicImage;

use super::*;
use crate::math::hash;

const WIDTH: u32 = 11;
const HEIGHT: u32 = 5;

/// Writes a PNG of any kind with random samples. `transparent` is the content of its tRNS chunk.
fn png(color: ColorType, depth: BitDepth, transparent: Option<&[u8]>) -> Vec<u8> {
    let row = (WIDTH as usize * color.samples() * depth as usize).div_ceil(8);
    let samples: Vec<u8> = (0..row * HEIGHT as usize).map(|n| hash::bits(7, n as u64) as u8).collect();
    let mut out = Vec::new();
    let mut encoder = Encoder::new(&mut out, WIDTH, HEIGHT);
    encoder.set_color(color);
    encoder.set_depth(depth);
    if color == Indexed {
        let colours = (0..3u64 << depth as usize).map(|n| hash::bits(7, 1000 + n) as u8);
        encoder.set_palette(colours.collect::<Vec<u8>>());
    }
    if let Some(transparent) = transparent {
        encoder.set_trns(transparent.to_vec());
    }
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(&samples).unwrap();
    writer.finish().unwrap();
    out
}

fn decoder(bytes: &[u8]) -> Result<Decoder<Cursor<&[u8]>>, Fault> {
    Decoder::new(Cursor::new(bytes), 100)
}

#[test]
fn every_kind_is_decoded_as_an_independent_reader_does() {
    let kinds = [
        (Grayscale, One, None),
        (Grayscale, Two, Some(&[0, 2][..])),
        (Grayscale, Four, None),
        (Grayscale, Eight, None),
        (Grayscale, Eight, Some(&[0, 77])),
        (Grayscale, Sixteen, None),
        (GrayscaleAlpha, Eight, None),
        (GrayscaleAlpha, Sixteen, None),
        (Rgb, Eight, None),
        (Rgb, Sixteen, None),
        (Rgba, Eight, None),
        (Rgba, Sixteen, None),
        (Indexed, One, None),
        (Indexed, Four, Some(&[255, 0, 90])),
        (Indexed, Eight, None),
    ];
    for (color, depth, transparent) in kinds {
        let bytes = png(color, depth, transparent);
        let theirs = image::load_from_memory(&bytes).unwrap();
        let decoder = decoder(&bytes).unwrap();
        let kind = format!("{color:?} {depth:?} {transparent:?}");
        assert_eq!((decoder.size(), decoder.is_deep()), ((WIDTH, HEIGHT), depth == Sixteen), "{kind}");
        assert_eq!(decoder.bytes(), theirs.as_bytes().len() as u64, "{kind}");
        let ours = decoder.read().unwrap();
        let rgba: Vec<[u8; 4]> = theirs.to_rgba8().pixels().map(|p| p.0).collect();
        assert_eq!(ours.rgba().collect::<Vec<_>>(), rgba, "{kind}");
        let grey: Vec<u16> = match depth {
            Sixteen => theirs.into_luma16().into_raw(),
            _ => theirs.into_luma8().into_raw().into_iter().map(|v| 257 * u16::from(v)).collect(),
        };
        assert_eq!(ours.grey().collect::<Vec<_>>(), grey, "{kind}");
    }
}

#[test]
fn colours_become_their_luminance() {
    let grey = |deep: bool, samples: &[u16]| {
        let bytes = samples.iter().flat_map(|v| if deep { v.to_be_bytes().to_vec() } else { vec![*v as u8] }).collect();
        Samples { channels: 3, deep, bytes }.grey().collect::<Vec<_>>()
    };
    let eight = [255, 0, 0, 0, 255, 0, 0, 0, 255, 255, 255, 255, 10, 200, 30];
    // 0.2126 · 10 + 0.7152 · 200 + 0.0722 · 30 = 147.3, and so on.
    assert_eq!(grey(false, &eight), [54, 182, 18, 255, 147].map(|v| 257 * v));
    // 0.212648 · 65535 = 13935.9; four digits of the weight would give 13933.
    let sixteen = [65535, 0, 0, 0, 65535, 0, 0, 0, 65535, 65535, 65535, 65535];
    assert_eq!(grey(true, &sixteen), [13936, 46869, 4730, 65535]);
}

#[test]
fn an_encoded_picture_is_read_by_an_independent_reader() {
    for compression in [Compression::Fast, Compression::High] {
        let samples: Vec<u8> = (0..3 * WIDTH * HEIGHT).map(|n| hash::bits(7, n.into()) as u8).collect();
        let size = [WIDTH as usize, HEIGHT as usize];
        let mut out = Vec::new();
        encode(&mut out, &samples, size, Rgb, compression).unwrap();
        let DynamicImage::ImageRgb8(read) = image::load_from_memory(&out).unwrap() else { panic!("no colours") };
        assert_eq!(read.into_raw(), samples);
        let grey = &samples[..size[0] * size[1]];
        let mut out = Vec::new();
        encode(&mut out, grey, size, Grayscale, compression).unwrap();
        let DynamicImage::ImageLuma8(read) = image::load_from_memory(&out).unwrap() else { panic!("no grey") };
        assert_eq!(read.into_raw(), grey);
        for (samples, size) in [(&samples[..], [0, 5]), (&samples[..], [5, 0]), (&samples[1..], size)] {
            assert!(encode(&mut Vec::new(), samples, size, Rgb, compression).is_err(), "{size:?}");
        }
    }
    let full = encode(&mut &mut [0; 20][..], &[1; 12], [2, 2], Rgb, Compression::Fast).unwrap_err();
    assert_eq!(full.kind(), io::ErrorKind::WriteZero);
}

#[test]
fn damage_is_told_with_its_reason() {
    let whole = png(Rgb, Eight, None);
    let why = |bytes: &[u8]| decoder(bytes).and_then(Decoder::read).err().map(|e| e.to_string()).unwrap_or_default();
    assert_eq!(why(&whole), "");
    assert_eq!(why(b"GIF89a..."), "Format error decoding Png: Invalid PNG signature.");
    let eof = decoder(&whole[..60]).and_then(Decoder::read).err();
    let Some(Fault::Decoding(DecodingError::IoError(e))) = eof else { panic!("{eof:?}") };
    assert_eq!(e.kind(), io::ErrorKind::UnexpectedEof);
    let mut flipped = whole;
    flipped[16] ^= 1;
    assert!(why(&flipped).starts_with("Format error decoding Png: CRC error"), "{}", why(&flipped));
    let mut long = Vec::new();
    encode(&mut long, &[7; 101], [101, 1], Grayscale, Compression::Fast).unwrap();
    assert_eq!(why(&long), "Image size exceeds limit");
    assert_eq!(Fault::Decoding(DecodingError::LimitsExceeded).to_string(), "Memory limit exceeded");
}
