//! `fisheye`: angles grow with the distance from the middle.
//!
//! - [`equidistant`](MODEL): in proportion to it.
//! - [`KannalaBrandt`]: by a polynomial from a calibration (J. Kannala and S. S. Brandt, "A generic camera model and calibration method
//!   for conventional, wide-angle, and fish-eye lenses", IEEE TPAMI 28(8), 2006), r = θ + k₁θ³ + k₂θ⁵ + k₃θ⁷ + k₄θ⁹.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::{DMat2, DVec2};

use super::form::Plane;
use super::lens::{Curve, Lens, MOST, Pixels, focal, within};
use super::model::CameraModel;
use super::polynomial::{extremes, roots, solve, value};
use crate::error::{Error, Result};
use crate::render::options::Options;

/// An equidistant fisheye.
pub const MODEL: CameraModel = CameraModel {
    name: "fisheye",
    summary: "equidistant: the angle from the middle grows with the distance from it; view angle up to 220°",
    options: Options::NONE,
    make: |fov_degrees, aspect, options| {
        options.none()?;
        Ok(Arc::new(equidistant(fov_degrees, aspect)?))
    },
};

/// The largest view angle over the shorter side, degrees. The corners of a square image then show 311°.
const MOST_DEGREES: f64 = 220.0;

/// A fisheye whose angles grow in proportion to the distance from the middle.
pub type Fisheye = Lens<Equidistant>;

/// A fisheye with the coefficients of a calibration.
pub type KannalaBrandt = Lens<Growth>;

/// Creates a fisheye with the view angle `fov_degrees` over the shorter side of an image whose width divided by its height is `aspect`.
///
/// # Errors
/// Returns status 2 if the angle is not above 0 and at most 220°.
pub fn equidistant(fov_degrees: f64, aspect: f64) -> Result<Fisheye> {
    if !(fov_degrees > 0.0 && fov_degrees <= MOST_DEGREES) {
        let why = format!("{fov_degrees}° is not above 0 and up to {MOST_DEGREES}");
        return Err(Error::usage("view angle", why, "give degrees, such as 180"));
    }
    let curve = Equidistant { half: 0.5 * fov_degrees.to_radians() };
    // The curve is the same everywhere, so the image only tells how far it is needed.
    let half = DVec2::new(aspect, 1.0) / aspect.min(1.0);
    Lens::new(curve, Plane::IMAGE, if half.is_finite() { half } else { DVec2::ONE })
}

/// The curve of an equidistant fisheye.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Equidistant {
    /// The angle at a radius of 1, radians.
    half: f64,
}

impl Curve for Equidistant {
    fn end(&self) -> f64 {
        PI / self.half
    }

    fn angle(&self, radius: f64) -> f64 {
        radius * self.half
    }

    fn radius(&self, angle: f64, _: f64) -> f64 {
        angle / self.half
    }

    fn steepest(&self, _: f64) -> Option<f64> {
        Some(self.half)
    }
}

/// The curve r(θ) = θ + k₁θ³ + k₂θ⁵ + k₃θ⁷ + k₄θ⁹, read from the radius to the angle.
#[derive(Clone, Debug, PartialEq)]
pub struct Growth {
    k: [f64; 4],
    /// The angle up to which r grows, at most 180°, radians.
    last: f64,
    /// The radius there.
    end: f64,
}

impl Growth {
    /// Creates the curve.
    fn new(k: [f64; 4]) -> Self {
        // With u = θ², r' is a polynomial of the fourth degree.
        let last = roots(&slope(k), 0.0, PI * PI).first().map_or(PI, |u| u.sqrt());
        Self { k, last, end: radius(k, last) }
    }
}

/// Returns r(θ).
fn radius(k: [f64; 4], angle: f64) -> f64 {
    angle * value(&[1.0, k[0], k[1], k[2], k[3]], angle * angle)
}

/// Returns r'(θ) as a polynomial of θ².
fn slope(k: [f64; 4]) -> [f64; 5] {
    [1.0, 3.0 * k[0], 5.0 * k[1], 7.0 * k[2], 9.0 * k[3]]
}

impl Curve for Growth {
    fn end(&self) -> f64 {
        self.end
    }

    fn angle(&self, wanted: f64) -> f64 {
        let slope = slope(self.k);
        solve(|angle| (radius(self.k, angle), value(&slope, angle * angle)), wanted, [0.0, self.last], wanted)
    }

    fn radius(&self, angle: f64, _: f64) -> f64 {
        radius(self.k, angle)
    }

    /// The angle grows by 1/r' per radius.
    fn steepest(&self, reach: f64) -> Option<f64> {
        let angle = self.angle(reach);
        let [least, _] = extremes(&slope(self.k), 0.0, angle * angle);
        // Within rounding of 0 it is 0: the curve folds back there.
        (least > 1e-6).then_some(1.0 / least)
    }
}

/// Creates a fisheye from its focal lengths (pixels) along x and y and its coefficients.
///
/// The angle stops growing where r(θ) does, and at 180°: pixels farther out show nothing.
///
/// # Errors
/// Returns status 2 if a number is not finite or out of range.
pub fn kannala_brandt(pixels: Pixels, focal_lengths: [f64; 2], k: [f64; 4]) -> Result<KannalaBrandt> {
    pixels.check()?;
    let [fx, fy] = focal_lengths;
    focal("fx", fx)?;
    focal("fy", fy)?;
    for (n, k) in k.into_iter().enumerate() {
        within(&format!("k{}", n + 1), k, -MOST..=MOST)?;
    }
    let to_plane = DMat2::from_diagonal(DVec2::new(fx, fy).recip() * pixels.unit());
    Lens::new(Growth::new(k), Plane { centre: pixels.centre(), to_plane }, pixels.half())
}

#[cfg(test)]
mod tests {

    use glam::DVec3;

    use super::*;
    use crate::render::camera::checks::{check_round_trip, check_turn};
    use crate::render::{Camera, View};

    #[test]
    fn the_edge_of_180_degrees_is_at_90() {
        let camera = equidistant(180.0, 1.0).unwrap();
        let edge = camera.ray(DVec2::X).unwrap().direction;
        assert!((edge - DVec3::X).length() < 1e-15, "{edge}");
        let half = camera.ray(DVec2::new(0.0, -0.5)).unwrap().direction;
        assert!((half - DVec3::new(0.0, -1.0, 1.0).normalize()).length() < 1e-15, "45° at half of it: {half}");
        assert_eq!(camera.ray(DVec2::ZERO).unwrap().direction, DVec3::Z);
        let at = camera.project(DVec3::new(-3.0, 0.0, 0.0)).unwrap();
        assert!((at + DVec2::X).length() < 1e-15, "{at}");
        // Up to 180° from the axis, and not beyond.
        let last = camera.ray(DVec2::new(0.0, 1.999)).unwrap().direction;
        assert!(last.z < -0.999 && camera.ray(DVec2::new(1.5, 1.5)).is_none());
        assert!(camera.project(DVec3::ZERO).is_none());
        for bad in [0.0, -1.0, 220.1, f64::NAN, f64::INFINITY] {
            assert!(equidistant(bad, 1.0).is_err(), "{bad}");
        }
    }

    #[test]
    fn places_are_seen_where_their_rays_go_and_rays_turn_no_faster_than_they_say() {
        for (fov, aspect) in [(1.0, 1.0), (120.0, 0.5), (180.0, 1.0), (220.0, 1.7)] {
            let camera = equidistant(fov, aspect).unwrap();
            check_round_trip(&camera, aspect);
            check_turn(&camera, aspect);
        }
        for k in [[0.0; 4], [0.08, -0.03, 0.01, -0.001], [-0.05, 0.004, 0.0, 0.0], [0.3, 0.1, 0.2, 0.4]] {
            for (f, centre) in [([200.0, 190.0], [319.5, 239.5]), ([330.0, 310.0], [300.0, 262.0])] {
                let camera = kannala_brandt(Pixels { size: [640, 480], centre }, f, k).unwrap();
                check_round_trip(&camera, 640.0 / 480.0);
                check_turn(&camera, 640.0 / 480.0);
            }
        }
    }

    /// Without coefficients r = θ, so focal length × angle is the distance in pixels.
    #[test]
    fn pixels_are_where_the_calibration_has_them() {
        let pixels = Pixels { size: [640, 480], centre: [300.0, 200.0] };
        let camera = kannala_brandt(pixels, [250.0, 200.0], [0.0; 4]).unwrap();
        let view = View::with_camera(DVec3::ZERO, DVec3::Z, DVec3::Y, Arc::new(camera), 640, 480).unwrap();
        // Forward is z and up is y, so right is −x.
        assert!((view.ray(300, 200).unwrap().direction - DVec3::Z).length() < 1e-15);
        let right = view.ray(550, 200).unwrap().direction;
        assert!((right - DVec3::new(-1f64.sin(), 0.0, 1f64.cos())).length() < 1e-12, "{right}");
        let down = view.ray(300, 300).unwrap().direction;
        assert!((down - DVec3::new(0.0, -0.5f64.sin(), 0.5f64.cos())).length() < 1e-12, "{down}");
        let [x, y] = view.project(DVec3::new(0.0, 1.0, 1.0)).unwrap();
        let up = 200.0 - 200.0 * 45f64.to_radians();
        assert!((x - 300.5).abs() < 1e-9 && (y - 0.5 - up).abs() < 1e-9, "{x} {y}");
    }

    #[test]
    fn coefficients_that_fold_back_end_the_image() {
        // r = θ − θ³/3 grows up to θ = 1, where r is 2/3.
        let pixels = Pixels { size: [200, 200], centre: [99.5; 2] };
        let folds = |f: f64| kannala_brandt(pixels, [f; 2], [-1.0 / 3.0, 0.0, 0.0, 0.0]).unwrap();
        let camera = folds(100.0);
        let just = camera.ray(DVec2::new(0.0, 0.666)).unwrap().direction;
        assert!((just.angle_between(DVec3::Z) - 1.0).abs() < 0.05, "{just}");
        assert!(
            camera.ray(DVec2::new(0.667, 0.0)).is_none() && camera.most_turn().is_none() && camera.form().is_none()
        );
        assert!(camera.project(DVec3::new(1.0, 0.0, 0.3)).is_none(), "73° from the axis");
        // The corner of a longer lens is where the curve still grows.
        let long = folds(400.0);
        assert!(long.ray(DVec2::ONE).is_some() && long.form().is_some());
        check_turn(&long, 1.0);
    }

    #[test]
    fn an_image_of_the_whole_sphere_ends_at_its_antipode() {
        let pixels = Pixels { size: [200, 200], centre: [99.5; 2] };
        let camera = kannala_brandt(pixels, [30.0; 2], [0.0; 4]).unwrap();
        assert!(camera.ray(DVec2::new(0.94, 0.0)).unwrap().direction.z < -0.99);
        assert!(camera.ray(DVec2::new(0.943, 0.0)).is_none());
        check_turn(&camera, 1.0);
    }

    #[test]
    fn numbers_that_are_none_are_refused() {
        let pixels = Pixels { size: [640, 480], centre: [320.0, 240.0] };
        let made = |pixels, f, k| kannala_brandt(pixels, f, k).map(drop).map_err(|e| e.to_string());
        assert!(made(pixels, [300.0; 2], [0.0; 4]).is_ok());
        for bad in [0.0, -300.0, f64::NAN, f64::INFINITY, 1e9] {
            assert!(made(pixels, [bad, 300.0], [0.0; 4]).unwrap_err().contains("fx"), "{bad}");
            assert!(made(pixels, [300.0, bad], [0.0; 4]).unwrap_err().contains("fy"), "{bad}");
        }
        for bad in [f64::NAN, f64::NEG_INFINITY, 1e300] {
            assert!(made(pixels, [300.0; 2], [0.0, 0.0, bad, 0.0]).unwrap_err().contains("k3"), "{bad}");
            assert!(made(Pixels { centre: [bad, 240.0], ..pixels }, [300.0; 2], [0.0; 4]).is_err(), "{bad}");
        }
        assert!(made(Pixels { size: [0, 480], ..pixels }, [300.0; 2], [0.0; 4]).is_err());
    }

    #[test]
    fn cameras_are_equal_if_they_show_the_same() {
        let same = |a: &dyn Camera, b: &dyn Camera| a == b;
        assert!(same(&equidistant(180.0, 1.0).unwrap(), &equidistant(180.0, 1.0).unwrap()));
        assert!(!same(&equidistant(180.0, 1.0).unwrap(), &equidistant(181.0, 1.0).unwrap()));
        let made = |k| kannala_brandt(Pixels { size: [64, 48], centre: [32.0, 24.0] }, [30.0; 2], [k, 0.0, 0.0, 0.0]);
        assert!(same(&made(0.1).unwrap(), &made(0.1).unwrap()) && !same(&made(0.1).unwrap(), &made(0.2).unwrap()));
    }
}
