//! Cameras: their poses, and the ray through each pixel of their image.
//!
//! A [`Camera`] knows only its own frame. A [`View`] is a camera with a pose and pixels. Every renderer gets its rays
//! through these two. A camera model of this crate is therefore one file here and a line in [`BUILT_IN`]; one from
//! outside is passed to [`View::with_camera`].

mod model;
pub mod perspective;
mod view;

pub use model::{AnyCamera, Camera, CameraModel, CameraRay, Origins};
pub use perspective::Perspective;
pub use view::{MAX_SIDE, View};

/// Every camera model of this crate.
pub const BUILT_IN: [CameraModel; 1] = [perspective::MODEL];

impl CameraModel {
    /// Returns the model of this crate with that name.
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
