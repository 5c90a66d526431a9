//! Reading voxels from a section of a file: checked against the file's real size, chunked, with progress, cancellable.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::mpsc::sync_channel;

use flate2::bufread::{GzDecoder, ZlibDecoder};

use super::raw::{Counts, Encoding};
use crate::error::{Error, Result};
use crate::progress::Progress;

/// Maximum compression ratio of deflate (1032 to 1, from the format's longest match), rounded up.
const MAX_DEFLATE_RATIO: u64 = 1040;
/// Size of a buffer of stored voxels between file and volume, bytes; three are in use.
const CHUNK: usize = 1 << 20;
/// First allocation for data whose real size is only known after decompression, voxels.
const FIRST_GROWTH: usize = 8 << 20;

/// How voxels are packed in their file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Packing {
    /// Not packed.
    Raw,
    /// gzip, one or several members.
    Gzip,
    /// zlib or gzip, distinguished by the first bytes.
    Zlib,
    /// Decimal numbers separated by white space or commas.
    Text,
}

/// The section of a file that contains voxels.
#[derive(Clone, Debug)]
pub(crate) struct Section {
    /// The file.
    pub path: PathBuf,
    /// Start of the section, bytes.
    pub offset: u64,
    /// Bytes of unpacked data before the first voxel.
    pub skip: u64,
    /// Packing of the section.
    pub packing: Packing,
}

/// Opens a regular file and returns it with its length in bytes. Fails with status 3 if the file is missing, a folder, a device, or
/// not readable.
pub(crate) fn open(path: &Path) -> Result<(File, u64)> {
    // Check before opening: opening a pipe without a writer would block forever.
    let meta = std::fs::metadata(path).map_err(|e| unreadable(path, e))?;
    if meta.is_dir() {
        return Err(Error::file(path, "is a folder where a file is expected", "name a file"));
    }
    if !meta.is_file() {
        return Err(Error::file(path, "is not a regular file", "give a file"));
    }
    let file = File::open(path).map_err(|e| unreadable(path, e))?;
    Ok((file, meta.len()))
}

/// Converts an `io::Error` from reading `path` to an error.
pub(crate) fn unreadable(path: &Path, e: io::Error) -> Error {
    if let Some(own) = e.get_ref().and_then(|inner| inner.downcast_ref::<Error>()) {
        return own.clone();
    }
    let (why, hint) = match e.kind() {
        io::ErrorKind::NotFound | io::ErrorKind::NotADirectory => ("does not exist".to_owned(), "check the name"),
        io::ErrorKind::PermissionDenied => ("permission denied".to_owned(), "make it readable"),
        io::ErrorKind::UnexpectedEof => ("ends early".to_owned(), "copy or export it again"),
        io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput => {
            (format!("is damaged ({e})"), "copy or export it again")
        }
        _ => (format!("cannot be read ({e})"), "check the file and its disk"),
    };
    Error::file(path, why, hint).caused_by(e)
}

/// Reads at most `limit` bytes from the start of a file, decompressed if it is gzip. Fails as [`open`] does, and if gzip data is
/// damaged.
pub(crate) fn head(path: &Path, limit: u64) -> Result<Vec<u8>> {
    let (file, len) = open(path)?;
    let mut reader = BufReader::new(file);
    let gzip = reader.fill_buf().map_err(|e| unreadable(path, e))?.starts_with(&[0x1f, 0x8b]);
    let mut bytes = Vec::new();
    if gzip {
        GzDecoder::new(reader).take(limit).read_to_end(&mut bytes)
    } else {
        reader.take(limit.min(len)).read_to_end(&mut bytes)
    }
    .map_err(|e| unreadable(path, e))?;
    Ok(bytes)
}

/// True if the file starts like gzip.
pub(crate) fn is_gzip(path: &Path) -> Result<bool> {
    let (file, _) = open(path)?;
    let mut magic = Vec::new();
    file.take(2).read_to_end(&mut magic).map_err(|e| unreadable(path, e))?;
    Ok(magic == [0x1f, 0x8b])
}

/// Rejects a volume of `count` `i16` voxels that does not fit in the system's available memory. Fails with status 3 and both sizes.
pub(crate) fn check_memory(path: &Path, count: usize) -> Result<()> {
    let needed = 2 * count as u64;
    let free = std::fs::read_to_string("/proc/meminfo").ok().and_then(|text| {
        let line = text.lines().find(|l| l.starts_with("MemAvailable:"))?;
        Some(line.split_whitespace().nth(1)?.parse::<u64>().ok()?.saturating_mul(1024))
    });
    match free {
        Some(free) if needed > free => Err(Error::file(
            path,
            format!("needs {needed} bytes of memory and {free} are free"),
            "crop or resample it first",
        )),
        _ => Ok(()),
    }
}

/// Reserves room in `values` for `extra` more values. Fails with status 3 if the memory cannot be allocated.
pub(crate) fn reserve(path: &Path, values: &mut Vec<i16>, extra: usize) -> Result<()> {
    values.try_reserve_exact(extra).map_err(|_| {
        Error::file(path, format!("needs {} bytes of memory", 2 * (values.len() + extra)), "crop or resample it first")
    })
}

/// How reliable the number of voxels is before they are read.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Size {
    /// The file has this many bytes.
    Certain,
    /// The header declares it, but packed data may turn out to be shorter.
    Declared,
}

impl Section {
    /// Reads `count` voxels. Returns them with the counts of those that are not whole numbers.
    ///
    /// The header's `count` is checked against the file's size before anything of that size is allocated. The check is exact for
    /// raw data and uses deflate's limit for packed data, where memory then grows with the data that arrives. Fails with status 3
    /// if the data is damaged or shorter than declared, status 4 if cancelled.
    pub(crate) fn read(&self, count: usize, encoding: &Encoding, progress: &Progress) -> Result<(Vec<i16>, Counts)> {
        let (mut file, len) = open(&self.path)?;
        let path = self.path.as_path();
        let room = len.saturating_sub(self.offset);
        let declared = (count as u64).checked_mul(encoding.element.size() as u64);
        let needed = declared.and_then(|d| d.checked_add(self.skip));
        let most = match self.packing {
            Packing::Raw => Some(room),
            Packing::Gzip | Packing::Zlib => room.checked_mul(MAX_DEFLATE_RATIO),
            Packing::Text => room.checked_add(1).map(|r| (r / 2).saturating_mul(encoding.element.size() as u64)),
        };
        let needed = needed.filter(|n| most.is_none_or(|m| *n <= m)).ok_or_else(|| {
            let packed = if self.packing == Packing::Raw { "" } else { " packed" };
            Error::file(
                path,
                format!("ends early: the header declares {} bytes of voxels, {room}{packed} bytes are there", {
                    declared.map_or_else(|| "more than 2^64".to_owned(), |d| d.to_string())
                }),
                "copy or export it again",
            )
        })?;
        check_memory(path, count)?;
        file.seek(SeekFrom::Start(self.offset)).map_err(|e| unreadable(path, e))?;
        progress.stage("reading", room.min(if self.packing == Packing::Raw { needed } else { room }));
        let counted = BufReader::with_capacity(1 << 18, Counted { file, progress });
        match self.packing {
            Packing::Raw => self.fill(counted, count, encoding, Size::Certain, progress),
            Packing::Gzip => self.fill(Gunzip::new(counted), count, encoding, Size::Declared, progress),
            Packing::Zlib => {
                let mut counted = counted;
                let first = counted.fill_buf().map_err(|e| unreadable(path, e))?;
                if first.starts_with(&[0x1f, 0x8b]) {
                    self.fill(Gunzip::new(counted), count, encoding, Size::Declared, progress)
                } else {
                    self.fill(ZlibDecoder::new(counted), count, encoding, Size::Declared, progress)
                }
            }
            Packing::Text => self.fill_text(counted, count, encoding, progress),
        }
    }

    /// Fills the volume. One thread unpacks while this one converts, so loading takes as long as unpacking.
    fn fill(
        &self,
        mut source: impl Read + Send,
        count: usize,
        encoding: &Encoding,
        size: Size,
        progress: &Progress,
    ) -> Result<(Vec<i16>, Counts)> {
        let path = self.path.as_path();
        let voxel = encoding.element.size();
        let total = count * voxel;
        std::thread::scope(|scope| {
            let (full_in, full) = sync_channel::<io::Result<Vec<u8>>>(1);
            let (empty_in, empty) = sync_channel::<Vec<u8>>(3);
            scope.spawn(move || {
                let outcome = skip(&mut source, self.skip).and_then(|()| {
                    let mut left = total;
                    while left > 0 {
                        let mut buffer = empty.try_recv().unwrap_or_default();
                        buffer.resize(left.min(CHUNK), 0);
                        let got = read_full(&mut source, &mut buffer)?;
                        buffer.truncate(got);
                        left -= got;
                        let short = got == 0;
                        // A closed channel means that the other side has stopped and has its own error.
                        if short || full_in.send(Ok(buffer)).is_err() {
                            return Ok(());
                        }
                    }
                    finish(&mut source)
                });
                if let Err(e) = outcome {
                    // Same as above.
                    let _ = full_in.send(Err(e));
                }
            });
            let mut data = Vec::new();
            let mut counts = Counts::default();
            for chunk in full {
                let chunk = chunk.map_err(|e| unreadable(path, e))?;
                progress.check()?;
                let from = data.len();
                let to = from + chunk.len() / voxel;
                if to > data.capacity() {
                    let step = FIRST_GROWTH.max(from / 8);
                    let target = match size {
                        Size::Certain => count,
                        Size::Declared => count.min(to.max(from + step)),
                    };
                    reserve(path, &mut data, target - from)?;
                }
                data.resize(to, 0);
                counts += encoding.convert(&chunk, &mut data[from..]);
                // If the channel of empty buffers is full, one buffer is simply not reused.
                let _ = empty_in.try_send(chunk);
            }
            if data.len() < count {
                let got = data.len() * voxel;
                return Err(Error::file(
                    path,
                    format!("ends early: the header declares {total} bytes of voxels, {got} are there"),
                    "copy or export it again",
                ));
            }
            Ok((data, counts))
        })
    }

    fn fill_text(
        &self,
        mut source: impl BufRead,
        count: usize,
        encoding: &Encoding,
        progress: &Progress,
    ) -> Result<(Vec<i16>, Counts)> {
        let path = self.path.as_path();
        let mut data = Vec::new();
        reserve(path, &mut data, count)?;
        let mut counts = Counts::default();
        let mut token = Vec::new();
        while data.len() < count {
            token.clear();
            // Numbers are short; a longer run without a separator is not a number.
            let got = token_into(&mut source, &mut token, 64).map_err(|e| unreadable(path, e))?;
            if !got {
                return Err(Error::file(
                    path,
                    format!("ends early: the header declares {count} values, {} are there", data.len()),
                    "copy or export it again",
                ));
            }
            let value: f64 = std::str::from_utf8(&token).ok().and_then(|t| t.parse().ok()).ok_or_else(|| {
                let text = String::from_utf8_lossy(&token).into_owned();
                Error::file(path, format!("value {} is {text:?}, not a number", data.len()), "export it again")
            })?;
            let hu = value * encoding.slope + encoding.intercept;
            counts.add(hu);
            data.push(super::raw::to_hu(hu));
            if data.len().is_multiple_of(1 << 16) {
                progress.check()?;
            }
        }
        Ok((data, counts))
    }
}

fn token_into(source: &mut impl BufRead, token: &mut Vec<u8>, limit: usize) -> io::Result<bool> {
    loop {
        let buffer = source.fill_buf()?;
        if buffer.is_empty() {
            return Ok(!token.is_empty());
        }
        let mut used = 0;
        for &b in buffer {
            used += 1;
            if b.is_ascii_whitespace() || b == b',' {
                if !token.is_empty() {
                    source.consume(used);
                    return Ok(true);
                }
            } else {
                token.push(b);
                if token.len() > limit {
                    return Ok(true);
                }
            }
        }
        source.consume(used);
    }
}

fn skip(source: &mut impl Read, bytes: u64) -> io::Result<()> {
    let skipped = io::copy(&mut source.by_ref().take(bytes), &mut io::sink())?;
    if skipped < bytes { Err(io::ErrorKind::UnexpectedEof.into()) } else { Ok(()) }
}

/// Reads until the buffer is full or the data ends.
fn read_full(source: &mut impl Read, buffer: &mut [u8]) -> io::Result<usize> {
    let mut got = 0;
    while got < buffer.len() {
        match source.read(&mut buffer[got..]) {
            Ok(0) => break,
            Ok(n) => got += n,
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            // A truncated stream is reported later by what arrived, with both sizes.
            Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => break,
            Err(e) => return Err(e),
        }
    }
    Ok(got)
}

/// Reads slightly past the last voxel, so that a packed stream verifies its checksum. Extra data does no harm.
fn finish(source: &mut impl Read) -> io::Result<()> {
    let mut rest = [0; 4096];
    for _ in 0..16 {
        if source.read(&mut rest)? == 0 {
            break;
        }
    }
    Ok(())
}

/// A file that reports bytes read to the progress and stops when the job is cancelled.
struct Counted<'a> {
    file: File,
    progress: &'a Progress,
}

impl Read for Counted<'_> {
    fn read(&mut self, buf: &mut [u8]) -> io::Result<usize> {
        let n = self.file.read(buf)?;
        self.progress.advance(n as u64).map_err(io::Error::other)?;
        Ok(n)
    }
}

/// A gzip reader for one or several members. Data after the last member is ignored, since zero padding is common.
struct Gunzip<R: BufRead> {
    member: Option<GzDecoder<R>>,
}

impl<R: BufRead> Gunzip<R> {
    fn new(source: R) -> Self {
        Self { member: Some(GzDecoder::new(source)) }
    }
}

impl<R: BufRead> Read for Gunzip<R> {
    fn read(&mut self, buf: &mut [u8]) -> io::Result<usize> {
        if buf.is_empty() {
            return Ok(0);
        }
        while let Some(member) = &mut self.member {
            let n = member.read(buf)?;
            if n > 0 {
                return Ok(n);
            }
            let Some(ended) = self.member.take() else { break };
            let mut source = ended.into_inner();
            if source.fill_buf()?.starts_with(&[0x1f, 0x8b]) {
                self.member = Some(GzDecoder::new(source));
            }
        }
        Ok(0)
    }
}
