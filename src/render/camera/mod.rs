//! Cameras: where they stand, and the ray through each pixel of their image.
//!
//! A [`Camera`] knows its own frame alone; a [`View`] is a camera that stands somewhere and has pixels. Every renderer gets
//! its rays through these two, so that a camera model of this crate is one file here and a line in [`BUILT_IN`], and one
//! from outside is given to [`View::with_camera`].

pub mod model;
pub mod perspective;
pub mod view;

pub use model::{Camera, CameraModel, CameraRay, Origins};
pub use perspective::Perspective;
pub use view::View;

/// Every camera model of this crate.
pub const BUILT_IN: [CameraModel; 1] = [perspective::MODEL];

impl CameraModel {
    /// The model of this crate that has that name.
    pub fn named(name: &str) -> Option<Self> {
        BUILT_IN.into_iter().find(|m| m.name == name)
    }
}

impl Default for CameraModel {
    fn default() -> Self {
        perspective::MODEL
    }
}

#[cfg(test)]
mod tests;
