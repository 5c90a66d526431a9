//! Conversion of pixel data to HU: uncompressed, or by a decoder whose [panics](crate::panics) are caught.

use std::borrow::Cow;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::Arc;

use dicom_pixeldata::PixelDecoder;
use rayon::prelude::*;

use super::dataset::{self, Fault};
use super::fragments;
use super::rle;
use super::slice::{FileHead, Slice};
use crate::error::{Error, Result};
use crate::panics::catch_panic;
use crate::progress::Progress;
use crate::volume::AIR_HU;
use crate::volume::io::raw::{ByteOrder, to_hu};
use crate::volume::io::source;

/// Decoded data smaller than this is harmless, whatever the header declares, bytes.
const HARMLESS: usize = 1 << 20;
/// Maximum expansion of a compressed slice, as a multiple of its size. It is far above what scans reach, since even an
/// empty slice has a code for each of its blocks.
const MOST_EXPANSION: usize = 2000;
/// Maximum number of tiles in a JPEG 2000 image.
const MOST_TILES: u64 = 4096;

/// Pixel compression of a transfer syntax.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Codec {
    Native(ByteOrder),
    Rle,
    Jpeg,
    JpegLs,
    Jpeg2000,
}

fn codec(path: &Path, syntax: &str) -> Result<Codec> {
    let name = match syntax {
        "1.2.840.10008.1.2" | "1.2.840.10008.1.2.1" | "1.2.840.10008.1.2.1.99" => {
            return Ok(Codec::Native(ByteOrder::Little));
        }
        "1.2.840.10008.1.2.2" => return Ok(Codec::Native(ByteOrder::Big)),
        "1.2.840.10008.1.2.5" => return Ok(Codec::Rle),
        "1.2.840.10008.1.2.4.50" | "1.2.840.10008.1.2.4.51" | "1.2.840.10008.1.2.4.57" | "1.2.840.10008.1.2.4.70" => {
            return Ok(Codec::Jpeg);
        }
        "1.2.840.10008.1.2.4.80" | "1.2.840.10008.1.2.4.81" => return Ok(Codec::JpegLs),
        "1.2.840.10008.1.2.4.90" | "1.2.840.10008.1.2.4.91" => return Ok(Codec::Jpeg2000),
        "1.2.840.10008.1.2.4.92" | "1.2.840.10008.1.2.4.93" => "JPEG 2000 multi-component",
        "1.2.840.10008.1.2.4.100" | "1.2.840.10008.1.2.4.101" => "MPEG-2",
        "1.2.840.10008.1.2.4.102" | "1.2.840.10008.1.2.4.103" => "MPEG-4",
        "1.2.840.10008.1.2.4.110" | "1.2.840.10008.1.2.4.111" | "1.2.840.10008.1.2.4.112" => "JPEG XL",
        "1.2.840.10008.1.2.4.201" | "1.2.840.10008.1.2.4.202" | "1.2.840.10008.1.2.4.203" => "HTJ2K",
        _ => "unknown",
    };
    Err(Error::file(
        path,
        format!("its transfer syntax {syntax} ({name}) is not supported"),
        "export it uncompressed, or as RLE, JPEG lossless, JPEG-LS or JPEG 2000",
    ))
}

/// Rejects transfer syntaxes without a decoder, before any memory is allocated.
///
/// # Errors
/// Returns status 3 with the transfer syntax.
pub(crate) fn check_syntax(file: &FileHead) -> Result<()> {
    codec(&file.path, &file.syntax).map(drop)
}

/// Rejects a compressed file that is too small for its declared size, before that memory is allocated.
///
/// # Errors
/// Returns status 3 with both sizes.
pub(crate) fn check_expansion(file: &FileHead) -> Result<()> {
    let (_, len) = source::open(&file.path)?;
    let frame = u64::from(file.rows) * u64::from(file.cols) * u64::from(file.bits.allocated / 8);
    let most = (HARMLESS as u64).max(len.saturating_mul(MOST_EXPANSION as u64));
    if frame.saturating_mul(file.frames.into()) > most {
        let why = format!("is {len} bytes, which cannot hold {} frames of {frame} bytes", file.frames);
        return Err(Error::file(&file.path, why, "copy or export it again"));
    }
    Ok(())
}

/// A slice and the destination of its HU.
type Target<'a> = (&'a Slice, &'a mut [i16]);

/// Decodes `slices` in order into `out` and returns how many voxels were padding.
///
/// # Errors
/// Returns status 3 if pixel data is damaged, status 4 if cancelled. If several slices are damaged, the first is named.
pub(crate) fn decode(slices: &[Slice], out: &mut [i16], progress: &Progress) -> Result<usize> {
    let first = &slices[0].file;
    let voxels = usize::from(first.rows) * usize::from(first.cols);
    // Group the frames of one file, so that it is read once.
    let mut groups: Vec<(Arc<FileHead>, Vec<Target>)> = Vec::new();
    for (slice, target) in slices.iter().zip(out.chunks_mut(voxels)) {
        match groups.last_mut() {
            Some((file, frames)) if Arc::ptr_eq(file, &slice.file) => frames.push((slice, target)),
            _ => groups.push((Arc::clone(&slice.file), vec![(slice, target)])),
        }
    }
    let results: Vec<Result<usize>> =
        groups.into_par_iter().map(|(file, frames)| decode_file(&file, frames, progress)).collect();
    results.into_iter().sum()
}

fn decode_file(file: &FileHead, frames: Vec<Target>, progress: &Progress) -> Result<usize> {
    progress.check()?;
    let path = file.path.as_path();
    let voxels = usize::from(file.rows) * usize::from(file.cols);
    let sample = usize::from(file.bits.allocated / 8);
    let codec = codec(path, &file.syntax)?;
    let results: Vec<Result<usize>> = match codec {
        Codec::Native(order) if file.syntax != "1.2.840.10008.1.2.1.99" => frames
            .into_par_iter()
            .map(|(slice, target)| {
                let begin = (file.pixels.offset + slice.frame as usize * voxels * sample) as u64;
                let bytes = read(path, begin, voxels * sample)?;
                progress.advance(1)?;
                Ok(to_hus(slice, &bytes, order, target))
            })
            .collect(),
        _ => {
            let (_, len) = source::open(path)?;
            let bytes = read(path, 0, usize::try_from(len).unwrap_or(usize::MAX))?;
            let body = match codec {
                // The pixel position refers to the inflated bytes.
                Codec::Native(_) => dataset::parse(&bytes).map_err(|e| fault(path, e))?.1,
                _ => Cow::Borrowed(&bytes[..]),
            };
            let parts = match codec {
                Codec::Native(_) => Vec::new(),
                _ => dataset::fragments(&body, file.pixels.offset).map_err(|e| fault(path, e))?,
            };
            frames
                .into_par_iter()
                .map(|(slice, target)| {
                    let decoded = match codec {
                        Codec::Native(_) => {
                            let begin = file.pixels.offset + slice.frame as usize * voxels * sample;
                            let frame = body.get(begin..begin + voxels * sample);
                            Cow::Borrowed(frame.ok_or_else(|| fault(path, Fault::Short))?)
                        }
                        _ => Cow::Owned(unpack(file, codec, &frame_of(file, &parts, slice.frame)?)?),
                    };
                    progress.advance(1)?;
                    Ok(to_hus(slice, &decoded, ByteOrder::Little, target))
                })
                .collect()
        }
    };
    results.into_iter().sum()
}

fn fault(path: &Path, fault: Fault) -> Error {
    let why = match fault {
        Fault::Short => "its pixel data ends early".to_owned(),
        Fault::Bad(why) => why,
    };
    Error::file(path, why, "copy or export it again")
}

fn read(path: &Path, begin: u64, length: usize) -> Result<Vec<u8>> {
    let fail = |e: std::io::Error| source::unreadable(path, e);
    let (mut file, len) = source::open(path)?;
    if len.saturating_sub(begin) < length as u64 {
        return Err(fault(path, Fault::Short));
    }
    file.seek(SeekFrom::Start(begin)).map_err(&fail)?;
    let mut bytes = Vec::with_capacity(length);
    file.take(length as u64).read_to_end(&mut bytes).map_err(fail)?;
    if bytes.len() < length { Err(fault(path, Fault::Short)) } else { Ok(bytes) }
}

/// Returns the compressed bytes of one frame.
fn frame_of<'a>(file: &FileHead, parts: &[&'a [u8]], frame: u32) -> Result<Cow<'a, [u8]>> {
    match parts {
        [] => Err(fault(&file.path, Fault::Bad("has no pixel data".to_owned()))),
        [one] if file.frames == 1 => Ok(Cow::Borrowed(one)),
        _ if file.frames == 1 => Ok(Cow::Owned(parts.concat())),
        _ if parts.len() == file.frames as usize => Ok(Cow::Borrowed(parts[frame as usize])),
        _ => fragments::of_frame(parts, file.frames, frame).map(|own| Cow::Owned(own.concat())).ok_or_else(|| {
            let why = format!("has {} fragments for {} frames", parts.len(), file.frames);
            Error::file(&file.path, why, "export it as single slices")
        }),
    }
}

/// Decompresses one frame to little-endian samples.
fn unpack(file: &FileHead, codec: Codec, packed: &[u8]) -> Result<Vec<u8>> {
    let path = file.path.as_path();
    let damaged = |why: String| Error::file(path, format!("its pixel data {why}"), "copy or export it again");
    let sample = usize::from(file.bits.allocated / 8);
    let size = usize::from(file.rows) * usize::from(file.cols) * sample;
    if size > HARMLESS.max(packed.len().saturating_mul(MOST_EXPANSION)) {
        return Err(damaged(format!("is {} bytes, which cannot hold {size}", packed.len())));
    }
    // The code stream declares its own size, and the decoder allocates by that.
    if codec != Codec::Rle {
        let wanted = (u32::from(file.cols), u32::from(file.rows));
        let coded =
            coded(codec, packed).ok_or_else(|| damaged("does not begin as its transfer syntax says".to_owned()))?;
        if coded.size != wanted {
            let (x, y) = coded.size;
            return Err(damaged(format!("is coded as {x}×{y} where the header has {}×{}", wanted.0, wanted.1)));
        }
        // The JPEG decoder returns one or two bytes per sample as in the code stream, whatever the header says.
        if codec == Codec::Jpeg && (coded.bits > 8) != (file.bits.allocated > 8) {
            let why = format!("is coded in {} bits where the header allocates {}", coded.bits, file.bits.allocated);
            return Err(damaged(why));
        }
    }
    let outcome = catch_panic(|| match codec {
        Codec::JpegLs => by_jpegls(file, packed),
        Codec::Rle => rle::unpack(packed, size / sample, sample),
        _ => by_registry(file, packed),
    });
    let samples = outcome
        .map_err(|_| damaged("is damaged (its decoder gave up)".to_owned()))?
        .map_err(|why| damaged(format!("is damaged ({why})")))?;
    if samples.len() < size {
        return Err(damaged(format!("decodes to {} bytes where {size} are declared", samples.len())));
    }
    Ok(samples)
}

fn by_jpegls(file: &FileHead, packed: &[u8]) -> std::result::Result<Vec<u8>, String> {
    let (values, _, _) = jpegls::decode(packed, file.cols.into(), file.rows.into()).map_err(|e| e.to_string())?;
    Ok(match file.bits.allocated {
        8 => values.iter().map(|v| v.to_le_bytes()[0]).collect(),
        _ => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
    })
}

/// Decodes with dicom-pixeldata, which needs a whole object. The object is built from the frame and the attributes that
/// decoders read, so nothing else of the file reaches them.
fn by_registry(file: &FileHead, packed: &[u8]) -> std::result::Result<Vec<u8>, String> {
    let object = minimal_object(file, packed);
    let object = dicom_object::from_reader(&object[..]).map_err(|e| e.to_string())?;
    let decoded = object.decode_pixel_data().map_err(|e| innermost(&e))?;
    Ok(decoded.data().to_vec())
}

/// Returns the text of the innermost error of a chain: the cause, not the layers that passed it on.
fn innermost(e: &dyn std::error::Error) -> String {
    let mut e = e;
    while let Some(source) = e.source() {
        e = source;
    }
    e.to_string()
}

/// Builds a DICOM file of one grey frame in one fragment, with the attributes that a decoder needs.
fn minimal_object(file: &FileHead, packed: &[u8]) -> Vec<u8> {
    let mut out = vec![0; 128];
    out.extend(b"DICM");
    let text = |element: u16, group: u16, vr: &[u8; 2], value: &str, pad: u8| {
        let mut v = value.as_bytes().to_vec();
        v.resize(v.len().next_multiple_of(2), pad);
        let mut e = [group.to_le_bytes(), element.to_le_bytes()].concat();
        e.extend(vr);
        e.extend((v.len() as u16).to_le_bytes());
        e.extend(v);
        e
    };
    let mut meta = b"\x02\0\x01\0OB\0\0\x02\0\0\0\0\x01".to_vec();
    // Secondary capture; instance and implementation are placeholders under the UUID-derived root.
    for (element, uid) in
        [(2, "1.2.840.10008.5.1.4.1.1.7"), (3, "2.25.1"), (0x10, file.syntax.as_str()), (0x12, "2.25.2")]
    {
        meta.extend(text(element, 2, b"UI", uid, 0));
    }
    out.extend(b"\x02\0\0\0UL\x04\0");
    out.extend((meta.len() as u32).to_le_bytes());
    out.extend(meta);
    let mut short = |element: u16, value: u16| {
        out.extend([0x28, 0]);
        out.extend(element.to_le_bytes());
        out.extend(b"US\x02\0");
        out.extend(value.to_le_bytes());
        if element == 2 {
            out.extend(text(4, 0x28, b"CS", "MONOCHROME2", b' '));
        }
    };
    let b = file.bits;
    for (element, value) in [
        (0x02, 1),
        (0x10, file.rows),
        (0x11, file.cols),
        (0x100, b.allocated),
        (0x101, b.stored),
        (0x102, b.high),
        (0x103, u16::from(b.signed)),
    ] {
        short(element, value);
    }
    // Pixel data of undefined length: an empty offset table, the frame (of even length), the delimiter.
    out.extend(b"\xe0\x7f\x10\0OB\0\0\xff\xff\xff\xff\xfe\xff\x00\xe0\0\0\0\0\xfe\xff\x00\xe0");
    out.extend((packed.len().next_multiple_of(2) as u32).to_le_bytes());
    out.extend(packed);
    out.extend(std::iter::repeat_n(0, packed.len() % 2));
    out.extend(b"\xfe\xff\xdd\xe0\0\0\0\0");
    out
}

/// The declarations of a single-component code stream.
struct Coded {
    /// Width and height.
    size: (u32, u32),
    /// Bits per sample.
    bits: u8,
}

fn coded(codec: Codec, packed: &[u8]) -> Option<Coded> {
    let short = |at: usize| Some(u16::from_be_bytes(packed.get(at..at + 2)?.try_into().ok()?));
    let long = |at: usize| Some(u32::from_be_bytes(packed.get(at..at + 4)?.try_into().ok()?));
    if codec == Codec::Jpeg2000 {
        // The code stream may be inside boxes; its first two markers are SOC and SIZ (T.800, annex A).
        let head = &packed[..packed.len().min(4096)];
        let siz = head.windows(4).position(|w| w == [0xFF, 0x4F, 0xFF, 0x51])? + 4;
        let field = |k: usize| long(siz + 4 + 4 * k);
        let (x, y, x0, y0) = (field(0)?, field(1)?, field(2)?, field(3)?);
        let (tile_x, tile_y) = (field(4)?, field(5)?);
        let tiles = u64::from(x).div_ceil(u64::from(tile_x.max(1))) * u64::from(y).div_ceil(u64::from(tile_y.max(1)));
        let bits = (packed.get(siz + 38)? & 0x7F) + 1;
        let plain = short(siz + 36)? == 1 && packed.get(siz + 39..siz + 41)? == [1, 1];
        let possible = plain && bits <= 16 && tile_x > 0 && tile_y > 0 && tiles <= MOST_TILES;
        return possible.then_some(Coded { size: (x.checked_sub(x0)?, y.checked_sub(y0)?), bits });
    }
    // JPEG and JPEG-LS: segments up to the start of a frame (T.81, annex B).
    if !packed.starts_with(&[0xFF, 0xD8]) {
        return None;
    }
    let mut at = 2;
    loop {
        match packed.get(at..at + 2)? {
            [0xFF, 0xFF] => at += 1,
            [0xFF, 0xC0..=0xC3 | 0xC5..=0xC7 | 0xC9..=0xCB | 0xCD..=0xCF | 0xF7] => {
                let one = *packed.get(at + 9)? == 1;
                let size = (short(at + 7)?.into(), short(at + 5)?.into());
                return one.then_some(Coded { size, bits: *packed.get(at + 4)? });
            }
            [0xFF, _] => at += 2 + usize::from(short(at + 2)?),
            _ => return None,
        }
    }
}

/// Converts stored samples to HU and returns how many were padding.
fn to_hus(slice: &Slice, bytes: &[u8], order: ByteOrder, out: &mut [i16]) -> usize {
    let file = &slice.file;
    let bits = file.bits;
    let shift = bits.high + 1 - bits.stored;
    let unused = 32 - u32::from(bits.stored);
    let mut padding = 0;
    let mut put = |o: &mut i16, raw: u32| {
        // Shift the value to the top of the word and back. This removes the bits above it (overlays) and extends the
        // sign.
        let top = (raw >> shift) << unused;
        let value = if bits.signed { (top as i32) >> unused } else { (top >> unused) as i32 };
        let padded = file.padding.is_some_and(|(low, high)| (low..=high).contains(&value));
        padding += usize::from(padded);
        *o = if padded { AIR_HU } else { to_hu(f64::from(value) * slice.slope + slice.intercept) };
    };
    match (bits.allocated, order) {
        (8, _) => out.iter_mut().zip(bytes).for_each(|(o, b)| put(o, u32::from(*b))),
        (_, ByteOrder::Little) => {
            out.iter_mut().zip(bytes.as_chunks().0).for_each(|(o, b)| put(o, u32::from(u16::from_le_bytes(*b))));
        }
        (_, ByteOrder::Big) => {
            out.iter_mut().zip(bytes.as_chunks().0).for_each(|(o, b)| put(o, u32::from(u16::from_be_bytes(*b))));
        }
    }
    padding
}
