//! Shaders: the colour of a point of the wall. Each is one file and a line in [`BUILT_IN`].
//!
//! Every renderer of this crate gets its colours from the chosen [`Shader`]. The default, [`headlight`], is part of the renderers
//! and costs no call. Any other shader is called for each point of the wall that a ray meets. Packets of rays then cast a ray for
//! every pixel, as they cannot know what is between two rays, unless the shader [is smooth](Shader::is_smooth).

pub mod headlight;

use std::fmt::Debug;
use std::sync::Arc;

use glam::{DVec3, Vec3};

use super::options::Options;
use crate::error::Result;
use crate::panics::ask_plugin;

/// Every shader of this crate.
pub const BUILT_IN: [ShaderModel; 1] = [headlight::MODEL];

/// A point of the wall where a ray from the camera meets it.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct SurfacePoint {
    /// Position, world, mm.
    pub position: DVec3,
    /// Value, HU.
    pub hu: f32,
    /// Normal from the wall towards the gas, world, of unit length. In homogeneous tissue it points at the camera.
    pub normal: Vec3,
    /// The ray's direction, world, of unit length.
    pub direction: Vec3,
    /// Cosine of the angle between the normal and the direction back to the camera, 0 to 1: 1 for a wall seen head on.
    pub facing: f32,
    /// Distance from the camera, mm.
    pub distance_mm: f32,
}

impl SurfacePoint {
    /// Creates a point `distance_mm` from `camera` (world, mm) along `direction`, where values rise along `gradient`
    /// (world, HU/mm).
    ///
    /// A gradient of less than a thousandth is the rounding of a homogeneous region.
    #[inline(always)]
    pub fn new(camera: DVec3, direction: Vec3, distance_mm: f32, hu: f32, gradient: Vec3) -> Self {
        let square = gradient.length_squared();
        let normal = if square > 1e-6 { gradient / -square.sqrt() } else { -direction };
        let facing = -normal.dot(direction);
        let position = camera + (direction * distance_mm).as_dvec3();
        Self { position, hu, normal, direction, facing: facing.max(0.0), distance_mm }
    }
}

/// The colour of points of the wall. It must depend on the point alone: points are requested in any order, by all threads.
pub trait Shader: Send + Sync + Debug {
    /// Returns red, green and blue of a point as shown, 0 to 1 each. NaN counts as 0.
    fn colour(&self, point: &SurfacePoint) -> Vec3;

    /// True if colours vary smoothly along a smooth wall: no texture, lines or steps. It must always return the same.
    ///
    /// The default renderer then traces only some of the pixels, which takes a fraction of the time, and interpolates the
    /// others as it does with the built-in headlight: where the depth, the headlight's brightness and each channel of the
    /// colour at a block's centre are what its corners predict. Details between its rays are lost.
    fn is_smooth(&self) -> bool {
        false
    }
}

/// A named shader. Those of this crate are in [`BUILT_IN`]; a program may add its own, which work wherever these do.
///
/// Build one on [`ShaderModel::BASE`], so that your code also compiles with later fields.
#[derive(Clone, Copy, Debug)]
pub struct ShaderModel {
    /// Its name in scene files, `[render] shade = "…"`. Shaders of the same name are equal if their settings are.
    pub name: &'static str,
    /// A one-sentence description for users.
    pub summary: &'static str,
    /// Its settings: the table with its name in the scene file.
    pub options: Options,
    /// Makes the shader with these settings. It must return a usage error if they make no sense.
    pub make: fn(Options) -> Result<Arc<dyn Shader>>,
}

impl PartialEq for ShaderModel {
    fn eq(&self, other: &Self) -> bool {
        (self.name, self.options) == (other.name, other.options)
    }
}

impl Eq for ShaderModel {}

impl Default for ShaderModel {
    fn default() -> Self {
        headlight::MODEL
    }
}

impl ShaderModel {
    /// The headlight without a name. Use it as the base of others: `..ShaderModel::BASE`.
    pub const BASE: Self = Self { name: "", summary: "", ..headlight::MODEL };

    /// Returns the shader; `None` if it is the one built into the renderers.
    pub(super) fn own(&self) -> Option<Arc<dyn Shader>> {
        if self.name == headlight::MODEL.name { None } else { self.shader().ok() }
    }

    fn shader(&self) -> Result<Arc<dyn Shader>> {
        ask_plugin(|| format!("shader {}", self.name), || (self.make)(self.options))
    }

    /// Checks that the shader accepts its settings.
    ///
    /// # Errors
    /// Returns status 2 if the settings make no sense.
    pub fn check(&self) -> Result<()> {
        let shader = format!("shader {}", self.name);
        self.shader().map(drop).map_err(|e| {
            e.named(|what| if what.starts_with(&shader) { what.to_owned() } else { format!("{shader}: {what}") })
        })
    }
}

/// Turns a shader's colour into light: NaN becomes 0, and nothing is brighter than white.
#[inline(always)]
pub(super) fn shown(colour: Vec3) -> Vec3 {
    // The order matters: the maximum of NaN and a number is the number.
    colour.max(Vec3::ZERO).min(Vec3::ONE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_colour_is_black_or_white() {
        let odd = Vec3::new(f32::NAN, f32::INFINITY, f32::NEG_INFINITY);
        assert_eq!(shown(odd), Vec3::new(0.0, 1.0, 0.0));
        assert_eq!(shown(Vec3::new(-1e-310, f32::MAX, 0.25)), Vec3::new(0.0, 1.0, 0.25));
    }

    #[test]
    fn a_point_has_the_geometry_of_its_ray() {
        let (camera, along) = (DVec3::new(1.0, 2.0, 3.0), Vec3::new(0.6, 0.0, 0.8));
        let p = SurfacePoint::new(camera, along, 5.0, -650.0, Vec3::new(0.0, 0.0, 200.0));
        assert!(p.position.distance(DVec3::new(4.0, 2.0, 7.0)) < 1e-6 && p.normal == Vec3::NEG_Z);
        assert!((p.facing - 0.8).abs() < 1e-6);
        let behind = SurfacePoint::new(camera, along, 5.0, -650.0, Vec3::new(0.0, 0.0, -200.0));
        assert_eq!((behind.facing, behind.normal), (0.0, Vec3::Z));
        let flat = SurfacePoint::new(camera, along, 5.0, -650.0, Vec3::splat(1e-5));
        assert!((flat.facing - 1.0).abs() < 1e-6 && flat.normal == -along);
    }
}
