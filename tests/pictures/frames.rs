//! Rendered pictures for people to look at, where a comparison fails.

use colvis::render::Frame;
use image::RgbImage;

use crate::support::panels::panels;

/// Keeps what was expected, what came and the difference in one picture, and says where.
pub fn shown(name: &str, expected: &Frame, got: &Frame) -> String {
    let [expected, got] = [expected, got].map(|frame| {
        let bytes = frame.pixels().concat();
        RgbImage::from_raw(frame.width() as u32, frame.height() as u32, bytes).expect("a whole picture")
    });
    panels(name, &expected, &got)
}
