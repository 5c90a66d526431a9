//! Saves the image of a pose, without overlays.

use std::path::{Path, PathBuf};

use serde_json::json;

use crate::components::camera::Pose;
use crate::error::{Error, Result};
use crate::host::record::write_png;
use crate::render::Frame;

/// Maximum number of screenshot names in one folder.
const NAMES: u32 = 10_000;

/// Saves an image in `folder` under an unused name. Returns its path.
///
/// # Errors
/// Returns status 5 if it cannot be written, or no name is left.
pub(crate) fn save(frame: &Frame, folder: &Path) -> Result<PathBuf> {
    let path = free_name(folder)?;
    write_png(&path, frame)?;
    Ok(path)
}

fn free_name(folder: &Path) -> Result<PathBuf> {
    (1..NAMES)
        .map(|n| folder.join(format!("colvis-{n:04}.png")))
        .find(|p| p.symlink_metadata().is_err())
        .ok_or_else(|| Error::output(folder, "is full of screenshots", "move them elsewhere"))
}

/// Formats a pose on one line, as input for `render --poses`.
pub(crate) fn pose_json(pose: &Pose, fov_degrees: f64) -> String {
    let one = json!({
        "position": pose.position.to_array(),
        "forward": pose.attitude.forward.to_array(),
        "up": pose.attitude.up.to_array(),
    });
    json!({ "fov_degrees": fov_degrees, "poses": [one] }).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_free() {
        let dir = tempfile::tempdir().unwrap();
        let first = free_name(dir.path()).unwrap();
        std::fs::write(&first, "x").unwrap();
        let second = free_name(dir.path()).unwrap();
        assert_ne!(first, second);
        assert!(second.ends_with("colvis-0002.png"));
    }
}
