//! Pictures of failed tests, kept for inspection.

use std::path::{Path, PathBuf};

use image::RgbImage;

/// Saves a picture as `target/failed/NAME.png` and returns its path.
pub(crate) fn keep(name: &str, picture: &RgbImage) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("failed");
    std::fs::create_dir_all(&folder).expect("a folder for pictures");
    let path = folder.join(format!("{}.png", name.replace(|c: char| !c.is_alphanumeric() && c != '.', "-")));
    picture.save(&path).expect("a picture");
    path
}
