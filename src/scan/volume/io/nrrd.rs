//! NRRD: `.nrrd` with the data after the header, `.nhdr` with the data in a separate file.
//!
//! Fields and encodings follow Teem's "Definition of NRRD File Format".

#[path = "nrrd_grid.rs"]
mod axes;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use glam::{DMat3, DVec3};

use super::Scanned;
use super::raw::{ByteOrder, Element, Encoding};
use super::source::{self, Packing, Section};
use super::text::{self, bad, exactly};
use super::voxels::VoxelKind;
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::{Grid, Volume};

/// True if the bytes are the start of a NRRD file.
pub(crate) fn recognises(head: &[u8]) -> bool {
    head.starts_with(b"NRRD")
}

/// The fields of a header and the position where its data would begin.
struct Fields<'a> {
    path: &'a Path,
    map: BTreeMap<String, String>,
    /// End of the empty line; `None` for a header without one, which cannot be followed by data.
    end: Option<u64>,
}

impl Fields<'_> {
    fn get(&self, names: &[&'static str]) -> Option<(&'static str, &str)> {
        names.iter().find_map(|n| self.map.get(*n).map(|v| (*n, v.as_str())))
    }

    fn need(&self, name: &'static str) -> Result<&str> {
        let missing = || Error::file(self.path, format!("its header has no {name:?}"), "export it again");
        self.map.get(name).map(String::as_str).ok_or_else(missing)
    }
}

fn fields<'a>(path: &'a Path, head: &[u8]) -> Result<Fields<'a>> {
    let mut map = BTreeMap::new();
    let mut at = 0;
    let mut end = None;
    for (k, line) in head.split_inclusive(|b| *b == b'\n').enumerate() {
        at += line.len() as u64;
        let line = String::from_utf8_lossy(line);
        let line = line.trim();
        if k == 0 {
            let version = line.strip_prefix("NRRD").and_then(|v| v.parse::<u32>().ok());
            if !version.is_some_and(|v| (1..=5).contains(&v)) {
                return Err(bad(path, "its first line", line, "NRRD0001 to NRRD0005"));
            }
        } else if line.is_empty() {
            end = Some(at);
            break;
        } else if !line.starts_with('#') && !line.contains(":=") {
            let (key, value) =
                line.split_once(':').ok_or_else(|| bad(path, "a line of the header", line, "FIELD: VALUE"))?;
            let (key, value) = (key.trim().to_ascii_lowercase(), value.trim().to_owned());
            // The names of files follow, one a line.
            let is_list = ["data file", "datafile"].contains(&&*key) && (value == "LIST" || value.starts_with("LIST "));
            map.insert(key, value);
            if is_list {
                break;
            }
        }
    }
    Ok(Fields { path, map, end })
}

/// Reads the scan. Fails with status 3 if the header is invalid or the data does not match it, status 4 if cancelled.
pub(crate) fn load(path: &Path, progress: &Progress) -> Result<Scanned> {
    let head = source::head(path, text::MAX_HEADER)?;
    let fields = fields(path, &head)?;
    let mut notes = Vec::new();
    let grid = axes::grid(&fields, &mut notes)?;
    let encoding = encoding(&fields)?;
    let section = section(&fields, &grid, &encoding)?;
    let (data, counts) = section.read(grid.len(), &encoding, progress)?;
    notes.extend(super::strange_note(counts.strange));
    Ok(Scanned { volume: Volume::new(grid, data), notes, fractions: counts.fractions })
}

fn encoding(f: &Fields) -> Result<Encoding> {
    let value = f.need("type")?;
    // Names are not case-sensitive.
    let element = match value.to_ascii_lowercase().as_str() {
        "signed char" | "int8" | "int8_t" => Element::I8,
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => Element::U8,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => Element::I16,
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => Element::U16,
        "int" | "signed int" | "int32" | "int32_t" => Element::I32,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => Element::U32,
        "longlong"
        | "long long"
        | "long long int"
        | "signed long long"
        | "signed long long int"
        | "int64"
        | "int64_t" => Element::I64,
        "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => Element::U64,
        "float" => Element::F32,
        "double" => Element::F64,
        _ => return Err(bad(f.path, "type", value, "an integer or float type")),
    };
    let binary = packing(f)? != Packing::Text;
    let order = match f.get(&["endian"]) {
        Some((_, value)) if value.eq_ignore_ascii_case("little") => ByteOrder::Little,
        Some((_, value)) if value.eq_ignore_ascii_case("big") => ByteOrder::Big,
        None if element.size() == 1 || !binary => ByteOrder::Little,
        None => return Err(Error::file(f.path, "its header has no \"endian\"", "export it again")),
        Some((key, value)) => return Err(bad(f.path, key, value, "little or big")),
    };
    Ok(Encoding::plain(element, order))
}

fn packing(f: &Fields) -> Result<Packing> {
    let value = f.need("encoding")?;
    match value.to_ascii_lowercase().as_str() {
        "raw" => Ok(Packing::Raw),
        "gz" | "gzip" => Ok(Packing::Gzip),
        "txt" | "text" | "ascii" => Ok(Packing::Text),
        _ => Err(bad(f.path, "encoding", value, "raw, gzip or ascii")),
    }
}

fn section(f: &Fields, grid: &Grid, encoding: &Encoding) -> Result<Section> {
    let path = f.path;
    let packing = packing(f)?;
    let number = |names: &[&'static str]| match f.get(names) {
        None => Ok(0),
        Some((key, value)) => exactly::<i64, 1>(value)
            .map(|[n]| n)
            .filter(|n| *n >= -1)
            .ok_or_else(|| bad(path, key, value, "a whole number")),
    };
    let lines = number(&["line skip", "lineskip"])?;
    let bytes = number(&["byte skip", "byteskip"])?;
    let (data, begin) = match f.get(&["data file", "datafile"]) {
        Some((_, name)) if name == "LIST" || name.starts_with("LIST ") || name.contains('%') => {
            return Err(Error::file(path, "keeps each slice in its own file", "convert it to one data file"));
        }
        Some((_, name)) => (text::data_file(path, name)?, 0),
        None => {
            let end = f.end.ok_or_else(|| {
                Error::file(path, "its header does not end and names no data file", "copy or export it again")
            })?;
            (path.to_owned(), end)
        }
    };
    if lines < 0 {
        return Err(bad(path, "line skip", &lines.to_string(), "zero or more"));
    }
    let begin = if lines > 0 { after_lines(&data, begin, lines as u64)? } else { begin };
    match (bytes, packing) {
        (-1, Packing::Raw) => {
            let len = source::open(&data)?.1;
            let size = (grid.len() as u64).saturating_mul(encoding.element.size() as u64);
            let offset = len.checked_sub(size).filter(|o| *o >= begin).ok_or_else(|| {
                let why = format!("ends early: the header declares {size} bytes of voxels, {len} bytes are there");
                Error::file(&data, why, "copy or export it again")
            })?;
            Ok(Section { path: data, offset, skip: 0, packing })
        }
        (-1, _) => Err(bad(path, "byte skip", "-1", "zero or more unless the encoding is raw")),
        // The skip counts uncompressed bytes.
        (n, Packing::Gzip) => Ok(Section { path: data, offset: begin, skip: n as u64, packing }),
        (n, _) => Ok(Section { path: data, offset: begin.saturating_add(n as u64), skip: 0, packing }),
    }
}

/// Returns the position after skipping `lines` lines.
fn after_lines(path: &Path, begin: u64, lines: u64) -> Result<u64> {
    use std::io::{BufRead, BufReader, Seek, SeekFrom};
    let (mut file, _) = source::open(path)?;
    let fail = |e: std::io::Error| source::unreadable(path, e);
    file.seek(SeekFrom::Start(begin)).map_err(&fail)?;
    let mut reader = BufReader::new(file);
    let mut at = begin;
    for _ in 0..lines {
        let n = reader.skip_until(b'\n').map_err(&fail)?;
        if n == 0 {
            return Err(Error::file(path, format!("ends within the {lines} lines to skip"), "correct the header"));
        }
        at += n as u64;
    }
    Ok(at)
}

/// Returns the header for `grid` with gzipped voxels of `kind`, in `data_file` or (`None`) after the header.
pub(crate) fn header(grid: &Grid, kind: VoxelKind, data_file: Option<&str>, pairs: &[(String, String)]) -> String {
    let [x, y, z] = grid.dims();
    let steps = grid.direction() * DMat3::from_diagonal(grid.spacing());
    let v = |v: DVec3| format!("({},{},{})", v.x, v.y, v.z);
    let mut h = String::new();
    // Writing to a string cannot fail.
    let _ = write!(
        h,
        "NRRD0004\ntype: {}\ndimension: 3\nspace: left-posterior-superior\nsizes: {x} {y} {z}\n\
         space directions: {} {} {}\nkinds: domain domain domain\nendian: little\nencoding: gzip\nspace origin: {}\n",
        match kind {
            VoxelKind::Scan => "int16",
            VoxelKind::Labels => "uint8",
        },
        v(steps.x_axis),
        v(steps.y_axis),
        v(steps.z_axis),
        v(grid.origin()),
    );
    for (key, value) in pairs {
        let _ = writeln!(h, "{key}:={value}");
    }
    match data_file {
        Some(name) => {
            let _ = writeln!(h, "data file: {name}");
        }
        None => h.push('\n'),
    }
    h
}
