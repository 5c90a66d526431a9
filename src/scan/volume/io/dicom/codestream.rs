//! Frames compressed by a codec: what a code stream declares, and its samples.
//!
//! Each decoder is called directly, with the code stream of one frame. Libraries for whole DICOM files call the same decoders, but want
//! the frame inside a file with all its attributes, and need twenty more packages for what [`super::dataset`] reads already.

use std::borrow::Cow;

use super::rle;
use super::samples::Layout;
use super::slice::FileHead;
use crate::error::{Error, Result};
use crate::panics::catch_panic;
use crate::volume::io::raw::ByteOrder;

/// Decoded data smaller than this is harmless, whatever the header declares, bytes.
pub(super) const HARMLESS: usize = 1 << 20;
/// Maximum expansion of a compressed slice, as a multiple of its size. It is far above what scans reach, since even an
/// empty slice has a code for each of its blocks.
pub(super) const MOST_EXPANSION: usize = 2000;
/// Maximum number of tiles in a JPEG 2000 image.
const MOST_TILES: u64 = 4096;

/// Pixel compression of a transfer syntax.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Codec {
    Native(ByteOrder),
    Rle,
    Jpeg,
    JpegLs,
    Jpeg2000,
}

impl Codec {
    /// True if a fragment is the start of a frame. The marker of a start cannot occur at the start of a frame's later fragments:
    /// inside a code stream these bytes are stuffed.
    fn begins(self, fragment: &[u8]) -> bool {
        match self {
            Self::Jpeg | Self::JpegLs => fragment.starts_with(&[0xFF, 0xD8]),
            Self::Jpeg2000 => {
                fragment.starts_with(&[0xFF, 0x4F, 0xFF, 0x51]) || fragment.starts_with(b"\0\0\0\x0CjP  ")
            }
            Self::Native(_) | Self::Rle => true,
        }
    }
}

/// Returns the compressed bytes of one frame. A frame may be in several fragments. Fails with status 3 if the fragments cannot be
/// told apart by frames.
pub(super) fn frame_of<'a>(file: &FileHead, codec: Codec, parts: &[&'a [u8]], frame: u32) -> Result<Cow<'a, [u8]>> {
    let (frames, frame) = (file.frames as usize, frame as usize);
    match parts {
        [] => Err(Error::file(&file.path, "has no pixel data", "copy or export it again")),
        [one] if frames == 1 => Ok(Cow::Borrowed(one)),
        _ if frames == 1 => Ok(Cow::Owned(parts.concat())),
        _ if parts.len() == frames => Ok(Cow::Borrowed(parts[frame])),
        _ => {
            let mut starts: Vec<usize> = (0..parts.len()).filter(|k| codec.begins(parts[*k])).collect();
            if starts.len() != frames || starts[0] != 0 {
                let why = format!("has {} fragments for {frames} frames", parts.len());
                return Err(Error::file(&file.path, why, "export it as single slices"));
            }
            starts.push(parts.len());
            Ok(Cow::Owned(parts[starts[frame]..starts[frame + 1]].concat()))
        }
    }
}

/// The samples of a frame.
pub(super) struct Unpacked {
    /// Little-endian samples.
    pub bytes: Vec<u8>,
    /// Where in a sample the value lies.
    pub layout: Layout,
}

/// Decompresses one frame. Fails with status 3 if it is damaged, or not of the header's size.
pub(super) fn unpack(file: &FileHead, codec: Codec, packed: &[u8]) -> Result<Unpacked> {
    let path = file.path.as_path();
    let damaged = |why: String| Error::file(path, format!("its pixel data {why}"), "copy or export it again");
    let voxels = usize::from(file.rows) * usize::from(file.cols);
    // The code stream declares its own size, and the decoder allocates by that.
    let coded = if codec == Codec::Rle {
        None
    } else {
        let wanted = (u32::from(file.cols), u32::from(file.rows));
        let coded = coded(codec, packed).ok_or_else(|| damaged("does not match its transfer syntax".to_owned()))?;
        if coded.size != wanted {
            let (x, y) = coded.size;
            return Err(damaged(format!("is {x}×{y}, but the header says {}×{}", wanted.0, wanted.1)));
        }
        Some(coded)
    };
    let sample = coded.as_ref().map_or(usize::from(file.bits.allocated / 8), |c| c.sample(codec));
    let size = voxels * sample;
    if size > HARMLESS.max(packed.len().saturating_mul(MOST_EXPANSION)) {
        return Err(damaged(format!("is {} bytes, which cannot hold {size}", packed.len())));
    }
    let outcome = catch_panic(|| match codec {
        Codec::JpegLs => by_jpegls(file, packed),
        Codec::Jpeg => by_jpeg(packed),
        Codec::Jpeg2000 => by_jpeg2000(sample, packed),
        Codec::Rle | Codec::Native(_) => rle::unpack(packed, voxels, sample),
    });
    let bytes = outcome
        .map_err(|_| damaged("is damaged (the decoder failed)".to_owned()))?
        .map_err(|why| damaged(format!("is damaged ({why})")))?;
    if bytes.len() != size {
        return Err(damaged(format!("decodes to {} bytes, but the header declares {size}", bytes.len())));
    }
    let layout = match coded {
        Some(coded) => Layout::of_stream(file, coded.bits.into(), coded.signed, sample, &bytes),
        None => Layout::native(file.bits, ByteOrder::Little),
    };
    Ok(Unpacked { bytes, layout })
}

fn by_jpegls(file: &FileHead, packed: &[u8]) -> std::result::Result<Vec<u8>, String> {
    let (values, _, _) = jpegls::decode(packed, file.cols.into(), file.rows.into()).map_err(|e| e.to_string())?;
    Ok(values.iter().flat_map(|v| v.to_le_bytes()).collect())
}

/// Decodes JPEG: baseline, extended and lossless (T.81).
fn by_jpeg(packed: &[u8]) -> std::result::Result<Vec<u8>, String> {
    jpeg_decoder::Decoder::new(packed).decode().map_err(|e| innermost(&e))
}

/// Decodes JPEG 2000 (T.800) to samples of `sample` bytes.
fn by_jpeg2000(sample: usize, packed: &[u8]) -> std::result::Result<Vec<u8>, String> {
    let image = jpeg2k::Image::from_bytes(packed).map_err(|e| innermost(&e))?;
    // A palette turns one coded component into several.
    let [component] = image.components() else { return Err(format!("has {} components", image.components().len())) };
    let mut bytes = Vec::with_capacity(component.data().len() * sample);
    for value in component.data() {
        bytes.extend_from_slice(&value.to_le_bytes()[..sample]);
    }
    Ok(bytes)
}

/// Returns the text of the innermost error of a chain: the cause, not the layers that passed it on.
fn innermost(e: &dyn std::error::Error) -> String {
    let mut e = e;
    while let Some(source) = e.source() {
        e = source;
    }
    e.to_string()
}

/// The declarations of a single-component code stream.
struct Coded {
    /// Width and height.
    size: (u32, u32),
    /// Bits per sample, 1 to 16.
    bits: u8,
    /// True if samples are signed. Only JPEG 2000 can declare it.
    signed: bool,
}

impl Coded {
    /// Returns the bytes of a decoded sample.
    fn sample(&self, codec: Codec) -> usize {
        let one = match codec {
            // The decoder gives two bytes for every other precision.
            Codec::Jpeg => self.bits == 8,
            Codec::Jpeg2000 => self.bits <= 8,
            _ => false,
        };
        if one { 1 } else { 2 }
    }
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
        let depth = *packed.get(siz + 38)?;
        let bits = (depth & 0x7F) + 1;
        let plain = short(siz + 36)? == 1 && packed.get(siz + 39..siz + 41)? == [1, 1];
        let possible = plain && bits <= 16 && tile_x > 0 && tile_y > 0 && tiles <= MOST_TILES;
        return possible.then_some(Coded {
            size: (x.checked_sub(x0)?, y.checked_sub(y0)?),
            bits,
            signed: depth & 0x80 != 0,
        });
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
                let bits = *packed.get(at + 4)?;
                return (one && (1..=16).contains(&bits)).then_some(Coded { size, bits, signed: false });
            }
            [0xFF, _] => at += 2 + usize::from(short(at + 2)?),
            _ => return None,
        }
    }
}
