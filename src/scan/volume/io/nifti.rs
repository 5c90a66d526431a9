//! NIfTI-1 and NIfTI-2: single files, gzipped files and header/image pairs.
//!
//! Field offsets and the three orientation methods follow the standard's `nifti1.h` and `nifti2.h`.

use std::path::Path;

use glam::{DMat3, DQuat, DVec3};

use super::Scanned;
use super::frame::{self, RAS_LPS};
use super::raw::{ByteOrder, Element, Encoding};
use super::source::{self, Packing, Section};
use super::text;
use super::voxels::VoxelKind;
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::{Grid, Volume};

/// Number of bytes needed to recognise a header of either version.
pub(crate) const HEAD: usize = 540;

/// The header's contents, independent of the version.
struct Header {
    grid: Grid,
    encoding: Encoding,
    offset: u64,
    pair: bool,
    notes: Vec<String>,
}

/// True if the bytes are the start of a NIfTI file, or look like its predecessor, so that the error can name it.
pub(crate) fn recognises(head: &[u8]) -> bool {
    version(head).is_some()
}

/// Returns the version (1 or 2) and byte order.
fn version(head: &[u8]) -> Option<(u8, ByteOrder)> {
    let size: [u8; 4] = head.get(..4)?.try_into().ok()?;
    match (i32::from_le_bytes(size), i32::from_be_bytes(size)) {
        (348, _) => Some((1, ByteOrder::Little)),
        (_, 348) => Some((1, ByteOrder::Big)),
        (540, _) => Some((2, ByteOrder::Little)),
        (_, 540) => Some((2, ByteOrder::Big)),
        _ => None,
    }
}

/// Reads the scan. Fails with status 3 if the header is invalid or the data does not match it, status 4 if cancelled.
pub(crate) fn load(path: &Path, progress: &Progress) -> Result<Scanned> {
    let head = source::head(path, HEAD as u64)?;
    let header = parse(path, &head)?;
    let data_path = if header.pair { image_of(path)? } else { path.to_owned() };
    let packing = if source::is_gzip(&data_path)? { Packing::Gzip } else { Packing::Raw };
    let section = match packing {
        Packing::Gzip => Section { path: data_path, offset: 0, skip: header.offset, packing },
        _ => Section { path: data_path, offset: header.offset, skip: 0, packing },
    };
    let (data, counts) = section.read(header.grid.len(), &header.encoding, progress)?;
    let mut notes = header.notes;
    notes.extend(super::strange_note(counts.strange));
    Ok(Scanned { volume: Volume::new(header.grid, data), notes, fractions: counts.fractions })
}

/// Returns the image file of a header/image pair.
fn image_of(path: &Path) -> Result<std::path::PathBuf> {
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let lower = name.to_ascii_lowercase();
    let stem = ["hdr.gz", "hdr", "nii.gz", "nii"].iter().find(|e| lower.ends_with(*e)).map(|e| name.len() - e.len());
    let Some(stem) = stem.and_then(|n| name.get(..n)) else {
        return Err(Error::file(
            path,
            "is the header of a two-file pair but its name does not end in .hdr",
            "rename it to .hdr",
        ));
    };
    let plain = text::data_file(path, &format!("{stem}img"));
    plain.or_else(|missing| text::data_file(path, &format!("{stem}img.gz")).map_err(|_| missing))
}

/// The header's bytes, read in its byte order. Offsets are constants within the checked length.
struct Fields<'a> {
    bytes: &'a [u8],
    order: ByteOrder,
}

impl Fields<'_> {
    fn at<const N: usize>(&self, offset: usize) -> [u8; N] {
        let mut b = [0; N];
        b.copy_from_slice(&self.bytes[offset..offset + N]);
        if self.order == ByteOrder::Big {
            b.reverse();
        }
        b
    }

    fn i16(&self, o: usize) -> i16 {
        i16::from_le_bytes(self.at(o))
    }

    fn i32(&self, o: usize) -> i32 {
        i32::from_le_bytes(self.at(o))
    }

    fn i64(&self, o: usize) -> i64 {
        i64::from_le_bytes(self.at(o))
    }

    fn f32(&self, o: usize) -> f64 {
        f64::from(f32::from_le_bytes(self.at(o)))
    }

    fn f64(&self, o: usize) -> f64 {
        f64::from_le_bytes(self.at(o))
    }
}

/// The relevant fields of either version.
struct Common {
    dim: [i64; 8],
    datatype: i16,
    bitpix: i16,
    pixdim: [f64; 8],
    vox_offset: f64,
    slope: f64,
    intercept: f64,
    units: i32,
    qform_code: i32,
    sform_code: i32,
    quatern: [f64; 3],
    qoffset: DVec3,
    srow: [[f64; 4]; 3],
    pair: bool,
    version: u8,
    order: ByteOrder,
}

fn common(path: &Path, head: &[u8]) -> Result<Common> {
    let wrong = |why: String| Error::file(path, why, "give a NIfTI-1 or NIfTI-2 file");
    let (version, order) =
        version(head).ok_or_else(|| wrong("is not NIfTI (it begins with neither 348 nor 540)".to_owned()))?;
    let length = if version == 1 { 348 } else { 540 };
    if head.len() < length {
        return Err(wrong(format!("ends early: {} bytes of a header of {length}", head.len())));
    }
    let f = Fields { bytes: head, order };
    let magic = if version == 1 { &head[344..348] } else { &head[4..12] };
    let pair = match magic {
        b"n+1\0" | b"n+2\0\r\n\x1a\n" => false,
        b"ni1\0" | b"ni2\0\r\n\x1a\n" => true,
        b"\0\0\0\0" if version == 1 => {
            return Err(Error::file(
                path,
                "is Analyze 7.5 (no NIfTI magic), whose orientation is not defined",
                "convert it to NIfTI",
            ));
        }
        _ => return Err(wrong(format!("has the wrong magic {:?}", String::from_utf8_lossy(magic)))),
    };
    let three = |o: usize, step: usize, get: &dyn Fn(usize) -> f64| [get(o), get(o + step), get(o + 2 * step)];
    Ok(if version == 1 {
        let row = |o: usize| std::array::from_fn(|k| f.f32(o + 4 * k));
        Common {
            dim: std::array::from_fn(|k| i64::from(f.i16(40 + 2 * k))),
            datatype: f.i16(70),
            bitpix: f.i16(72),
            pixdim: std::array::from_fn(|k| f.f32(76 + 4 * k)),
            vox_offset: f.f32(108),
            slope: f.f32(112),
            intercept: f.f32(116),
            units: i32::from(head[123]),
            qform_code: i32::from(f.i16(252)),
            sform_code: i32::from(f.i16(254)),
            quatern: three(256, 4, &|o| f.f32(o)),
            qoffset: DVec3::from_array(three(268, 4, &|o| f.f32(o))),
            srow: [row(280), row(296), row(312)],
            pair,
            version,
            order,
        }
    } else {
        let row = |o: usize| std::array::from_fn(|k| f.f64(o + 8 * k));
        Common {
            dim: std::array::from_fn(|k| f.i64(16 + 8 * k)),
            datatype: f.i16(12),
            bitpix: f.i16(14),
            pixdim: std::array::from_fn(|k| f.f64(104 + 8 * k)),
            vox_offset: f.i64(168) as f64,
            slope: f.f64(176),
            intercept: f.f64(184),
            units: f.i32(500),
            qform_code: f.i32(344),
            sform_code: f.i32(348),
            quatern: three(352, 8, &|o| f.f64(o)),
            qoffset: DVec3::from_array(three(376, 8, &|o| f.f64(o))),
            srow: [row(400), row(432), row(464)],
            pair,
            version,
            order,
        }
    })
}

fn parse(path: &Path, head: &[u8]) -> Result<Header> {
    let c = common(path, head)?;
    let mut notes = Vec::new();
    let dims = dims(path, &c)?;
    text::voxel_count(path, dims)?;
    let element = element(path, &c)?;
    let grid = grid(path, &c, dims, &mut notes)?;
    // In a single file the header and its extension flag come first. Every reader takes zero as "right after them".
    let least = match (c.pair, c.version) {
        (true, _) => 0.0,
        (false, 1) => 352.0,
        (false, _) => 544.0,
    };
    let offset = if c.vox_offset == 0.0 { least } else { c.vox_offset };
    if !offset.is_finite() || offset.fract() != 0.0 || offset < least || offset > 9e15 {
        return Err(Error::file(path, format!("vox_offset {} is impossible", c.vox_offset), "correct the header"));
    }
    let (slope, intercept) = scale(path, &c)?;
    Ok(Header {
        grid,
        encoding: Encoding { element, order: c.order, slope, intercept },
        offset: offset as u64,
        pair: c.pair,
        notes,
    })
}

fn dims(path: &Path, c: &Common) -> Result<[usize; 3]> {
    let impossible = |why: String| Error::file(path, why, "correct the header");
    let axes = c.dim[0];
    if !(1..=7).contains(&axes) {
        return Err(impossible(format!("dim[0] is {axes}, not 1 to 7")));
    }
    let sizes = &c.dim[1..=axes as usize];
    if let Some(n) = sizes.iter().find(|n| **n < 1) {
        return Err(impossible(format!("has a dimension of {n} (dims {sizes:?})")));
    }
    if sizes.iter().skip(3).any(|n| *n != 1) {
        return Err(Error::file(
            path,
            format!("has more than one frame (dims {sizes:?})"),
            "extract one three-dimensional frame first",
        ));
    }
    let size = |k: usize| sizes.get(k).map_or(Ok(1), |n| usize::try_from(*n));
    match (size(0), size(1), size(2)) {
        (Ok(x), Ok(y), Ok(z)) => Ok([x, y, z]),
        _ => Err(impossible(format!("dims {sizes:?} overflow"))),
    }
}

fn element(path: &Path, c: &Common) -> Result<Element> {
    let element = match c.datatype {
        2 => Element::U8,
        4 => Element::I16,
        8 => Element::I32,
        16 => Element::F32,
        64 => Element::F64,
        256 => Element::I8,
        512 => Element::U16,
        768 => Element::U32,
        1024 => Element::I64,
        1280 => Element::U64,
        other => {
            let name = match other {
                1 => "one bit a voxel",
                32 | 1792 | 2048 => "complex numbers",
                128 | 2304 => "RGB colours",
                1536 => "128-bit floats",
                _ => "unknown",
            };
            return Err(Error::file(
                path,
                format!("has datatype {other} ({name})"),
                "convert it to an integer or float type",
            ));
        }
    };
    let bits = 8 * element.size() as i16;
    if c.bitpix != bits && c.bitpix != 0 {
        return Err(Error::file(
            path,
            format!("has bitpix {}, but its datatype {} has {bits}", c.bitpix, c.datatype),
            "correct the header",
        ));
    }
    Ok(element)
}

/// Returns `scl_slope` and `scl_inter`. A slope of zero, or a missing one, means "no scaling".
fn scale(path: &Path, c: &Common) -> Result<(f64, f64)> {
    if c.slope == 0.0 || !c.slope.is_finite() {
        return Ok((1.0, 0.0));
    }
    if !c.intercept.is_finite() {
        return Err(Error::file(path, format!("scl_inter is {}", c.intercept), "correct the header"));
    }
    Ok((c.slope, c.intercept))
}

/// Returns the grid by the method that the header selects: sform, else qform, else spacing alone.
fn grid(path: &Path, c: &Common, dims: [usize; 3], notes: &mut Vec<String>) -> Result<Grid> {
    let mut pixdim = [c.pixdim[1], c.pixdim[2], c.pixdim[3]];
    let axes = (c.dim[0] as usize).min(3);
    frame::check_spacing(path, "pixdim", &pixdim[..axes])?;
    for (k, p) in pixdim.iter_mut().enumerate().skip(axes) {
        if !(p.is_finite() && *p > 0.0) {
            *p = 1.0;
            notes.push(format!("has {axes} dimensions: 1 mm is assumed along axis {}", k + 1));
        }
    }
    let mm = match c.units & 7 {
        0 | 2 => 1.0,
        1 => 1000.0,
        3 => 0.001,
        other => {
            return Err(Error::file(path, format!("xyzt_units {other} is not a unit of length"), "correct the header"));
        }
    };
    let spacing = DVec3::from_array(pixdim) * mm;
    let rotation = if c.qform_code > 0 { Some(rotation(path, c)?) } else { None };
    if c.sform_code > 0 {
        let column = |k: usize| DVec3::new(c.srow[0][k], c.srow[1][k], c.srow[2][k]) * mm;
        let steps = RAS_LPS * DMat3::from_cols(column(0), column(1), column(2));
        let grid = frame::from_steps(path, dims, steps, RAS_LPS * column(3))?;
        if ((grid.spacing() - spacing) / spacing).abs().max_element() > 0.01 {
            notes.push(format!("pixdim {spacing} mm differs from the sform's {} mm, which is used", grid.spacing()));
        }
        return Ok(grid);
    }
    if let Some(rotation) = rotation {
        return frame::grid(path, dims, spacing, RAS_LPS * (c.qoffset * mm), RAS_LPS * rotation);
    }
    notes.push("has no orientation: x is assumed to point left, y to posterior, z to superior".to_owned());
    frame::grid(path, dims, spacing, DVec3::ZERO, DMat3::IDENTITY)
}

/// Returns the qform's direction: a quaternion without its real part, and qfac.
fn rotation(path: &Path, c: &Common) -> Result<DMat3> {
    let v = DVec3::from_array(c.quatern);
    let square = v.length_squared();
    // Single precision can exceed one slightly.
    if !square.is_finite() || square > 1.001 {
        return Err(Error::file(path, format!("quaternion {:?} is not a rotation", c.quatern), "correct the header"));
    }
    let q = DQuat::from_xyzw(v.x, v.y, v.z, (1.0 - square).max(0.0).sqrt()).normalize();
    let mut direction = DMat3::from_quat(q);
    // pixdim[0] is qfac: −1 flips the third axis.
    if c.pixdim[0] < 0.0 {
        direction.z_axis = -direction.z_axis;
    }
    Ok(direction)
}

/// Returns the 352 bytes of a little-endian NIfTI-1 header for `grid` with voxels of `kind`. Fails with a short description if
/// NIfTI-1 cannot represent the grid.
pub(crate) fn header(grid: &Grid, kind: VoxelKind) -> std::result::Result<Vec<u8>, String> {
    let mut h = vec![0u8; 352];
    let mut put = |offset: usize, bytes: &[u8]| h[offset..offset + bytes.len()].copy_from_slice(bytes);
    put(0, &348i32.to_le_bytes());
    put(38, b"r");
    let mut dim = [3i16, 1, 1, 1, 1, 1, 1, 1];
    for (d, n) in dim[1..].iter_mut().zip(grid.dims()) {
        *d = i16::try_from(n).map_err(|_| format!("a dimension of {n} is more than NIfTI-1 can hold (32767)"))?;
    }
    for (k, d) in dim.iter().enumerate() {
        put(40 + 2 * k, &d.to_le_bytes());
    }
    let (datatype, bits) = match kind {
        VoxelKind::Scan => (4i16, 16i16),
        VoxelKind::Labels => (2, 8),
    };
    put(70, &datatype.to_le_bytes());
    put(72, &bits.to_le_bytes());
    let direction = RAS_LPS * grid.direction();
    let spacing = grid.spacing();
    let origin = RAS_LPS * grid.origin();
    let qfac = if direction.determinant() < 0.0 { -1.0f32 } else { 1.0 };
    let pixdim = [qfac, spacing.x as f32, spacing.y as f32, spacing.z as f32, 0.0, 0.0, 0.0, 0.0];
    for (k, p) in pixdim.iter().enumerate() {
        put(76 + 4 * k, &p.to_le_bytes());
    }
    put(108, &352f32.to_le_bytes());
    put(112, &1f32.to_le_bytes());
    put(123, &[2]); // millimetres
    // "scanner" for both. A quaternion cannot hold shear, so an oblique grid only has the sform.
    let code = 1i16.to_le_bytes();
    if frame::is_orthonormal(&direction) {
        let mut proper = direction;
        proper.z_axis *= f64::from(qfac);
        let q = DQuat::from_mat3(&proper).normalize();
        let q = if q.w < 0.0 { -q } else { q };
        put(252, &code);
        for (k, v) in [q.x, q.y, q.z, origin.x, origin.y, origin.z].iter().enumerate() {
            put(256 + 4 * k, &(*v as f32).to_le_bytes());
        }
    }
    put(254, &code);
    let steps = direction * DMat3::from_diagonal(spacing);
    for row in 0..3 {
        let values = [steps.x_axis[row], steps.y_axis[row], steps.z_axis[row], origin[row]];
        for (k, v) in values.iter().enumerate() {
            put(280 + 16 * row + 4 * k, &(*v as f32).to_le_bytes());
        }
    }
    put(344, b"n+1\0");
    Ok(h)
}

#[cfg(test)]
#[path = "nifti_tests.rs"]
mod tests;
