//! From what headers say about place and direction to a [`Grid`] in the world (mm, LPS).

use std::path::Path;

use glam::{DMat3, DVec3};

use crate::error::{Error, Result};
use crate::volume::Grid;

/// Turns NIfTI's and NRRD's RAS into LPS and back: left and right, front and back change sign.
pub const RAS_LPS: DMat3 = DMat3::from_cols_array(&[-1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0]);

/// A grid from three steps (the world vector from one voxel to its neighbour along each index axis, mm LPS).
///
/// # Errors
/// Status 3 with what is impossible about it.
pub fn from_steps(path: &Path, dims: [usize; 3], steps: DMat3, origin: DVec3) -> Result<Grid> {
    let spacing = DVec3::new(steps.x_axis.length(), steps.y_axis.length(), steps.z_axis.length());
    grid(path, dims, spacing, origin, steps)
}

/// [`Grid::new`] with its complaint made an error about `path`.
///
/// # Errors
/// Status 3 with what is impossible about it.
pub fn grid(path: &Path, dims: [usize; 3], spacing: DVec3, origin: DVec3, direction: DMat3) -> Result<Grid> {
    Grid::new(dims, spacing, origin, direction).map_err(|why| Error::file(path, why, "correct the header"))
}

/// Refuses spacing that is zero, negative or not finite.
///
/// # Errors
/// Status 3 naming the field and its value.
pub fn check_spacing(path: &Path, field: &str, spacing: &[f64]) -> Result<()> {
    match spacing.iter().find(|s| !(s.is_finite() && **s > 0.0)) {
        Some(s) => Err(Error::file(
            path,
            format!("{field} has spacing {s}, which is not positive and finite"),
            "correct the header",
        )),
        None => Ok(()),
    }
}

/// Whether the columns are unit vectors at right angles, as far as single-precision headers can tell.
pub fn is_orthonormal(m: &DMat3) -> bool {
    let t = m.transpose() * *m;
    (t - DMat3::IDENTITY).to_cols_array().iter().all(|x| x.abs() < 1e-4)
}
