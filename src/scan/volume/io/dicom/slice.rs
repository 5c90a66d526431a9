//! One slice of a series, as described by its header.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec3;

use super::dataset::{DataSet, Fault, Item, Oddities, PixelPlace, Tag};
use super::lut;
use super::marks::Marks;
use super::origin::Origin;
use super::parse;
use super::units::Units;
use crate::error::{Error, Result};
use crate::volume::io::source;

const SOP_CLASS: Tag = (0x0008, 0x0016);
const MODALITY: Tag = (0x0008, 0x0060);
const THICKNESS: Tag = (0x0018, 0x0050);
const BETWEEN: Tag = (0x0018, 0x0088);
const PATIENT_POSITION: Tag = (0x0018, 0x5100);
const SERIES_UID: Tag = (0x0020, 0x000E);
const SERIES_NUMBER: Tag = (0x0020, 0x0011);
const POSITION: Tag = (0x0020, 0x0032);
const ORIENTATION: Tag = (0x0020, 0x0037);
const SAMPLES: Tag = (0x0028, 0x0002);
const PHOTOMETRIC: Tag = (0x0028, 0x0004);
const FRAMES: Tag = (0x0028, 0x0008);
const ROWS: Tag = (0x0028, 0x0010);
const COLUMNS: Tag = (0x0028, 0x0011);
const PIXEL_SPACING: Tag = (0x0028, 0x0030);
const ALLOCATED: Tag = (0x0028, 0x0100);
const STORED: Tag = (0x0028, 0x0101);
const HIGH_BIT: Tag = (0x0028, 0x0102);
const REPRESENTATION: Tag = (0x0028, 0x0103);
const PADDING: Tag = (0x0028, 0x0120);
const PADDING_LIMIT: Tag = (0x0028, 0x0121);
const INTERCEPT: Tag = (0x0028, 0x1052);
const SLOPE: Tag = (0x0028, 0x1053);
const RESCALE_TYPE: Tag = (0x0028, 0x1054);
/// Groups of overlay planes, and the element that tells which bit of a sample holds one (retired).
const OVERLAYS: std::ops::RangeInclusive<u16> = 0x6000..=0x601E;
const OVERLAY_BIT: u16 = 0x0102;
/// Functional groups of an enhanced multi-frame image (PS3.3, C.7.6.16).
const SHARED: Tag = (0x5200, 0x9229);
const PER_FRAME: Tag = (0x5200, 0x9230);
const PLANE_POSITION: Tag = (0x0020, 0x9113);
const PLANE_ORIENTATION: Tag = (0x0020, 0x9116);
const PIXEL_MEASURES: Tag = (0x0028, 0x9110);
const TRANSFORMATION: Tag = (0x0028, 0x9145);

/// Number of bytes read first when looking for the header, before the whole file is read.
const FIRST_BYTES: u64 = 1 << 16;
/// Maximum number of rows or columns; more than any scanner has.
const LONGEST_SIDE: u16 = 16384;

/// Layout of the stored bits of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Bits {
    /// Bits of a sample in the file: 8 or 16; of floats 32 or 64.
    pub allocated: u16,
    /// Bits that hold the value.
    pub stored: u16,
    /// The highest stored bit.
    pub high: u16,
    /// True if the value is signed.
    pub signed: bool,
}

/// Properties shared by all frames of a file.
#[derive(Clone, Debug)]
pub(crate) struct FileHead {
    /// The file.
    pub path: PathBuf,
    /// UID of the transfer syntax.
    pub syntax: String,
    /// Position of the pixel data.
    pub pixels: PixelPlace,
    /// Number of frames.
    pub frames: u32,
    /// Number of rows.
    pub rows: u16,
    /// Number of columns.
    pub cols: u16,
    /// Bit layout of a sample.
    pub bits: Bits,
    /// The two ends of the range of stored values that mean padding, as words of the header.
    pub padding: Option<[u16; 2]>,
    /// True if bits above the stored ones hold overlays.
    pub has_overlays: bool,
    /// True if a Modality LUT gives the values, in the place of slope and intercept.
    pub has_lut: bool,
    /// True if low values are displayed bright. The meaning of the values is the same.
    pub inverted: bool,
    /// Deviations of the file from the standard.
    pub oddities: Oddities,
}

/// One slice: a file, or one frame of it.
#[derive(Clone, Debug)]
pub(crate) struct Slice {
    /// The file that contains the slice.
    pub file: Arc<FileHead>,
    /// Index of the frame in the file.
    pub frame: u32,
    /// UID of its series.
    pub series: String,
    /// Number of its series.
    pub series_number: Option<i64>,
    /// CT, MR, …
    pub modality: String,
    /// HFS, FFP, …
    pub patient_position: Option<String>,
    /// What its series holds, and its patient.
    pub origin: Arc<Origin>,
    /// Attributes that can distinguish its pass from others of the series.
    pub marks: Arc<Marks>,
    /// World directions of increasing column index and of increasing row index.
    pub axes: Option<[DVec3; 2]>,
    /// World position of the first pixel's centre, mm LPS.
    pub position: Option<DVec3>,
    /// Distance between columns and between rows, mm.
    pub spacing: Option<[f64; 2]>,
    /// Distance to the next slice, or thickness, mm, if the header gives one.
    pub depth: Option<f64>,
    /// HU per stored unit.
    pub slope: f64,
    /// HU of a stored zero.
    pub intercept: f64,
    /// What the values are.
    pub units: Units,
    /// The reason the slice is unusable. It only matters if its series is chosen: many scans come with a colour report.
    pub fault: Option<Error>,
}

/// Reads the slices of a file. A slice with a `fault` stands for an unusable one, and for a file without an image, unless that is
/// the index of a medium (a DICOMDIR). Fails with status 3 if not even the series can be determined.
pub(crate) fn read(path: &Path) -> Result<Vec<Slice>> {
    match parsed(path)? {
        Ok((set, room)) => Ok(slices(path, &set, room)),
        Err((root, fault)) => {
            // Another series can still be opened.
            let known = root.text(SERIES_UID).is_some() && root.text(MODALITY).is_some();
            let set = DataSet { root, ..DataSet::default() };
            if known { Ok(vec![standing_for(path, &set, fault, true)]) } else { Err(fault) }
        }
    }
}

/// Reads the header of a file, up to its pixel data, and the number of bytes that the place of the pixel data is counted in. Fails
/// with status 3 if it cannot be read.
pub(crate) fn header(path: &Path) -> Result<(DataSet, u64)> {
    parsed(path)?.map_err(|(_, fault)| fault)
}

/// Reads the header of a file; of a damaged one, the elements before the damage, and the fault.
fn parsed(path: &Path) -> Result<std::result::Result<(DataSet, u64), (Item, Error)>> {
    let (_, len) = source::open(path)?;
    let bad = |why: String| Error::file(path, why, "export it again");
    let mut bytes = head(path, FIRST_BYTES.min(len))?;
    loop {
        let whole = bytes.len() as u64 >= len;
        match if whole { parse::parse(&bytes) } else { parse::parse_first(&bytes) } {
            Ok((set, body)) => {
                // The file continues beyond the bytes read so far, unless the body was inflated.
                let room = if matches!(body, std::borrow::Cow::Owned(_)) { body.len() as u64 } else { len };
                return Ok(Ok((set, room)));
            }
            Err(_) if !whole => bytes = head(path, (16 * bytes.len() as u64).min(len))?,
            Err(fault) => {
                let fault = bad(match fault {
                    Fault::Short => "ends early, inside its header".to_owned(),
                    Fault::Bad(why) => why,
                });
                return Ok(Err((parse::parse_start(&bytes), fault)));
            }
        }
    }
}

/// Returns a slice that stands for an unusable one.
fn standing_for(path: &Path, set: &DataSet, fault: Error, image: bool) -> Slice {
    let place = PixelPlace { offset: 0, length: None, is_float: false };
    let file = unusable(path, set, set.pixels.unwrap_or(place));
    Slice { fault: Some(fault), ..base(file, &set.root, image) }
}

fn head(path: &Path, bytes: u64) -> Result<Vec<u8>> {
    use std::io::Read;
    let (file, _) = source::open(path)?;
    let mut out = Vec::new();
    file.take(bytes).read_to_end(&mut out).map_err(|e| source::unreadable(path, e))?;
    Ok(out)
}

fn slices(path: &Path, set: &DataSet, room: u64) -> Vec<Slice> {
    let root = &set.root;
    let Some(pixels) = set.pixels else {
        let is_index = root.text(SERIES_UID).is_none() && root.text(MODALITY).is_none();
        let fault = Error::file(path, "contains no image", "choose a series with images");
        return if is_index { Vec::new() } else { vec![standing_for(path, set, fault, false)] };
    };
    let file = match file_head(path, set, pixels, room) {
        Ok(file) => file,
        Err(fault) => return vec![standing_for(path, set, fault, true)],
    };
    let base = base(file, root, true);
    let frames: Result<Vec<Slice>> = (0..base.file.frames).map(|k| base.frame(path, root, k)).collect();
    frames.unwrap_or_else(|fault| vec![Slice { fault: Some(fault), ..base }])
}

/// Returns what the slices of a file share.
fn base(file: FileHead, root: &Item, image: bool) -> Slice {
    let ct = ["1.2.840.10008.5.1.4.1.1.2", "1.2.840.10008.5.1.4.1.1.2.1"];
    let by_class = root.text(SOP_CLASS).filter(|c| ct.contains(&c.as_str())).map(|_| "CT".to_owned());
    Slice {
        frame: 0,
        // Anonymised files may have lost the UID; files without one are treated as one series.
        series: root.text(SERIES_UID).unwrap_or_default(),
        series_number: root.decimal(SERIES_NUMBER).map(|n| n as i64),
        modality: root.text(MODALITY).or(by_class).unwrap_or_else(|| "unknown".to_owned()),
        patient_position: root.text(PATIENT_POSITION),
        origin: Arc::new(Origin::of(root, image)),
        marks: Arc::new(Marks::of(root)),
        axes: None,
        position: None,
        spacing: None,
        depth: None,
        slope: 1.0,
        intercept: 0.0,
        units: lut::units(root).unwrap_or(Units::Missing),
        fault: None,
        file: Arc::new(file),
    }
}

impl Slice {
    /// Returns one frame. Its own attributes override those shared by all frames, which override those of the top-level data set.
    fn frame(&self, path: &Path, root: &Item, frame: u32) -> Result<Self> {
        let mut slice = Self { frame, ..self.clone() };
        slice.fill(path, root)?;
        let own = root.items(PER_FRAME).get(frame as usize);
        if let Some(marks) = self.marks.of_frame(root, frame) {
            slice.marks = Arc::new(marks);
        }
        if self.file.frames > 1 && own.is_none() {
            return Err(Error::file(
                path,
                format!("has {} frames but no position for each", self.file.frames),
                "export it as single slices or as Enhanced CT",
            ));
        }
        for group in root.items(SHARED).first().into_iter().chain(own) {
            for tag in [PLANE_POSITION, PLANE_ORIENTATION, PIXEL_MEASURES, TRANSFORMATION] {
                if let Some(item) = group.items(tag).first() {
                    slice.fill(path, item)?;
                }
            }
        }
        Ok(slice)
    }

    /// Applies an item's attributes of position and values.
    fn fill(&mut self, path: &Path, item: &Item) -> Result<()> {
        let numbers = |tag: Tag, name: &str, n: usize| match item.text(tag) {
            None => Ok(None),
            Some(text) => item
                .decimals(tag)
                .filter(|v| v.len() == n && v.iter().all(|x| x.is_finite()))
                .map(Some)
                .ok_or_else(|| wrong(path, name, &text, &format!("{n} finite numbers"))),
        };
        if let Some(p) = numbers(POSITION, "ImagePositionPatient", 3)? {
            self.position = Some(DVec3::new(p[0], p[1], p[2]));
        }
        if let Some(o) = numbers(ORIENTATION, "ImageOrientationPatient", 6)? {
            let (x, y) = (DVec3::new(o[0], o[1], o[2]), DVec3::new(o[3], o[4], o[5]));
            if (x.length() - 1.0).abs() > 0.01 || (y.length() - 1.0).abs() > 0.01 || x.dot(y).abs() > 0.01 {
                return Err(wrong(
                    path,
                    "ImageOrientationPatient",
                    &format!("{o:?}"),
                    "two unit vectors at right angles",
                ));
            }
            self.axes = Some([x.normalize(), y.normalize()]);
        }
        if let Some(s) = numbers(PIXEL_SPACING, "PixelSpacing", 2)? {
            super::super::frame::check_spacing(path, "PixelSpacing", &s)?;
            // The attribute gives the distance between rows first.
            self.spacing = Some([s[1], s[0]]);
        }
        let depth = item.decimal(BETWEEN).or_else(|| item.decimal(THICKNESS));
        self.depth = depth.filter(|d| d.is_finite() && *d > 0.0).or(self.depth);
        if let Some(s) = numbers(SLOPE, "RescaleSlope", 1)? {
            if s[0] == 0.0 {
                return Err(wrong(path, "RescaleSlope", "0", "a slope"));
            }
            self.slope = s[0];
        }
        if let Some(i) = numbers(INTERCEPT, "RescaleIntercept", 1)? {
            self.intercept = i[0];
        }
        let rescaled = item.text(SLOPE).is_some() || item.text(INTERCEPT).is_some();
        if let Some(term) = item.text(RESCALE_TYPE).filter(|_| !self.file.has_lut) {
            self.units = Units::of("RescaleType", &term);
        } else if rescaled && self.units == Units::Missing {
            self.units = Units::Hu;
        }
        Ok(())
    }
}

fn wrong(path: &Path, name: &str, value: &str, wanted: &str) -> Error {
    let value: String = value.chars().take(60).collect();
    Error::file(path, format!("{name} is {value:?}, not {wanted}"), "export it again")
}

/// Returns the known properties of a file that cannot be used.
fn unusable(path: &Path, set: &DataSet, pixels: PixelPlace) -> FileHead {
    FileHead {
        path: path.to_owned(),
        syntax: set.syntax.clone(),
        pixels,
        frames: 1,
        rows: set.root.short(ROWS).unwrap_or(0),
        cols: set.root.short(COLUMNS).unwrap_or(0),
        bits: Bits { allocated: 16, stored: 16, high: 15, signed: false },
        padding: None,
        has_overlays: false,
        has_lut: false,
        inverted: false,
        oddities: set.oddities,
    }
}

fn file_head(path: &Path, set: &DataSet, pixels: PixelPlace, room: u64) -> Result<FileHead> {
    let root = &set.root;
    let need = |tag: Tag, name: &str| {
        root.short(tag).ok_or_else(|| Error::file(path, format!("has no {name}"), "export it again"))
    };
    let (rows, cols) = (need(ROWS, "Rows")?, need(COLUMNS, "Columns")?);
    if rows == 0 || cols == 0 || rows > LONGEST_SIDE || cols > LONGEST_SIDE {
        return Err(Error::file(path, format!("has {cols} columns and {rows} rows"), "export it again"));
    }
    let samples = root.short(SAMPLES).unwrap_or(1);
    let photometric = root.text(PHOTOMETRIC).unwrap_or_else(|| "MONOCHROME2".to_owned());
    if samples != 1 || !photometric.starts_with("MONOCHROME") {
        return Err(Error::file(
            path,
            format!("contains colours ({photometric}), not HU"),
            "give slices of grey values",
        ));
    }
    let allocated = need(ALLOCATED, "BitsAllocated")?;
    let stored = root.short(STORED).unwrap_or(allocated);
    let high = root.short(HIGH_BIT).unwrap_or(stored.saturating_sub(1));
    let sizes: &[u16] = if pixels.is_float { &[32, 64] } else { &[8, 16] };
    if !sizes.contains(&allocated) || stored == 0 || stored > allocated || high >= allocated || high + 1 < stored {
        return Err(Error::file(
            path,
            format!("has {stored} of {allocated} bits with {high} as the highest"),
            "export it with 8 or 16 bits",
        ));
    }
    let declared: Option<u32> = match root.text(FRAMES) {
        None => None,
        Some(t) => {
            let n = t.parse().ok().filter(|n| (0..=100_000).contains(n));
            Some(n.ok_or_else(|| wrong(path, "NumberOfFrames", &t, "1 to 100000"))?)
        }
    };
    let frames = declared.unwrap_or(1).max(1);
    let signed = root.short(REPRESENTATION).unwrap_or(0) == 1;
    let padding = root.short(PADDING).map(|p| [p, root.short(PADDING_LIMIT).unwrap_or(p)]);
    if let Some(length) = pixels.length {
        let needed = u64::from(rows) * u64::from(cols) * u64::from(allocated / 8) * u64::from(frames);
        let there = room.saturating_sub(pixels.offset as u64).min(length as u64);
        if there < needed {
            return Err(Error::file(
                path,
                format!("its pixel data ends early: {needed} bytes are declared, {there} are there"),
                "copy or export it again",
            ));
        }
    }
    Ok(FileHead {
        path: path.to_owned(),
        syntax: set.syntax.clone(),
        pixels,
        frames,
        rows,
        cols,
        bits: Bits { allocated, stored, high, signed },
        padding,
        has_overlays: OVERLAYS.step_by(2).any(|group| root.short((group, OVERLAY_BIT)).is_some_and(|bit| bit > 0)),
        has_lut: !root.items(lut::SEQUENCE).is_empty(),
        inverted: photometric == "MONOCHROME1",
        oddities: Oddities { no_frames: declared == Some(0), ..set.oddities },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A CT slice of 2 rows and 3 columns.
    fn file(allocated: u16, bytes: u32) -> Vec<u8> {
        let mut f = vec![0; 128];
        f.extend(b"DICM\x02\0\x10\0UI\x14\x001.2.840.10008.1.2.1\0\x08\0\x60\0CS\x02\0CT");
        f.extend(b"\x28\0\x10\0US\x02\0\x02\0\x28\0\x11\0US\x02\0\x03\0\x28\0\x00\x01US\x02\0");
        f.extend(allocated.to_le_bytes());
        f.extend(b"\xe0\x7f\x10\0OW\0\0");
        f.extend(bytes.to_le_bytes());
        f.resize(f.len() + bytes as usize, 0);
        f
    }

    #[test]
    fn pixel_data_is_whole_if_every_voxel_has_its_bytes() {
        for (allocated, needed) in [(8, 6), (16, 12)] {
            let read = |bytes: u32, missing: u64| {
                let file = file(allocated, bytes);
                let (set, _) = parse::parse(&file).unwrap();
                let slices = slices(Path::new("x"), &set, file.len() as u64 - missing);
                assert_eq!((slices.len(), slices[0].file.rows, slices[0].file.cols), (1, 2, 3));
                slices[0].fault.as_ref().map(Error::to_string)
            };
            assert_eq!(read(needed, 0), None, "{allocated} bits");
            assert_eq!(read(needed + 2, 0), None, "{allocated} bits, padded");
            for cut in [read(needed - 2, 0), read(needed, 1)] {
                assert!(cut.is_some_and(|e| e.contains("ends early")), "{allocated} bits");
            }
        }
    }
}
