//! What a camera is.

use std::any::Any;
use std::fmt::Debug;
use std::sync::Arc;

use glam::{DVec2, DVec3};

use crate::error::Result;
use crate::panics::ask_plugin;
use crate::render::options::Options;

/// A camera's geometry: which ray each point of its image shows, and where in the image a place is seen.
///
/// **Image points** are told from the middle of the image, x to the right and y upwards, in halves of its shorter side: the
/// edges of a square image lie at ±1. **The camera's frame** has x to the right, y upwards and z forward, in mm.
///
/// Cameras that compare as equal show the same: what was kept of the last frame is used for the next one then.
pub trait Camera: AnyCamera + Send + Sync + Debug {
    /// The ray through an image point, in the camera's frame; none where the image shows nothing: such pixels are black, and
    /// their depth is infinite.
    fn ray(&self, at: DVec2) -> Option<CameraRay>;

    /// The image point at which a place (in the camera's frame) is seen if nothing is in front of it, which may lie beyond
    /// the image's edges; none where no ray goes.
    fn project(&self, place: DVec3) -> Option<DVec2>;

    /// Where its rays begin.
    fn origins(&self) -> Origins;

    /// For a perspective camera, the tangent of the angle between forward and the ray through a point at distance 1 from the
    /// middle: the ray through (x, y) has the direction (x·tan, y·tan, 1). None for all others. What this promises is
    /// relied upon: such rays are set up sixteen at once, and kept from frame to frame.
    fn tangent(&self) -> Option<f64> {
        None
    }

    /// How much the direction of rays may change over the image: between any two points that are r apart, and between which
    /// every point has a ray, unit directions differ by no more than r times this. None where that is not known: every pixel
    /// gets a ray of its own then, which takes longer.
    fn most_turn(&self) -> Option<f64> {
        None
    }
}

/// Where a camera's rays begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origins {
    /// All at the camera's place.
    One,
    /// Each where it says: they are traced one after the other.
    Many,
}

/// A ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraRay {
    /// Where it begins, mm. Depths are told from here.
    pub origin: DVec3,
    /// Where it goes, of unit length.
    pub direction: DVec3,
}

/// Compares cameras whose types are not known; every camera that can be compared with its like has it.
pub trait AnyCamera: Any {
    /// Whether `other` is an equal camera of the same type.
    fn is_same(&self, other: &dyn Camera) -> bool;
}

impl<C: Camera + PartialEq> AnyCamera for C {
    fn is_same(&self, other: &dyn Camera) -> bool {
        (other as &dyn Any).downcast_ref::<Self>() == Some(self)
    }
}

impl PartialEq for dyn Camera {
    fn eq(&self, other: &Self) -> bool {
        self.is_same(other)
    }
}

/// A kind of camera by its name: models of the same name and settings are equal. Those of this crate are in [`BUILT_IN`](super::BUILT_IN).
#[derive(Clone, Copy, Debug)]
pub struct CameraModel {
    /// Its name on the command line and in scene files.
    pub name: &'static str,
    /// What it is, in a sentence for people.
    pub summary: &'static str,
    /// Its settings: the scene file's table of its name.
    pub options: Options,
    /// Makes the camera of a view angle, degrees over the image's shorter side from edge to edge, of an image's width divided
    /// by its height, and of these settings ([`Options::none`] refuses any). It is an error of usage when the model has no such
    /// camera.
    pub make: fn(f64, f64, Options) -> Result<Arc<dyn Camera>>,
}

impl PartialEq for CameraModel {
    fn eq(&self, other: &Self) -> bool {
        (self.name, self.options) == (other.name, other.options)
    }
}

impl Eq for CameraModel {}

/// The least view angle that an operator may choose, degrees.
const LEAST_DEGREES: f64 = 1.0;
/// The most for a perspective camera, whose picture is stretched without bound towards 180°, degrees.
const MOST_PERSPECTIVE_DEGREES: f64 = 170.0;

impl CameraModel {
    /// The camera of a view angle, degrees over the image's shorter side, and of an image's width divided by its height.
    ///
    /// # Errors
    /// Status 2 when the model has no such camera.
    pub fn camera(&self, fov_degrees: f64, aspect: f64) -> Result<Arc<dyn Camera>> {
        ask_plugin(|| format!("camera {}", self.name), || (self.make)(fov_degrees, aspect, self.options))
    }

    /// The view angle (degrees) nearest to `fov_degrees` that an operator may choose in flight: from 1° to the most that
    /// the model has a camera for, of a perspective camera to 170°. None for what is no number.
    pub fn clamp_fov(&self, fov_degrees: f64) -> Option<f64> {
        if !fov_degrees.is_finite() {
            return None;
        }
        let made = |degrees: f64| self.camera(degrees, 1.0).ok();
        let wanted = fov_degrees.clamp(LEAST_DEGREES, 360.0);
        let flat = made(90.0).is_some_and(|c| c.tangent().is_some());
        let wanted = if flat { wanted.min(MOST_PERSPECTIVE_DEGREES) } else { wanted };
        if made(wanted).is_some() {
            return Some(wanted);
        }
        // The model says yes or no: whole degrees downwards are near enough to its limit.
        (1..=wanted as u32).rev().map(f64::from).find(|&d| made(d).is_some())
    }
}
