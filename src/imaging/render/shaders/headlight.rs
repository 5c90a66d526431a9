//! Light from the camera (the paper's simplified Phong model): the default, built into the renderers.

use std::sync::Arc;

use glam::{Mat3, Vec3};

use super::{Shader, ShaderModel, SurfacePoint};
use crate::render::options::Options;
use crate::render::regression::to_world;
use crate::render::transfer::Palette;
use crate::space::PreparedVolume;

/// The paper's headlight.
pub const MODEL: ShaderModel = ShaderModel {
    name: "headlight",
    summary: "a light at the camera; brightness is linear in the cosine between ray and normal",
    options: Options::NONE,
    make: |options| options.none().map(|()| Arc::new(Tissue::default()) as Arc<dyn Shader>),
};

/// A headlight: a light at the camera, so that the only angle that matters is that between the ray and the normal.
///
/// Brightness is `ambient + diffuse · max(0, n·ray)`, n the normalised gradient. HU rise into the wall, so n·ray is positive where
/// the wall faces the camera. In a homogeneous region the gradient points at the camera, and brightness is full.
pub struct Headlight {
    palette: Palette,
    to_world: Mat3,
}

/// Share of light that comes from everywhere.
pub const AMBIENT: f32 = 0.1;
/// Share of light that comes from the camera.
pub const DIFFUSE: f32 = 0.9;

impl Headlight {
    /// Creates the light for rays through `volume`.
    pub fn new(volume: &PreparedVolume) -> Self {
        Self { palette: Palette::default(), to_world: to_world(volume.voxels()) }
    }

    /// Returns red, green and blue of a point of value `hu`.
    ///
    /// The value changes by `gradient` (HU/mm along the index axes), and the point is seen along `direction` (world, of
    /// unit length). A gradient of 0 marks a homogeneous region.
    #[inline(always)]
    pub fn colour(&self, hu: f32, gradient: Vec3, direction: Vec3) -> Vec3 {
        let facing = self.facing(self.to_world * gradient, direction);
        self.palette.colour(hu) * (AMBIENT + DIFFUSE * facing)
    }

    /// Returns the cosine between a world gradient and the ray, 0 to 1; 1 in a homogeneous region.
    #[inline(always)]
    pub fn facing(&self, gradient: Vec3, direction: Vec3) -> f32 {
        let square = gradient.length_squared();
        // A thousandth of an HU per mm is the rounding of a flat region.
        if square > 1e-6 { (gradient.dot(direction) / square.sqrt()).max(0.0) } else { 1.0 }
    }

    /// Returns the wall's own colour at a value, HU.
    #[inline(always)]
    pub fn tissue(&self, hu: f32) -> Vec3 {
        self.palette.colour(hu)
    }

    /// Converts a gradient along the index axes to the world gradient (HU/mm).
    #[inline(always)]
    pub fn world_gradient(&self, gradient: Vec3) -> Vec3 {
        self.to_world * gradient
    }
}

/// Returns the colour of tissue of value `hu` in full light, 0 to 1: a warm tone like that of mucosa.
pub fn tissue(hu: f32) -> Vec3 {
    Palette::default().colour(hu)
}

/// The headlight as an ordinary [`Shader`].
#[derive(Debug, Default)]
struct Tissue {
    palette: Palette,
}

impl Shader for Tissue {
    fn colour(&self, point: &SurfacePoint) -> Vec3 {
        self.palette.colour(point.hu) * (AMBIENT + DIFFUSE * point.facing)
    }

    fn is_smooth(&self) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{DMat3, DVec3, Quat};

    use super::*;
    use crate::space::TransferFunction;
    use crate::volume::{Grid, Volume};

    /// Between a wall seen head on and one seen edge on, brightness is linear in gradient · ray, however long the gradient. A wall
    /// seen from behind gets only the light that comes from everywhere, and a homogeneous region gets all of it.
    #[test]
    fn brightness_is_linear_in_the_cosine() {
        let grid = Grid::new([2; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let volume = PreparedVolume::new(Arc::new(Volume::new(grid, vec![0; 8])), TransferFunction::default());
        let light = Headlight::new(&volume);
        let full = Palette::default().colour(-650.0);
        let bright = |gradient: Vec3, ray: Vec3| {
            let share = light.colour(-650.0, gradient, ray) / full;
            assert!((share - Vec3::splat(share.x)).length() < 1e-5, "of all colours alike: {share}");
            share.x
        };
        for degrees in (0..=180).step_by(5) {
            let turn = (degrees as f32).to_radians();
            for steep in [0.01, 1.0, 700.0] {
                let found = bright(Quat::from_rotation_y(turn) * Vec3::Z * steep, Vec3::Z);
                let expected = AMBIENT + DIFFUSE * turn.cos().max(0.0);
                assert!((found - expected).abs() < 1e-5, "{degrees}° at {steep} HU/mm: {found} of {expected}");
            }
        }
        assert!((bright(Vec3::ZERO, Vec3::Z) - 1.0).abs() < 1e-6);
    }
}
