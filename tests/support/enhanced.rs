//! An enhanced DICOM image: many frames in one file.

use super::dicom::Slice;

impl Slice {
    /// Creates an enhanced image with twelve frames, from top to bottom.
    pub(crate) fn enhanced() -> Self {
        let frames = || (0..12).rev().map(|k| Self::at(2.5 * f64::from(k)));
        Self {
            position: None,
            frames: Some("12"),
            places: frames().filter_map(|s| s.position).collect(),
            pixels: frames().flat_map(|s| s.pixels).collect(),
            ..Self::at(0.0)
        }
    }
}
