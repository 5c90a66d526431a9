//! NRRD: `.nrrd` with the data after the header, `.nhdr` with the data in a separate file.
//!
//! Fields and encodings follow Teem's "Definition of NRRD File Format".

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use glam::{DMat3, DVec3};

use super::Scanned;
use super::frame::{self, RAS_LPS};
use super::raw::{ByteOrder, Element, Encoding};
use super::source::{self, Packing, Section};
use super::text::{self, bad, exactly, some};
use super::write::VoxelKind;
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
            map.insert(key.trim().to_ascii_lowercase(), value.trim().to_owned());
        }
    }
    Ok(Fields { path, map, end })
}

/// Reads the scan.
///
/// # Errors
/// Returns status 3 if the header is invalid or the data does not match it, status 4 if cancelled.
pub(crate) fn load(path: &Path, progress: &Progress) -> Result<Scanned> {
    let head = source::head(path, text::MAX_HEADER)?;
    let fields = fields(path, &head)?;
    let mut notes = Vec::new();
    let grid = grid(&fields, &mut notes)?;
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

/// One axis: its size, and its step through the world if the header gives one.
struct Axis {
    size: usize,
    step: Option<DVec3>,
    spacing: Option<f64>,
}

fn grid(f: &Fields, notes: &mut Vec<String>) -> Result<Grid> {
    let path = f.path;
    let value = f.need("dimension")?;
    let [count] = exactly::<usize, 1>(value)
        .filter(|[n]| (1..=16).contains(n))
        .ok_or_else(|| bad(path, "dimension", value, "1 to 16"))?;
    let value = f.need("sizes")?;
    let sizes: Vec<usize> = some(value)
        .filter(|v: &Vec<usize>| v.len() == count)
        .ok_or_else(|| bad(path, "sizes", value, &format!("{count} whole numbers")))?;
    let to_lps = space_to_lps(f, notes)?;
    let steps = match f.get(&["space directions"]) {
        None => vec![None; count],
        Some((key, value)) => {
            let steps = vectors(value).filter(|v| v.len() == count);
            steps.ok_or_else(|| bad(path, key, value, &format!("{count} vectors of three numbers, or none")))?
        }
    };
    let spacings: Vec<f64> = match f.get(&["spacings"]) {
        None => vec![f64::NAN; count],
        Some((key, value)) => some(value)
            .filter(|v: &Vec<f64>| v.len() == count)
            .ok_or_else(|| bad(path, key, value, &format!("{count} numbers")))?,
    };
    let reported = f.map.contains_key("spacings");
    let mut axes = Vec::new();
    for ((size, step), spacing) in sizes.iter().zip(steps).zip(spacings) {
        // NaN means "no spacing" for an axis that is not spatial.
        if reported && !spacing.is_nan() {
            frame::check_spacing(path, "spacings", &[spacing])?;
        }
        axes.push(Axis { size: *size, step, spacing: Some(spacing).filter(|s| !s.is_nan()) });
    }
    if axes.len() > 3 {
        axes.retain(|a| a.size != 1 || a.step.is_some());
    }
    if axes.len() > 3
        || (axes.len() == 3 && f.map.contains_key("space directions") && axes.iter().any(|a| a.step.is_none()))
    {
        return Err(Error::file(
            path,
            format!("has more than one value for each voxel, or several frames (sizes {sizes:?})"),
            "extract one three-dimensional frame first",
        ));
    }
    let dims = std::array::from_fn(|k| axes.get(k).map_or(1, |a| a.size));
    text::voxel_count(path, dims)?;
    if reported && axes.iter().any(|a| a.spacing.is_none() && a.step.is_none()) {
        return Err(Error::file(path, "spacings has NaN, which is not positive and finite", "correct the header"));
    }
    if axes.iter().any(|a| a.step.is_none() && a.spacing.is_none()) {
        notes.push("tells no spacing: 1 mm is taken".to_owned());
    }
    let unit = [DVec3::X, DVec3::Y, DVec3::Z];
    let step = |k: usize| axes.get(k).map_or(unit[k], |a| a.step.unwrap_or(unit[k] * a.spacing.unwrap_or(1.0)));
    let steps = [step(0), step(1), step(2)];
    for s in steps {
        frame::check_spacing(path, "space directions", &[s.length()])?;
    }
    let origin = match f.get(&["space origin"]) {
        None => DVec3::ZERO,
        Some((key, value)) => match vectors(value).as_deref() {
            Some([Some(o)]) => *o,
            _ => return Err(bad(path, key, value, "one vector of three numbers")),
        },
    };
    let mm = units(f)?;
    frame::from_steps(path, dims, to_lps * DMat3::from_cols(steps[0], steps[1], steps[2]) * mm, to_lps * origin * mm)
}

/// Returns the matrix from the file's space to LPS.
fn space_to_lps(f: &Fields, notes: &mut Vec<String>) -> Result<DMat3> {
    let flip = |x: f64, y: f64| DMat3::from_diagonal(DVec3::new(x, y, 1.0));
    let Some((key, value)) = f.get(&["space"]) else {
        match f.get(&["space dimension"]) {
            Some((_, "3")) | None => {}
            Some((key, value)) => return Err(bad(f.path, key, value, "3")),
        }
        notes.push("names no space: left-posterior-superior is taken".to_owned());
        return Ok(DMat3::IDENTITY);
    };
    match value.to_ascii_lowercase().as_str() {
        "left-posterior-superior" | "lps" => Ok(DMat3::IDENTITY),
        "right-anterior-superior" | "ras" => Ok(RAS_LPS),
        "left-anterior-superior" | "las" => Ok(flip(1.0, -1.0)),
        _ => Err(bad(f.path, key, value, "left-posterior-superior, right-anterior-superior or left-anterior-superior")),
    }
}

/// Returns the millimetres per unit of the file's space; all axes must agree.
fn units(f: &Fields) -> Result<f64> {
    let Some((key, value)) = f.get(&["space units"]) else { return Ok(1.0) };
    let mut names = value.split_whitespace().map(|u| u.trim_matches('"'));
    let first = names.next().unwrap_or("mm");
    if names.any(|n| n != first) {
        return Err(bad(f.path, key, value, "the same unit for every axis"));
    }
    match first {
        "mm" | "millimeter" | "millimeters" | "" | "???" => Ok(1.0),
        "cm" => Ok(10.0),
        "m" | "meter" | "meters" => Ok(1000.0),
        "um" | "µm" | "micron" | "microns" => Ok(0.001),
        _ => Err(bad(f.path, key, value, "mm, cm, m or um")),
    }
}

/// Parses vectors as NRRD writes them: `(1,0,0) none (0,0,1)`.
fn vectors(value: &str) -> Option<Vec<Option<DVec3>>> {
    let mut out = Vec::new();
    let mut rest = value.trim();
    while !rest.is_empty() {
        if rest.get(..4).is_some_and(|word| word.eq_ignore_ascii_case("none")) {
            out.push(None);
            rest = rest[4..].trim_start();
            continue;
        }
        let (inside, after) = rest.strip_prefix('(')?.split_once(')')?;
        let numbers: Vec<f64> = inside.split(',').map(|t| t.trim().parse().ok()).collect::<Option<_>>()?;
        let [x, y, z]: [f64; 3] = numbers.try_into().ok()?;
        out.push(Some(DVec3::new(x, y, z)));
        rest = after.trim_start();
    }
    Some(out)
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
            return Err(Error::file(path, "keeps each slice in a file of its own", "convert it to one data file"));
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
pub(crate) fn header(grid: &Grid, kind: VoxelKind, data_file: Option<&str>) -> String {
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
    match data_file {
        Some(name) => {
            let _ = writeln!(h, "data file: {name}");
        }
        None => h.push('\n'),
    }
    h
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the grid of a header with these sizes and space directions.
    fn grid_of(sizes: &str, directions: &str) -> Result<Grid> {
        let count = sizes.split(' ').count();
        let head = format!(
            "NRRD0004\ntype: short\ndimension: {count}\nsizes: {sizes}\nspace: left-posterior-superior\n\
             space directions: {directions}\nendian: little\nencoding: raw\n\n"
        );
        grid(&fields(Path::new("x"), head.as_bytes())?, &mut Vec::new())
    }

    #[test]
    fn frames_and_colours_are_refused() {
        let (x, y, z) = ("(1,0,0)", "(0,2,0)", "(0,0,3)");
        let whole = grid_of("4 3 2", &format!("{x} {y} {z}")).unwrap();
        assert_eq!((whole.dims(), whole.spacing()), ([4, 3, 2], DVec3::new(1.0, 2.0, 3.0)));
        // A list of one frame holds one volume.
        assert_eq!(grid_of("1 4 3 2", &format!("none {x} {y} {z}")).unwrap(), whole);
        for (sizes, directions) in [
            ("4 3 2 5", format!("{x} {y} {z} none")),
            ("3 4 3 2", format!("none {x} {y} {z}")),
            ("3 4 2", format!("none {x} {y}")),
        ] {
            let e = grid_of(sizes, &directions).unwrap_err();
            assert!(e.to_string().contains("several frames"), "{sizes}: {e}");
        }
    }

    #[test]
    fn the_spacing_and_the_origin_are_in_the_unit_of_the_space() {
        for (unit, mm) in [("mm", 1.0), ("cm", 10.0), ("m", 1000.0), ("um", 0.001)] {
            let head = format!(
                "NRRD0004\ntype: short\ndimension: 3\nsizes: 4 3 2\nspace: right-anterior-superior\n\
                 space units: \"{unit}\" \"{unit}\" \"{unit}\"\nspace directions: (1,0,0) (0,2,0) (0,0,3)\n\
                 space origin: (10,-20,30)\nendian: little\nencoding: raw\n\n"
            );
            let read = grid(&fields(Path::new("x"), head.as_bytes()).unwrap(), &mut Vec::new()).unwrap();
            let (spacing, origin) = (DVec3::new(1.0, 2.0, 3.0) * mm, DVec3::new(-10.0, 20.0, 30.0) * mm);
            assert!(read.spacing().abs_diff_eq(spacing, 1e-9 * mm), "{unit}: {}", read.spacing());
            assert!(read.origin().abs_diff_eq(origin, 1e-9 * mm), "{unit}: {}", read.origin());
        }
    }
}
