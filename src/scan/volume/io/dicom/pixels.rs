//! Conversion of pixel data to HU: uncompressed, or by a decoder whose [panics](crate::panics) are caught.

use std::borrow::Cow;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::Arc;

use rayon::prelude::*;

use super::codestream::{Codec, HARMLESS, MOST_EXPANSION, frame_of, unpack};
use super::dataset::Fault;
use super::fragments::fragments;
use super::lut::Lut;
use super::parse::parse;
use super::samples::{self, Layout, Padded};
use super::slice::{self, FileHead, Slice};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::io::raw::ByteOrder;
use crate::volume::io::source;

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

/// Rejects transfer syntaxes without a decoder, before any memory is allocated. Fails with status 3 and the transfer syntax.
pub(crate) fn check_syntax(file: &FileHead) -> Result<()> {
    match codec(&file.path, &file.syntax)? {
        Codec::Native(_) => Ok(()),
        _ if file.pixels.is_float => Err(Error::file(&file.path, "has compressed floats", "export it uncompressed")),
        _ => Ok(()),
    }
}

/// Rejects a compressed file that is too small for its declared size, before that memory is allocated. Fails with status 3 and
/// both sizes.
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

/// Decodes `slices` in order into `out` and counts the voxels of padding. Fails with status 3 if pixel data is damaged, status 4 if
/// cancelled. If several slices are damaged, the first is named.
pub(crate) fn decode(slices: &[Slice], out: &mut [i16], progress: &Progress) -> Result<Padded> {
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
    let results: Vec<Result<Padded>> =
        groups.into_par_iter().map(|(file, frames)| decode_file(&file, frames, progress)).collect();
    results.into_iter().sum()
}

fn decode_file(file: &FileHead, frames: Vec<Target>, progress: &Progress) -> Result<Padded> {
    progress.check()?;
    let path = file.path.as_path();
    let voxels = usize::from(file.rows) * usize::from(file.cols);
    let sample = usize::from(file.bits.allocated / 8);
    let codec = codec(path, &file.syntax)?;
    let is_float = file.pixels.is_float;
    let lut = if file.has_lut { Some(read_lut(file)?) } else { None };
    let lut = lut.as_ref();
    let results: Vec<Result<Padded>> = match codec {
        Codec::Native(order) if file.syntax != "1.2.840.10008.1.2.1.99" => frames
            .into_par_iter()
            .map(|(slice, target)| {
                let begin = (file.pixels.offset + slice.frame as usize * voxels * sample) as u64;
                let bytes = read(path, begin, voxels * sample)?;
                progress.advance(1)?;
                if is_float {
                    return Ok(samples::floats_to_hus(slice, &bytes, order, target));
                }
                Ok(samples::to_hus(slice, &bytes, Layout::native(file.bits, order), lut, target))
            })
            .collect(),
        _ => {
            let (_, len) = source::open(path)?;
            let bytes = read(path, 0, usize::try_from(len).unwrap_or(usize::MAX))?;
            let body = match codec {
                // The pixel position refers to the inflated bytes.
                Codec::Native(_) => parse(&bytes).map_err(|e| fault(path, e))?.1,
                _ => Cow::Borrowed(&bytes[..]),
            };
            let parts = match codec {
                Codec::Native(_) => Vec::new(),
                _ => fragments(&body, file.pixels.offset).map_err(|e| fault(path, e))?,
            };
            frames
                .into_par_iter()
                .map(|(slice, target)| {
                    let (decoded, layout) = match codec {
                        Codec::Native(order) => {
                            let begin = file.pixels.offset + slice.frame as usize * voxels * sample;
                            let frame = body.get(begin..begin + voxels * sample);
                            let frame = frame.ok_or_else(|| fault(path, Fault::Short))?;
                            if is_float {
                                progress.advance(1)?;
                                return Ok(samples::floats_to_hus(slice, frame, order, target));
                            }
                            (Cow::Borrowed(frame), Layout::native(file.bits, order))
                        }
                        _ => {
                            let frame = unpack(file, codec, &frame_of(file, codec, &parts, slice.frame)?)?;
                            (Cow::Owned(frame.bytes), frame.layout)
                        }
                    };
                    progress.advance(1)?;
                    Ok(samples::to_hus(slice, &decoded, layout, lut, target))
                })
                .collect()
        }
    };
    results.into_iter().sum()
}

/// Reads the Modality LUT of a file again: scans hardly have one, and one a slice would be much to keep.
fn read_lut(file: &FileHead) -> Result<Lut> {
    let (set, _) = slice::header(&file.path)?;
    Lut::of(&set.root, file.bits.signed).map_err(|why| Error::file(&file.path, why, "export it again"))
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
