//! MetaImage: `.mha` with the data after the header, `.mhd` with the data in a separate file.
//!
//! Tags and their aliases follow ITK's MetaIO. Its frame is LPS in mm, the same as ours.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use glam::{DMat3, DVec3};

use super::Scanned;
use super::frame;
use super::raw::{ByteOrder, Element, Encoding};
use super::source::{self, Packing, Section};
use super::text::{self, bad, exactly, some};
use super::voxels::VoxelKind;
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::{Grid, Volume};

/// True if the bytes are the start of a MetaImage header.
pub(crate) fn recognises(head: &[u8]) -> bool {
    let first = head.split(|b| *b == b'\n').find(|l| !l.trim_ascii().is_empty()).unwrap_or_default();
    let key = first.split(|b| *b == b'=').next().unwrap_or_default().trim_ascii();
    first.contains(&b'=') && [&b"ObjectType"[..], b"NDims", b"Comment", b"ObjectSubType"].contains(&key)
}

/// The tags of a header and the position of its end.
struct Tags<'a> {
    path: &'a Path,
    map: BTreeMap<String, String>,
    end: u64,
}

impl Tags<'_> {
    /// Returns the first value among several names for the same field.
    fn get(&self, names: &[&'static str]) -> Option<(&'static str, &str)> {
        names.iter().find_map(|n| self.map.get(*n).map(|v| (*n, v.as_str())))
    }

    fn truth(&self, names: &[&'static str]) -> Result<bool> {
        match self.get(names) {
            None => Ok(false),
            Some((_, v)) if v.starts_with(['T', 't', 'Y', 'y', '1']) => Ok(true),
            Some((_, v)) if v.starts_with(['F', 'f', 'N', 'n', '0']) => Ok(false),
            Some((k, v)) => Err(bad(self.path, k, v, "True or False")),
        }
    }

    /// Parses the first of the named fields as `axes` numbers, padded to three with `fill`.
    fn vector(&self, names: &[&'static str], axes: usize, fill: f64) -> Result<Option<[f64; 3]>> {
        let Some((key, value)) = self.get(names) else { return Ok(None) };
        let numbers: Vec<f64> = some(value)
            .filter(|v: &Vec<f64>| v.len() >= axes)
            .ok_or_else(|| bad(self.path, key, value, &format!("{axes} numbers")))?;
        Ok(Some(std::array::from_fn(|k| if k < axes { numbers[k] } else { fill })))
    }
}

fn tags<'a>(path: &'a Path, head: &[u8]) -> Result<Tags<'a>> {
    let mut map = BTreeMap::new();
    let mut end = 0;
    for line in head.split_inclusive(|b| *b == b'\n') {
        end += line.len() as u64;
        let line = String::from_utf8_lossy(line);
        let Some((key, value)) = line.split_once('=') else {
            if line.trim().is_empty() {
                continue;
            }
            return Err(bad(path, "a line of the header", line.trim(), "KEY = VALUE"));
        };
        let (key, value) = (key.trim().to_owned(), value.trim().to_owned());
        let last = key == "ElementDataFile";
        map.insert(key, value);
        if last {
            return Ok(Tags { path, map, end });
        }
    }
    Err(Error::file(path, "its header has no ElementDataFile", "export it again"))
}

/// Reads the scan. Fails with status 3 if the header is invalid or the data does not match it, status 4 if cancelled.
pub(crate) fn load(path: &Path, progress: &Progress) -> Result<Scanned> {
    let head = source::head(path, text::MAX_HEADER)?;
    let tags = tags(path, &head)?;
    let axes = axes(&tags)?;
    let mut notes = Vec::new();
    let grid = grid(&tags, axes, &mut notes)?;
    let encoding = encoding(&tags)?;
    let section = section(&tags, &grid, &encoding)?;
    let (data, counts) = section.read(grid.len(), &encoding, progress)?;
    notes.extend(super::strange_note(counts.strange));
    Ok(Scanned { volume: Volume::new(grid, data), notes, fractions: counts.fractions })
}

fn axes(t: &Tags) -> Result<usize> {
    if let Some((key, value)) = t.get(&["ObjectType"]).filter(|(_, v)| *v != "Image") {
        return Err(bad(t.path, key, value, "Image"));
    }
    match t.get(&["NDims"]) {
        Some((_, "2")) => Ok(2),
        Some((_, "3")) => Ok(3),
        Some((_, "4")) => Ok(4),
        Some((key, value)) => Err(bad(t.path, key, value, "2 or 3")),
        None => Err(Error::file(t.path, "its header has no NDims", "export it again")),
    }
}

fn grid(t: &Tags, axes: usize, notes: &mut Vec<String>) -> Result<Grid> {
    let path = t.path;
    let (key, value) =
        t.get(&["DimSize"]).ok_or_else(|| Error::file(path, "its header has no DimSize", "export it again"))?;
    let sizes: Vec<usize> = some(value)
        .filter(|v: &Vec<usize>| v.len() == axes)
        .ok_or_else(|| bad(path, key, value, &format!("{axes} whole numbers")))?;
    if sizes.get(3).is_some_and(|n| *n != 1) {
        return Err(Error::file(path, format!("has more than one frame (dims {sizes:?})"), "extract one frame first"));
    }
    let dims = std::array::from_fn(|k| sizes.get(k).copied().unwrap_or(1));
    text::voxel_count(path, dims)?;
    let solid = axes.min(3);
    // Check each separately: an invalid field is an error even if the other one is valid.
    let mut spacing = [1.0; 3];
    for name in ["ElementSize", "ElementSpacing"] {
        if let Some(s) = t.vector(&[name], solid, 1.0)? {
            frame::check_spacing(path, name, &s)?;
            spacing = s;
        }
    }
    if t.get(&["ElementSize", "ElementSpacing"]).is_none() {
        notes.push("has no spacing: 1 mm is assumed".to_owned());
    }
    let origin = t.vector(&["Offset", "Position", "Origin"], solid, 0.0)?.unwrap_or([0.0; 3]);
    let direction = match t.get(&["TransformMatrix", "Orientation", "Rotation"]) {
        None => DMat3::IDENTITY,
        Some((key, value)) => {
            let m: Vec<f64> = some(value)
                .filter(|m: &Vec<f64>| m.len() == axes * axes)
                .ok_or_else(|| bad(path, key, value, &format!("{} numbers", axes * axes)))?;
            // The numbers are the world directions of the index axes, in order.
            let axis = |k: usize| {
                if k < axes {
                    DVec3::from_array(std::array::from_fn(|i| if i < axes { m[k * axes + i] } else { 0.0 }))
                } else {
                    DVec3::Z
                }
            };
            DMat3::from_cols(axis(0), axis(1), axis(2))
        }
    };
    frame::grid(path, dims, DVec3::from_array(spacing), DVec3::from_array(origin), direction)
}

fn encoding(t: &Tags) -> Result<Encoding> {
    let path = t.path;
    if let Some((key, value)) = t.get(&["ElementNumberOfChannels"]).filter(|(_, v)| *v != "1") {
        return Err(bad(path, key, value, "1 (a single value for each voxel)"));
    }
    let (key, value) =
        t.get(&["ElementType"]).ok_or_else(|| Error::file(path, "its header has no ElementType", "export it again"))?;
    // MetaIO's "long" has four bytes on every platform.
    let element = match value {
        "MET_UCHAR" => Element::U8,
        "MET_CHAR" => Element::I8,
        "MET_USHORT" => Element::U16,
        "MET_SHORT" => Element::I16,
        "MET_UINT" | "MET_ULONG" => Element::U32,
        "MET_INT" | "MET_LONG" => Element::I32,
        "MET_ULONG_LONG" => Element::U64,
        "MET_LONG_LONG" => Element::I64,
        "MET_FLOAT" => Element::F32,
        "MET_DOUBLE" => Element::F64,
        _ => return Err(bad(path, key, value, "an integer or float type")),
    };
    let number = |name: &'static str, default: f64| match t.get(&[name]) {
        None => Ok(default),
        Some((k, v)) => exactly::<f64, 1>(v)
            .map(|[x]| x)
            .filter(|x| x.is_finite())
            .ok_or_else(|| bad(path, k, v, "a finite number")),
    };
    let msb_first = t.truth(&["BinaryDataByteOrderMSB", "ElementByteOrderMSB"])?;
    Ok(Encoding {
        element,
        order: if msb_first { ByteOrder::Big } else { ByteOrder::Little },
        slope: number("ElementToIntensityFunctionSlope", 1.0)?,
        intercept: number("ElementToIntensityFunctionOffset", 0.0)?,
    })
}

fn section(t: &Tags, grid: &Grid, encoding: &Encoding) -> Result<Section> {
    let path = t.path;
    let (_, name) = t.get(&["ElementDataFile"]).unwrap_or(("ElementDataFile", ""));
    let local = name.eq_ignore_ascii_case("local");
    if name == "LIST" || name.starts_with("LIST ") || name.contains('%') {
        return Err(Error::file(path, "keeps each slice in its own file", "convert it to one data file"));
    }
    let data = if local { path.to_owned() } else { text::data_file(path, name)? };
    // A header without BinaryData is binary in practice; only an explicit "False" means text.
    let packing = match (t.truth(&["CompressedData"])?, t.get(&["BinaryData"])) {
        (true, _) => Packing::Zlib,
        (false, Some(_)) if !t.truth(&["BinaryData"])? => Packing::Text,
        _ => Packing::Raw,
    };
    let mut offset = if local { t.end } else { 0 };
    if let Some((key, value)) = t.get(&["HeaderSize"]) {
        match exactly::<i64, 1>(value) {
            Some([-1]) if packing == Packing::Raw => {
                let len = source::open(&data)?.1;
                let bytes = (grid.len() as u64).saturating_mul(encoding.element.size() as u64);
                offset = len.checked_sub(bytes).ok_or_else(|| {
                    let why = format!("ends early: the header declares {bytes} bytes of voxels, {len} are there");
                    Error::file(&data, why, "copy or export it again")
                })?;
            }
            Some([0]) => {}
            Some([n]) if n > 0 => offset = n as u64,
            _ => return Err(bad(path, key, value, "a number of bytes, or -1 for raw data")),
        }
    }
    Ok(Section { path: data, offset, skip: 0, packing })
}

/// Returns the header for `grid` with voxels of `kind` and the data in `data_file` (`LOCAL`: after the header).
pub(crate) fn header(grid: &Grid, kind: VoxelKind, data_file: &str) -> String {
    let d = grid.direction().to_cols_array().map(|x| x.to_string()).join(" ");
    let (o, s, [x, y, z]) = (grid.origin(), grid.spacing(), grid.dims());
    let mut h = String::new();
    // Writing to a string cannot fail.
    let _ = write!(
        h,
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = False\n\
         TransformMatrix = {d}\nOffset = {} {} {}\nCenterOfRotation = 0 0 0\nElementSpacing = {} {} {}\n\
         DimSize = {x} {y} {z}\nElementType = {}\nElementDataFile = {data_file}\n",
        o.x,
        o.y,
        o.z,
        s.x,
        s.y,
        s.z,
        match kind {
            VoxelKind::Scan => "MET_SHORT",
            VoxelKind::Labels => "MET_UCHAR",
        },
    );
    h
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A header of an image that lies a quarter turn about z, with more lines.
    fn turned(lines: &str) -> String {
        format!(
            "ObjectType = Image\nNDims = 3\nDimSize = 4 3 2\nElementSpacing = 2 1 1\nOffset = 10 20 30\n\
             TransformMatrix = 0 1 0 -1 0 0 0 0 1\nElementType = MET_SHORT\n{lines}ElementDataFile = LOCAL\n"
        )
    }

    #[test]
    fn the_matrix_lists_the_directions_of_the_axes() {
        let text = turned("");
        let grid = grid(&tags(Path::new("x"), text.as_bytes()).unwrap(), 3, &mut Vec::new()).unwrap();
        assert_eq!(grid.world(DVec3::X), DVec3::new(10.0, 22.0, 30.0), "the first axis runs along y");
        assert_eq!(grid.world(DVec3::Y), DVec3::new(9.0, 20.0, 30.0), "the second one runs against x");
        assert_eq!(grid.world(DVec3::Z), DVec3::new(10.0, 20.0, 31.0));
    }

    #[test]
    fn a_header_size_says_where_the_voxels_begin() {
        let offset = |lines: &str| {
            let text = turned(lines);
            let tags = tags(Path::new("x"), text.as_bytes())?;
            let section = section(&tags, &grid(&tags, 3, &mut Vec::new())?, &encoding(&tags)?)?;
            Ok::<_, Error>((section.offset, text.len() as u64))
        };
        for lines in ["", "HeaderSize = 0\n"] {
            let (offset, end) = offset(lines).unwrap();
            assert_eq!(offset, end, "right after the header");
        }
        assert_eq!(offset("HeaderSize = 700\n").unwrap().0, 700);
        for lines in ["HeaderSize = -5\n", "HeaderSize = x\n"] {
            assert!(offset(lines).unwrap_err().to_string().contains("HeaderSize"), "{lines}");
        }
    }

    #[test]
    fn a_header_begins_with_one_of_its_own_keys() {
        for head in ["ObjectType = Image\n", "\n  NDims=3\n", "Comment = a scan\nNDims = 3\n"] {
            assert!(recognises(head.as_bytes()), "{head:?}");
        }
        for head in ["", "colour = red\nNDims = 3\n", "ObjectType\nNDims = 3\n", "NDims: 3\n"] {
            assert!(!recognises(head.as_bytes()), "{head:?}");
        }
    }
}
