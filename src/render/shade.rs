//! Light from the camera (the paper's simplified Phong model).

use glam::{Mat3, Vec3};

use super::prepared_volume::PreparedVolume;
use super::regression::to_world;
use super::transfer::Palette;

/// The colour of a point of the wall.
pub trait Shader: Sync {
    /// Linear red, green and blue of a point of value `hu` whose value changes by `gradient` (HU/mm along the index
    /// axes), seen along `direction` (world, of unit length). A gradient of 0 is that of a homogeneous region.
    fn colour(&self, hu: f32, gradient: Vec3, direction: Vec3) -> Vec3;
}

/// A headlight: a light at the camera, so that the only angle that matters is that between the ray and the normal.
///
/// Brightness is `ambient + diffuse · max(0, n·ray)`, n the normalised gradient. HU rise into the wall, so n·ray is
/// positive where the wall faces the camera. In a homogeneous region the gradient points at the camera: brightness is
/// full.
pub struct Headlight {
    ambient: f32,
    diffuse: f32,
    palette: Palette,
    to_world: Mat3,
}

/// Share of light that comes from everywhere.
pub const AMBIENT: f32 = 0.1;
/// Share of light that comes from the camera.
pub const DIFFUSE: f32 = 0.9;

impl Headlight {
    /// The light for rays through `space`.
    pub fn new(space: &PreparedVolume) -> Self {
        Self { ambient: AMBIENT, diffuse: DIFFUSE, palette: Palette::default(), to_world: to_world(space.volume()) }
    }
}

impl Shader for Headlight {
    #[inline(always)]
    fn colour(&self, hu: f32, gradient: Vec3, direction: Vec3) -> Vec3 {
        let g = self.to_world * gradient;
        let square = g.length_squared();
        // A thousandth of an HU per mm is the rounding of a flat region.
        let facing = if square > 1e-6 { (g.dot(direction) / square.sqrt()).max(0.0) } else { 1.0 };
        self.palette.colour(hu) * (self.ambient + self.diffuse * facing)
    }
}
