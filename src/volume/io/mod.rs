//! Reading and writing scans.

use std::path::Path;

use glam::DVec3;

use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::{Grid, Volume};

/// What the command line says about reading an input.
#[derive(Clone, Debug, Default)]
pub struct LoadOptions {
    /// Voxel spacing for inputs that carry none (a folder of PNG slices), mm.
    pub spacing: Option<DVec3>,
    /// The HU of black and of white for inputs that carry no HU.
    pub hu: Option<(f64, f64)>,
    /// Which DICOM series to take, counted from 1 as the printed list counts them.
    pub series: Option<usize>,
    /// Resample over missing slices instead of refusing them.
    pub allow_gaps: bool,
}

/// A scan and what there is to say about how it was read.
#[derive(Debug)]
pub struct Loaded {
    /// The scan.
    pub volume: Volume,
    /// Warnings for the user, one line each.
    pub notes: Vec<String>,
}

/// Reads any supported input.
///
/// # Errors
/// Status 3 with what is wrong with the input; status 4 when cancelled.
pub fn load(path: &Path, _options: &LoadOptions, _progress: &Progress) -> Result<Loaded> {
    Err(Error::file(path, "no reader takes it", "give a NIfTI, MetaImage, NRRD, DICOM or PNG input"))
}

/// What is in an input, as the `info` command prints it.
///
/// # Errors
/// As [`load`].
pub fn info(path: &Path, options: &LoadOptions, progress: &Progress) -> Result<serde_json::Value> {
    load(path, options, progress).map(|_| serde_json::json!({}))
}

/// Writes a scan; the format follows the ending (.nii, .nii.gz, .mhd, .mha, .nrrd, .nhdr).
///
/// # Errors
/// Status 2 for an unknown ending, 5 when it cannot be written.
pub fn save(path: &Path, _volume: &Volume, _progress: &Progress) -> Result<()> {
    Err(Error::not_built(path.display().to_string()))
}

/// Writes a label mask (one byte for each voxel, x fastest) on `grid`; the format follows the ending.
///
/// # Errors
/// As [`save`].
pub fn save_mask(path: &Path, _grid: &Grid, _mask: &[u8], _progress: &Progress) -> Result<()> {
    Err(Error::not_built(path.display().to_string()))
}
