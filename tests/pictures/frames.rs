//! Rendered pictures to look at when a comparison fails.

use colvis::render::Frame;
use image::RgbImage;

use crate::support::panels::panels;

/// Saves the expected picture, the actual one and their difference as one picture, and returns its location.
pub(crate) fn shown(name: &str, expected: &Frame, got: &Frame) -> String {
    let [expected, got] = [expected, got].map(|frame| {
        let bytes = frame.pixels().concat();
        RgbImage::from_raw(frame.width() as u32, frame.height() as u32, bytes).expect("a whole picture")
    });
    panels(name, &expected, &got)
}
