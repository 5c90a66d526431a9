//! Conversion of header positions and directions to a [`Grid`] in the world (mm, LPS).

use std::path::Path;

use glam::{DMat3, DVec3};

use crate::error::{Error, Result};
use crate::volume::Grid;

/// Converts NIfTI's and NRRD's RAS to LPS and back by negating x and y.
pub(crate) const RAS_LPS: DMat3 = DMat3::from_cols_array(&[-1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0]);

/// Builds a grid from three steps (the world vectors from a voxel to its neighbours along each index axis, mm LPS). Fails with
/// status 3 and the reason if the grid is impossible.
pub(crate) fn from_steps(path: &Path, dims: [usize; 3], steps: DMat3, origin: DVec3) -> Result<Grid> {
    let spacing = DVec3::new(steps.x_axis.length(), steps.y_axis.length(), steps.z_axis.length());
    grid(path, dims, spacing, origin, steps)
}

/// Same as [`Grid::new`], with its error turned into one about `path`. Fails with status 3 and the reason if the grid is
/// impossible.
pub(crate) fn grid(path: &Path, dims: [usize; 3], spacing: DVec3, origin: DVec3, direction: DMat3) -> Result<Grid> {
    Grid::new(dims, spacing, origin, direction).map_err(|e| Error::file(path, e.why, "correct the header"))
}

/// Rejects spacing that is zero, negative or not finite. Fails with status 3 and the field and its value.
pub(crate) fn check_spacing(path: &Path, field: &str, spacing: &[f64]) -> Result<()> {
    match spacing.iter().find(|s| !(s.is_finite() && **s > 0.0)) {
        Some(s) => Err(Error::file(
            path,
            format!("{field} has spacing {s}, which is not positive and finite"),
            "correct the header",
        )),
        None => Ok(()),
    }
}

/// True if the columns are orthonormal, within the precision of single-precision headers.
pub(crate) fn is_orthonormal(m: &DMat3) -> bool {
    let t = m.transpose() * *m;
    (t - DMat3::IDENTITY).to_cols_array().iter().all(|x| x.abs() < 1e-4)
}
