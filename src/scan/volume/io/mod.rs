//! Reading and writing scans.
//!
//! Each format has its own file. Shared code is in `raw` (bytes to HU), `source` (voxels from a section of a file,
//! using no more memory than the file's size class), `frame` (headers to grids) and `text` (text headers).

pub mod companions;
mod deflate;
#[cfg(feature = "dicom")]
mod dicom;
mod folder;
mod frame;
pub mod identity;
mod metaimage;
mod nifti;
mod normalise;
mod nrrd;
mod padding;
mod passed;
mod png;
mod raw;
mod recognise;
mod source;
pub mod study;
mod text;
mod voxels;
mod write;

use std::path::{Path, PathBuf};

use glam::DVec3;
use rayon::prelude::*;
use serde_json::{Map, Value, json};

use crate::error::{Error, Result};
use crate::output::AtomicFile;
use crate::progress::Progress;
use crate::volume::{Grid, PatientPosition, Volume, content_hash, hounsfield};

/// Options for reading an input.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LoadOptions {
    /// Voxel spacing for inputs that carry none (a folder of PNG slices), mm.
    pub spacing: Option<DVec3>,
    /// HU of black and of white for inputs without HU.
    pub hu: Option<(f64, f64)>,
    /// DICOM series to read, counted from 1 as in the printed list.
    pub series: Option<usize>,
    /// Resamples across missing slices instead of rejecting them.
    pub allow_gaps: bool,
}

/// A scan and the notes from reading it.
#[derive(Debug)]
pub struct Loaded {
    /// The scan.
    pub volume: Volume,
    /// Warnings for the user, one line each.
    pub notes: Vec<String>,
}

/// Supported inputs, for messages.
const SUPPORTED: &str = "give NIfTI (.nii, .nii.gz), MetaImage (.mha, .mhd), NRRD (.nrrd, .nhdr), DICOM (a file or a \
                         folder) or a folder of PNG slices";

/// The modality that a scan must have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::volume::io) enum Modality {
    /// CT, whose values are HU.
    Ct,
    /// Any modality; the values do not matter.
    Any,
}

/// The format of an input, recognised by its content.
enum Format {
    Nifti,
    MetaImage,
    Nrrd,
    #[cfg_attr(not(feature = "dicom"), expect(dead_code, reason = "without the feature dicom, DICOM is refused"))]
    Dicom(Vec<PathBuf>),
    Png(Vec<PathBuf>),
}

/// Reads any supported input.
///
/// ```
/// # use colvis_scan as colvis;
/// use colvis::progress::Progress;
/// use colvis::volume::io::{self, LoadOptions};
/// use colvis::volume::{Grid, Volume};
/// use glam::{DMat3, DVec3};
///
/// let folder = tempfile::tempdir().expect("a folder");
/// let (path, progress) = (folder.path().join("scan.nii.gz"), Progress::new());
/// let grid = Grid::new([3, 2, 2], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).expect("a grid");
/// io::save(&path, &Volume::new(grid, (0..12).collect()), &progress)?;
/// let loaded = io::load(&path, &LoadOptions::default(), &progress)?;
/// assert_eq!((loaded.volume.grid().dims(), loaded.volume.get(2, 1, 1)), ([3, 2, 2], 11));
/// # Ok::<(), colvis::error::Error>(())
/// ```
///
/// # Errors
/// Returns status 3 with the reason if the input is unusable, status 4 if cancelled.
pub fn load(path: &Path, options: &LoadOptions, progress: &Progress) -> Result<Loaded> {
    read(path, options, Modality::Ct, progress).map(|(loaded, _)| loaded)
}

/// Returns whose scan an input is; `None` if it is not DICOM, and so does not tell.
///
/// # Errors
/// Returns status 3 if no series can be chosen or a header cannot be read, status 4 if cancelled.
pub fn identity(path: &Path, options: &LoadOptions, progress: &Progress) -> Result<Option<identity::Identity>> {
    match detect(path, progress)?.0 {
        #[cfg(feature = "dicom")]
        Format::Dicom(files) => dicom::identity(path, &files, options, progress).map(Some),
        _ => {
            let _ = options;
            Ok(None)
        }
    }
}

/// Reads the mask of a lumen: 0 outside, any positive whole number inside.
///
/// # Errors
/// As [`load`]; also status 3 if it has no voxel of 0, negative values or fractions, as a scan or a distance field does.
pub fn load_mask(path: &Path, options: &LoadOptions, progress: &Progress) -> Result<Loaded> {
    let (format, passed) = detect(path, progress)?;
    // Black stays 0, and every other level is at least 1.
    let grey = LoadOptions { hu: options.hu.or(Some((0.0, 65535.0))), ..options.clone() };
    let options = if matches!(format, Format::Png(_)) { &grey } else { options };
    let read = scan(path, &format, options, Modality::Any, progress).map_err(|e| with_passed(e, &passed))?;
    let values = read.scanned.volume.data();
    let count = |of: fn(&i16) -> bool| values.par_iter().filter(|v| of(v)).count();
    let refuse = |why: String| Err(Error::file(path, why, "give a mask of the lumen: 0 outside, 1 inside"));
    let (negative, outside) = (count(|v| *v < 0), count(|v| *v == 0));
    if negative > 0 {
        return refuse(format!("is not a mask: {negative} of its voxels are negative"));
    }
    if read.scanned.fractions > 0 {
        return refuse(format!("is not a mask: {} of its voxels are not whole numbers", read.scanned.fractions));
    }
    if outside == 0 {
        return refuse("is not a mask: it has no voxel of 0, so nothing lies outside the lumen".to_owned());
    }
    let mut notes = [passed, read.scanned.notes].concat();
    notes.extend(unused(&format, read.scanned.volume.grid(), options, false));
    Ok(Loaded { volume: read.scanned.volume, notes })
}

/// What a format's reader returns.
struct Scanned {
    volume: Volume,
    /// Warnings.
    notes: Vec<String>,
    /// Number of voxels that are not whole numbers.
    fractions: usize,
}

/// What is read from an input of any format.
struct Read {
    scanned: Scanned,
    facts: Map<String, Value>,
    units: Units,
}

/// What the values of an input are.
#[cfg_attr(not(feature = "dicom"), expect(dead_code, reason = "only DICOM has values other than HU"))]
enum Units {
    /// HU, as far as the input tells.
    Hu,
    /// Nothing in the header says that they are HU: the reason.
    Doubtful(String),
    /// Not HU; the reason, if it is worth a note.
    Other(Option<String>),
}

fn scan(path: &Path, format: &Format, options: &LoadOptions, modality: Modality, progress: &Progress) -> Result<Read> {
    let plain = |scanned: Scanned| Read { scanned, facts: Map::new(), units: Units::Hu };
    match format {
        Format::Nifti => nifti::load(path, progress).map(plain),
        Format::MetaImage => metaimage::load(path, progress).map(plain),
        Format::Nrrd => nrrd::load(path, progress).map(plain),
        Format::Png(files) => png::load(path, files, options, progress).map(plain),
        #[cfg(feature = "dicom")]
        Format::Dicom(files) => {
            let read = dicom::load(path, files, options, modality, progress)?;
            let units = match read.units {
                _ if read.facts.get("modality").is_some_and(|m| m != "CT") => Units::Other(None),
                dicom::Units::Other(what) => Units::Other(Some(format!("holds {what}"))),
                units => units.doubt().map_or(Units::Hu, |why| Units::Doubtful(why.to_owned())),
            };
            let scanned = Scanned { volume: read.volume, notes: read.notes, fractions: 0 };
            Ok(Read { scanned, facts: read.facts, units })
        }
        #[cfg(not(feature = "dicom"))]
        Format::Dicom(_) => {
            let _ = modality;
            Err(Error::file(path, "is DICOM, which this build does not support", "build it with the feature \"dicom\""))
        }
    }
}

/// Reads an input and the facts specific to its format.
fn read(
    path: &Path,
    options: &LoadOptions,
    modality: Modality,
    progress: &Progress,
) -> Result<(Loaded, Map<String, Value>)> {
    let (format, passed) = detect(path, progress)?;
    let Read { scanned: Scanned { volume, notes: read_notes, .. }, facts, units } =
        scan(path, &format, options, modality, progress).map_err(|e| with_passed(e, &passed))?;
    let mut notes = [passed, read_notes].concat();
    notes.extend(unused(&format, volume.grid(), options, modality == Modality::Any));
    // If values are not HU, they indicate neither padding nor air.
    let volume = if let Units::Other(why) = units {
        notes.extend(why);
        volume
    } else {
        let volume = padding::to_air(volume, &mut notes);
        let odd = hounsfield::oddity(&volume);
        match (units, odd) {
            (Units::Doubtful(why), Some(odd)) if odd.is_clear() => {
                let why = format!("{why}, and {odd}");
                if modality == Modality::Ct {
                    return Err(Error::file(path, why, "export it in HU"));
                }
                notes.push(why);
            }
            (Units::Doubtful(why), odd) => {
                notes.push(format!("{why}: its values are treated as HU"));
                notes.extend(odd.map(|odd| odd.to_string()));
            }
            (_, odd) => notes.extend(odd.map(|odd| odd.to_string())),
        }
        notes.extend(thick_slices(volume.grid()));
        volume
    };
    let position = facts.get("patient_position").and_then(Value::as_str).and_then(PatientPosition::of_header);
    Ok((Loaded { volume: volume.with_header_position(position), notes }, facts))
}

/// Returns notes on options that do not apply to a format; with `any_gaps`, gaps are allowed by the command itself.
fn unused(format: &Format, grid: &Grid, options: &LoadOptions, any_gaps: bool) -> Vec<String> {
    let (is_png, is_dicom) = (matches!(format, Format::Png(_)), matches!(format, Format::Dicom(_)));
    let own = grid.spacing();
    let mut notes = Vec::new();
    if options.spacing.is_some_and(|s| !is_png && s != own) {
        notes.push(format!("--spacing is ignored: the scan has its own, {own} mm"));
    }
    if options.hu.is_some() && !is_png {
        notes.push("--hu is ignored: the scan holds HU".to_owned());
    }
    if options.series.is_some() && !is_dicom {
        notes.push("--series is ignored: the scan is not DICOM".to_owned());
    }
    if options.allow_gaps && !is_dicom && !any_gaps {
        notes.push("--allow-gaps is ignored: the scan is not DICOM".to_owned());
    }
    notes
}

/// Adds what was skipped in a folder to an error, which may come from it: a slice between others is missing then.
fn with_passed(e: Error, passed: &[String]) -> Error {
    if passed.is_empty() || e.kind != crate::error::Kind::Input || !e.choices.is_empty() {
        return e;
    }
    Error { why: format!("{} ({})", e.why, passed.join(", ")), ..e }
}

/// Returns a note on what the slices of a scan cannot show; `None` if they are thin. A lesion that is to be judged spans two slices.
pub fn thick_slices(grid: &Grid) -> Option<String> {
    /// Polyps from 6 mm are reported, mm.
    const THIN_MM: f64 = 3.0;
    let mm = (grid.spacing().max_element() * 10.0).round() / 10.0;
    (mm > THIN_MM && grid.dims().iter().all(|&n| n > 1))
        .then(|| format!("{mm} mm slices: polyps under {} mm cannot be assessed", (2.0 * mm * 10.0).round() / 10.0))
}

/// Returns the format of an input, and notes on what is skipped in a folder.
fn detect(path: &Path, progress: &Progress) -> Result<(Format, Vec<String>)> {
    let meta = std::fs::metadata(path).map_err(|e| source::unreadable(path, e))?;
    if meta.is_dir() {
        let (folder, notes) = folder::open(path, progress)?;
        let format = match folder {
            folder::Folder::Dicom(files) => Format::Dicom(files),
            folder::Folder::Png(files) => Format::Png(files),
        };
        return Ok((format, notes));
    }
    file_format(path).map(|format| (format, Vec::new()))
}

fn file_format(path: &Path) -> Result<Format> {
    let head = source::head(path, 4096)?;
    if head.is_empty() {
        Err(Error::file(path, "is empty", SUPPORTED))
    } else if source::is_gzip(path)? {
        // NIfTI is the only format that is compressed as a whole.
        if nifti::recognises(&head) {
            Ok(Format::Nifti)
        } else {
            Err(Error::file(path, "is gzip, but does not contain NIfTI", "unpack it first"))
        }
    } else if nrrd::recognises(&head) {
        Ok(Format::Nrrd)
    } else if recognise::is_dicom(&head) {
        Ok(Format::Dicom(vec![path.to_owned()]))
    } else if nifti::recognises(&head) {
        Ok(Format::Nifti)
    } else if metaimage::recognises(&head) {
        Ok(Format::MetaImage)
    } else if recognise::is_png(&head) {
        Err(Error::file(path, "is a single PNG", "give the folder of all its slices"))
    } else if recognise::is_bare_dicom(&head) {
        Ok(Format::Dicom(vec![path.to_owned()]))
    } else {
        Err(Error::file(path, "is not in a supported format", SUPPORTED))
    }
}

/// Returns the facts about an input, as printed by the `info` command.
///
/// # Errors
/// Same as [`load`].
pub fn info(path: &Path, options: &LoadOptions, progress: &Progress) -> Result<Value> {
    inspect(path, options, progress).map(|(value, _)| value)
}

/// Same as [`info`], plus the notes from reading the input.
///
/// # Errors
/// Same as [`load`].
pub fn inspect(path: &Path, options: &LoadOptions, progress: &Progress) -> Result<(Value, Vec<String>)> {
    let (loaded, facts) = read(path, options, Modality::Any, progress)?;
    let mut map = describe(&loaded.volume);
    map.extend(facts);
    Ok((Value::Object(map), loaded.notes))
}

/// Returns the series of a folder of DICOM, of a medium by its index (DICOMDIR), or of a file with several, with pictures of at
/// most `side` pixels a side; no series for any other input. It decodes one slice of each series.
///
/// # Errors
/// Returns status 3 if the input cannot be read, status 4 if cancelled.
pub fn study(path: &Path, side: usize, progress: &Progress) -> Result<study::Study> {
    match detect(path, progress)?.0 {
        #[cfg(feature = "dicom")]
        Format::Dicom(files) => {
            let study = dicom::study(path, &files, side, progress)?;
            // A file of one scan leaves nothing to choose.
            Ok(if path.is_dir() || study.series.len() > 1 { study } else { study::Study::default() })
        }
        _ => {
            let _ = side;
            Ok(study::Study::default())
        }
    }
}

/// Returns the part of `info` that every format has.
fn describe(volume: &Volume) -> Map<String, Value> {
    let grid = volume.grid();
    let (low, high) = volume
        .data()
        .par_chunks(1 << 18)
        .map(|c| c.iter().fold((i16::MAX, i16::MIN), |(lo, hi), v| (lo.min(*v), hi.max(*v))))
        .reduce(|| (i16::MAX, i16::MIN), |a, b| (a.0.min(b.0), a.1.max(b.1)));
    let mut map = Map::new();
    let mut put = |key: &str, value: Value| map.insert(key.to_owned(), value);
    put("dims", json!(grid.dims()));
    put("spacing_mm", json!(grid.spacing().to_array()));
    put("origin_mm", json!(grid.origin().to_array()));
    put("direction", json!(grid.direction().transpose().to_cols_array()));
    put("hu_range", json!([low, high]));
    put("bytes", json!(volume.bytes()));
    put("content", json!(content_hash(volume)));
    map
}

/// Returns a note about voxels that were not finite.
fn strange_note(count: usize) -> Option<String> {
    (count > 0).then(|| format!("{count} voxels are not finite and became air"))
}

/// Writes a scan. The file extension selects the format (.nii, .nii.gz, .mhd, .mha, .nrrd, .nhdr).
///
/// # Errors
/// Returns status 2 for an unknown extension, status 4 if cancelled, status 5 if the file cannot be written.
pub fn save(path: &Path, volume: &Volume, progress: &Progress) -> Result<()> {
    write::write(path, volume.grid(), voxels::Voxels::Scan(volume.data()), progress)
}

/// Checks that a file's ending names a format that can be written, before any work is done.
///
/// # Errors
/// Returns status 2 if it does not.
pub fn check_ending(path: &Path) -> Result<()> {
    write::format(path).map(drop)
}

/// Returns a note if other programs cannot read what is written to `path` on `grid`; `None` if they can.
pub fn written_note(path: &Path, grid: &Grid) -> Option<String> {
    let is_nifti = matches!(write::format(path), Ok(write::Format::Nifti { .. }));
    (is_nifti && !frame::is_orthonormal(&grid.direction())).then(|| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        format!(
            "{name}: the slices are sheared (a tilted gantry), which ITK, 3D Slicer and ITK-SNAP do not read from NIfTI; \
             write .nrrd or .mha for them"
        )
    })
}

/// True if a file begins as DICOM does.
pub fn is_dicom(path: &Path) -> bool {
    use std::io::Read;
    let mut head = Vec::new();
    let read = std::fs::File::open(path).and_then(|f| f.take(recognise::HEAD).read_to_end(&mut head));
    read.is_ok() && (recognise::is_dicom(&head) || recognise::is_bare_dicom(&head))
}

/// A segment of a segmentation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SegmentLabel {
    /// The value of its voxels.
    pub value: u8,
    /// Its name.
    pub name: String,
    /// Its colour, sRGB.
    pub colour: [u8; 3],
}

/// Writes labels (one byte per voxel, x fastest) on `grid` as a segmentation that 3D Slicer opens (`.seg.nrrd`), with the names and
/// colours of its segments.
///
/// # Errors
/// Returns status 4 if cancelled, 5 if the file cannot be written; status 1 if the labels do not match the grid's size.
pub fn save_segments(
    path: &Path,
    grid: &Grid,
    labels: &[u8],
    segments: &[SegmentLabel],
    progress: &Progress,
) -> Result<AtomicFile> {
    check_size(path, grid, labels)?;
    write::segments(path, grid, labels, segments, progress)
}

fn check_size(path: &Path, grid: &Grid, labels: &[u8]) -> Result<()> {
    if labels.len() == grid.len() {
        return Ok(());
    }
    let why = format!("{} labels for {} voxels", labels.len(), grid.len());
    Err(Error::fault(path.display().to_string(), why, "report this as a bug"))
}

/// Writes a label mask (one byte per voxel, x fastest) on `grid`. The file extension selects the format.
///
/// # Errors
/// Same as [`save`]; status 1 if the mask does not match the grid's size.
pub fn save_mask(path: &Path, grid: &Grid, mask: &[u8], progress: &Progress) -> Result<()> {
    check_size(path, grid, mask)?;
    write::write(path, grid, voxels::Voxels::Labels(mask), progress)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Kind;

    #[test]
    fn an_unknown_ending_is_refused_before_any_work() {
        for name in ["a.nii", "a.nii.gz", "a.mhd", "a.mha", "a.nrrd", "a.nhdr"] {
            assert!(check_ending(Path::new(name)).is_ok(), "{name}");
        }
        for name in ["a.dcm", "a.nii.zip", "nii", ""] {
            assert_eq!(check_ending(Path::new(name)).unwrap_err().kind, Kind::Usage, "{name}");
        }
    }
}
