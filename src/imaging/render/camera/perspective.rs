//! `perspective`: a pinhole camera.

use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::model::{Camera, CameraModel, CameraRay, Origins};
use crate::error::{Error, Result};
use crate::render::options::Options;

/// A pinhole camera: straight lines stay straight.
pub const MODEL: CameraModel = CameraModel {
    name: "perspective",
    summary: "pinhole: straight lines stay straight; view angle below 180°",
    options: Options::NONE,
    make: |fov_degrees, _, options| {
        options.none()?;
        Ok(Arc::new(Perspective::new(fov_degrees)?))
    },
};

impl CameraModel {
    /// A perspective camera without a name. Use it as the base of others: `..CameraModel::BASE`.
    pub const BASE: Self = Self { name: "", summary: "", ..MODEL };
}

/// Positions nearer than this to the plane through the camera, as a share of their distance, are not visible.
pub(super) const GRAZING: f64 = 1e-3;

/// A pinhole camera with a view angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Perspective {
    tangent: f64,
}

impl Perspective {
    /// Creates a camera with the view angle `fov_degrees` over the shorter side of the image, from edge to edge.
    ///
    /// # Errors
    /// Returns status 2 if the angle is not between 0 and 180°.
    pub fn new(fov_degrees: f64) -> Result<Self> {
        if !(fov_degrees > 0.0 && fov_degrees < 180.0) {
            let why = format!("{fov_degrees}° is not between 0 and 180");
            return Err(Error::usage("view angle", why, "give degrees, such as 90"));
        }
        Ok(Self::of_tangent((0.5 * fov_degrees.to_radians()).tan()))
    }

    /// Creates a camera from the tangent of half its view angle.
    pub(super) fn of_tangent(tangent: f64) -> Self {
        Self { tangent }
    }
}

impl Camera for Perspective {
    fn ray(&self, at: DVec2) -> Option<CameraRay> {
        Some(CameraRay { origin: DVec3::ZERO, direction: (at * self.tangent).extend(1.0).normalize() })
    }

    fn project(&self, place: DVec3) -> Option<DVec2> {
        (place.z > GRAZING * place.length()).then(|| place.truncate() / (place.z * self.tangent))
    }

    fn origins(&self) -> Origins {
        Origins::One
    }

    fn tangent(&self) -> Option<f64> {
        Some(self.tangent)
    }

    fn most_turn(&self) -> Option<f64> {
        Some(self.tangent)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Half a view angle of 60° has a tangent of 1/√3: how fast directions turn per unit of the image, at most.
    #[test]
    fn its_tangent_and_its_fastest_turn_are_that_of_half_the_angle() {
        for (degrees, tangent) in [(60.0, 3f64.sqrt().recip()), (90.0, 1.0), (120.0, 3f64.sqrt())] {
            let camera = Perspective::new(degrees).unwrap();
            for found in [camera.tangent(), camera.most_turn()] {
                assert!((found.unwrap() - tangent).abs() < 1e-12, "{degrees}°");
            }
            let turn = |x: f64| camera.ray(DVec2::new(x, 0.0)).unwrap().direction;
            assert!((turn(-1e-6).angle_between(turn(1e-6)) / 2e-6 - tangent).abs() < 1e-3, "{degrees}°");
        }
    }
}
