//! `panorama`: all directions, with longitude and latitude linear in the image.

use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::form::Form;
use super::model::{Camera, CameraModel, CameraRay, Origins};
use crate::render::options::Options;

/// A panorama.
pub const MODEL: CameraModel = CameraModel {
    name: "panorama",
    summary: "all around: longitude across and latitude upwards, 360° by 180°, pictures twice as wide as high",
    options: Options::NONE,
    make: |_, _, options| {
        options.none()?;
        Ok(Arc::new(Panorama))
    },
};

/// A camera that sees all around: 360° of longitude by 180° of latitude. Forward is in the middle, right on the right, up on top.
///
/// Its view angle is what it is, whatever is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Panorama;

/// Radians per image point: the shorter side, from −1 to 1, spans 180°.
pub(crate) const RADIANS: f64 = FRAC_PI_2;

impl Camera for Panorama {
    /// Beyond the image, directions go on around the poles and around the axis.
    fn ray(&self, at: DVec2) -> Option<CameraRay> {
        let (longitude, latitude) = (at.x * RADIANS, at.y * RADIANS);
        let (across, ahead) = longitude.sin_cos();
        let (up, level) = latitude.sin_cos();
        Some(CameraRay { origin: DVec3::ZERO, direction: DVec3::new(level * across, up, level * ahead) })
    }

    fn project(&self, place: DVec3) -> Option<DVec2> {
        let latitude = place.y.atan2(place.x.hypot(place.z));
        let longitude = place.x.atan2(place.z);
        (place != DVec3::ZERO).then(|| DVec2::new(longitude, latitude) / RADIANS)
    }

    fn origins(&self) -> Origins {
        Origins::One
    }

    /// Along a column directions turn by 90° per image point. Along a row they turn by as much times the cosine of the latitude.
    fn most_turn(&self) -> Option<f64> {
        Some(RADIANS)
    }

    fn aspect(&self) -> Option<f64> {
        Some(2.0)
    }

    fn form(&self) -> Option<Form<'_>> {
        Some(Form::Panorama)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::View;
    use crate::render::camera::checks::{check_round_trip, check_turn};

    #[test]
    fn forward_is_in_the_middle_right_on_the_right_and_up_on_top() {
        let ray = |x: f64, y: f64| Panorama.ray(DVec2::new(x, y)).unwrap().direction;
        for (found, wanted) in [
            (ray(0.0, 0.0), DVec3::Z),
            (ray(1.0, 0.0), DVec3::X),
            (ray(-1.0, 0.0), DVec3::NEG_X),
            (ray(2.0, 0.0), DVec3::NEG_Z),
            (ray(-2.0, 0.0), DVec3::NEG_Z),
            (ray(0.3, 1.0), DVec3::Y),
            (ray(1.7, -1.0), DVec3::NEG_Y),
            (ray(0.5, 0.0), DVec3::new(1.0, 0.0, 1.0).normalize()),
        ] {
            assert!((found - wanted).length() < 1e-15, "{found} {wanted}");
        }
        assert!(Panorama.project(DVec3::ZERO).is_none());
        check_round_trip(&Panorama, 2.0);
        check_turn(&Panorama, 2.0);
    }

    #[test]
    fn pictures_are_twice_as_wide_as_high() {
        let made = |w, h| View::with_model(DVec3::ZERO, DVec3::Y, DVec3::Z, MODEL, 90.0, w, h);
        assert!(made(2048, 1024).is_ok() && made(2, 1).is_ok());
        for (w, h) in [(1024, 1024), (2047, 1024), (1024, 2048)] {
            let why = made(w, h).unwrap_err().to_string();
            assert!(why.contains("2:1") && why.contains(&format!("{}x{h}", 2 * h)), "{why}");
        }
    }
}
