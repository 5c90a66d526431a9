//! A DICOM series as a folder of slices.

use std::path::Path;

use super::dicom::Slice;

/// Writes slices as `0.dcm`, `1.dcm`, … into a folder.
pub(crate) fn write_series(folder: &Path, slices: &[Slice]) {
    for (k, s) in slices.iter().enumerate() {
        std::fs::write(folder.join(format!("{k}.dcm")), s.bytes()).unwrap();
    }
}
