//! A pinhole camera from a calibration: its middle may be anywhere, and its pixels need not be square.

use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::lens::{Pixels, focal};
use super::model::{Camera, CameraRay, Origins};
use super::perspective::{GRAZING, Perspective};
use crate::error::Result;

/// A pinhole camera with its focal lengths and its principal point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pinhole {
    /// The image point straight ahead.
    centre: DVec2,
    /// Focal lengths, in halves of the image's shorter side.
    focal: DVec2,
}

/// Creates a pinhole camera from its focal lengths (pixels) along x and y.
///
/// A camera with its axis in the middle and square pixels is a [`Perspective`], which renders fastest.
///
/// # Errors
/// Returns status 2 if a number is not finite or out of range.
pub fn pinhole(pixels: Pixels, focal_lengths: [f64; 2]) -> Result<Arc<dyn Camera>> {
    pixels.check()?;
    let [fx, fy] = focal_lengths;
    focal("fx", fx)?;
    focal("fy", fy)?;
    let camera = Pinhole { centre: pixels.centre(), focal: DVec2::new(fx, fy) / pixels.unit() };
    if camera.centre == DVec2::ZERO && fx == fy {
        return Ok(Arc::new(Perspective::of_tangent(1.0 / camera.focal.x)));
    }
    Ok(Arc::new(camera))
}

impl Camera for Pinhole {
    fn ray(&self, at: DVec2) -> Option<CameraRay> {
        let direction = ((at - self.centre) / self.focal).extend(1.0).normalize();
        Some(CameraRay { origin: DVec3::ZERO, direction })
    }

    fn project(&self, place: DVec3) -> Option<DVec2> {
        let ahead = place.z > GRAZING * place.length();
        ahead.then(|| self.centre + place.truncate() / place.z * self.focal)
    }

    fn origins(&self) -> Origins {
        Origins::One
    }

    /// Directions turn fastest on the axis, along the side with the shorter focal length.
    fn most_turn(&self) -> Option<f64> {
        Some(1.0 / self.focal.min_element())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::View;
    use crate::render::camera::checks::{check_round_trip, check_turn};

    const PIXELS: Pixels = Pixels { size: [475, 470], centre: [227.6, 237.5] };

    #[test]
    fn pixels_are_where_the_calibration_has_them() {
        let camera = pinhole(PIXELS, [227.6, 237.5]).unwrap();
        assert!(camera.tangent().is_none());
        check_round_trip(&*camera, 475.0 / 470.0);
        check_turn(&*camera, 475.0 / 470.0);
        let view = View::with_camera(DVec3::ZERO, DVec3::Y, DVec3::Z, camera, 475, 470).unwrap();
        for (x, y) in [(0, 0), (474, 469), (100, 300)] {
            let ray = view.ray(x, y).unwrap().direction;
            let [u, v] = [(x as f64 - 227.6) / 227.6, (y as f64 - 237.5) / 237.5];
            assert!((ray - DVec3::new(u, 1.0, -v).normalize()).length() < 1e-12, "{x} {y}: {ray}");
        }
    }

    #[test]
    fn a_centred_one_is_the_plain_camera() {
        let plain = pinhole(Pixels { size: [200, 100], centre: [99.5, 49.5] }, [50.0; 2]).unwrap();
        assert!(plain.tangent().is_some_and(|t| (t - 1.0).abs() < 1e-12), "90° over the shorter side");
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(pinhole(PIXELS, [bad, 1.0]).is_err() && pinhole(PIXELS, [1.0, bad]).is_err(), "{bad}");
            assert!(bad.is_finite() || pinhole(Pixels { centre: [bad, 0.0], ..PIXELS }, [1.0; 2]).is_err(), "{bad}");
        }
    }
}
