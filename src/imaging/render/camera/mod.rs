//! Cameras: their poses, and the ray through each pixel of their image.
//!
//! A [`Camera`] knows only its own frame. A [`View`] is a camera with a pose and pixels. Every renderer gets its rays
//! through these two. A camera model of this crate is therefore one file here and a line in [`BUILT_IN`]; one from
//! outside is passed to [`View::with_camera`].

#[cfg(test)]
mod checks;
pub mod fisheye;
pub mod form;
pub mod lens;
mod model;
pub mod panorama;
pub mod perspective;
pub mod pinhole;
mod polynomial;
pub mod scaramuzza;
mod sixteen;
mod view;

pub use fisheye::{Fisheye, KannalaBrandt};
pub use form::Form;
pub use lens::Pixels;
pub use model::{AnyCamera, Camera, CameraModel, CameraRay, Origins};
pub use panorama::Panorama;
pub use perspective::Perspective;
pub use pinhole::Pinhole;
pub use scaramuzza::Scaramuzza;
pub use sixteen::Sixteen;
pub use view::{MAX_SIDE, View};

/// Every camera model of this crate.
pub const BUILT_IN: [CameraModel; 3] = [perspective::MODEL, fisheye::MODEL, panorama::MODEL];

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
