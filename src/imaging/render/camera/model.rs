//! Camera geometry and camera models.

use std::any::Any;
use std::fmt::Debug;
use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::form::Form;
use crate::error::Result;
use crate::panics::ask_plugin;
use crate::render::options::Options;

/// A camera's geometry: the ray that each point of its image shows, and the image point at which a position is seen.
///
/// **Image points** are measured from the middle of the image, x to the right and y upwards, in halves of its shorter
/// side: the edges of a square image are at ±1. **The camera's frame** has x to the right, y upwards and z forward, in
/// mm.
///
/// Cameras that compare equal must show the same: data kept from the last frame is then used for the next one.
pub trait Camera: AnyCamera + Send + Sync + Debug {
    /// Returns the ray through an image point, in the camera's frame.
    ///
    /// `None` where the image shows nothing: such pixels are black, and their depth is infinite.
    fn ray(&self, at: DVec2) -> Option<CameraRay>;

    /// Returns the image point at which a position (in the camera's frame, mm) is seen if nothing is in front of it.
    ///
    /// The point may be beyond the image's edges. `None` where no ray goes.
    fn project(&self, place: DVec3) -> Option<DVec2>;

    /// Returns where the camera's rays begin.
    fn origins(&self) -> Origins;

    /// For a perspective camera, returns the tangent of the angle between forward and the ray through a point at
    /// distance 1 from the middle.
    ///
    /// The ray through (x, y) then has the direction (x·tan, y·tan, 1). `None` for all other cameras. Renderers rely on
    /// this promise: such rays are set up sixteen at once, and kept from frame to frame.
    fn tangent(&self) -> Option<f64> {
        None
    }

    /// Returns how much the direction of rays may change over the image; `None` if unknown.
    ///
    /// Between any two points that are r apart, and between which every point has a ray, unit directions differ by no
    /// more than r times this. If it is unknown, every pixel gets its own ray, which takes longer.
    fn most_turn(&self) -> Option<f64> {
        None
    }

    /// Returns the only width divided by height that an image may have; `None` if it may have any.
    fn aspect(&self) -> Option<f64> {
        None
    }

    /// Returns a form from which sixteen rays are computed at once; `None` if the camera has none, and [`ray`](Camera::ray) is asked for
    /// each. Both must give the same directions, in single precision.
    fn form(&self) -> Option<Form<'_>> {
        None
    }
}

/// Where a camera's rays begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origins {
    /// All at the camera's position.
    One,
    /// Each at its own origin: rays are then traced one by one.
    Many,
}

/// A ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraRay {
    /// Where it begins, mm. Depths are measured from here.
    pub origin: DVec3,
    /// Its direction, of unit length.
    pub direction: DVec3,
}

/// Compares cameras of unknown type. Implemented for every camera with `PartialEq`.
pub trait AnyCamera: Any {
    /// True if `other` is an equal camera of the same type.
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

/// A named kind of camera: models of the same name and settings are equal. Those of this crate are in
/// [`BUILT_IN`](super::BUILT_IN). Build one on [`CameraModel::BASE`], so that your code also compiles with later fields.
#[derive(Clone, Copy, Debug)]
pub struct CameraModel {
    /// Its name on the command line and in scene files.
    pub name: &'static str,
    /// A one-sentence description for users.
    pub summary: &'static str,
    /// Its settings: the table with its name in the scene file.
    pub options: Options,
    /// Makes a camera from a view angle, an aspect ratio and these settings ([`Options::none`] refuses any).
    ///
    /// The view angle is in degrees over the image's shorter side, from edge to edge. The aspect ratio is the image's
    /// width divided by its height. The function must return a usage error if the model has no such camera.
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
/// The largest view angle of a perspective camera, degrees. Its picture is stretched without bound towards 180°.
const MOST_PERSPECTIVE_DEGREES: f64 = 170.0;

impl CameraModel {
    /// Creates the camera for a view angle, degrees over the image's shorter side, and for an image's width divided by its height.
    ///
    /// # Errors
    /// Returns status 2 if the model has no such camera.
    pub fn camera(&self, fov_degrees: f64, aspect: f64) -> Result<Arc<dyn Camera>> {
        ask_plugin(|| format!("camera {}", self.name), || (self.make)(fov_degrees, aspect, self.options))
    }

    /// Returns the view angle (degrees) nearest to `fov_degrees` that an operator may choose in flight.
    ///
    /// The range is from 1° to the largest angle that the model has a camera for, and to 170° for a perspective camera.
    /// `None` if `fov_degrees` is not finite.
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
        // The model only accepts or refuses an angle: trying whole degrees downwards comes close enough to its limit.
        (1..=wanted as u32).rev().map(f64::from).find(|&d| made(d).is_some())
    }
}
