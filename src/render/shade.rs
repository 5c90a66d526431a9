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

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{DMat3, DVec3, Quat};

    use super::*;
    use crate::render::TransferFunction;
    use crate::volume::{Grid, Volume};

    /// Between a wall seen head on and one seen edge on brightness is linear in gradient · ray, however long the gradient; a
    /// wall seen from behind has the light that comes from everywhere, and a homogeneous region all of it.
    #[test]
    fn brightness_is_linear_in_the_cosine() {
        let grid = Grid::new([2; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let space = PreparedVolume::new(Arc::new(Volume::new(grid, vec![0; 8])), TransferFunction::default());
        let light = Headlight::new(&space);
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
