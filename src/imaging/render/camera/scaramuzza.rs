//! `scaramuzza`: a fisheye with Scaramuzza's polynomial, as calibrators of endoscopes write it.
//!
//! D. Scaramuzza, A. Martinelli and R. Siegwart, "A toolbox for easily calibrating omnidirectional cameras", IROS 2006. A pixel (x, y)
//! shows what lies along (u, v, a₀ + a₂ρ² + a₃ρ³ + a₄ρ⁴) with ρ² = u² + v², where
//!
//! ```text
//! ⎛x⎞   ⎛c  d⎞ ⎛u⎞   ⎛cx⎞
//! ⎝y⎠ = ⎝e  1⎠ ⎝v⎠ + ⎝cy⎠
//! ```
//!
//! takes the lens's plane to pixels, x to the right and y down. This is the *stretch matrix* of MATLAB's `fisheyeIntrinsics`, whose pixels
//! count from 1: subtract 1 from its distortion centre. Programs differ in the order: one that writes [c e; d 1] for the same three
//! numbers means another camera. Exchange d and e to see what it renders. (For the C3VD data set that is a roll of 0.33°, and 4 pixels at
//! the rim.)

use glam::DMat2;

use super::form::Plane;
use super::lens::{Curve, Lens, MOST, Pixels, within};
use super::polynomial::{derivative, extremes, product, roots, solve, value};
use crate::error::{Error, Result};

/// A camera with Scaramuzza's polynomial.
pub type Scaramuzza = Lens<Taylor>;

/// Creates a camera from a calibration: `a` is [a₀, a₂, a₃, a₄] for pixels, `stretch` is [c, d, e].
///
/// Angles stop growing where the polynomial says so: pixels farther out show nothing.
///
/// # Errors
/// Returns status 2 if a number is not finite or out of range, or if angles never grow: a₀ is not above 0.
pub fn scaramuzza(pixels: Pixels, a: [f64; 4], stretch: [f64; 3]) -> Result<Scaramuzza> {
    pixels.check()?;
    for (name, a) in ["a0", "a2", "a3", "a4"].into_iter().zip(a) {
        within(name, a, -MOST..=MOST)?;
    }
    let [c, d, e] = stretch;
    for (name, number) in [("c", c), ("d", d), ("e", e)] {
        within(&format!("stretch's {name}"), number, -MOST..=MOST)?;
    }
    if a[0] < 1.0 / MOST {
        let why = format!("a0 is {}: angles never grow with the distance from the middle", a[0]);
        let hint = "give a0 above 0: what lies ahead has a positive third coordinate";
        return Err(Error::usage("camera", why, hint));
    }
    // Image points run upwards, pixels run down.
    let (unit, flip) = (pixels.unit(), DMat2::from_cols_array(&[1.0, 0.0, 0.0, -1.0]));
    let to_plane = flip * DMat2::from_cols_array(&[c, e, d, 1.0]).inverse() * flip;
    let plane = Plane { centre: pixels.centre(), to_plane };
    if !to_plane.is_finite() {
        let why = format!("the stretch matrix [{c} {d}; {e} 1] has no inverse");
        return Err(Error::usage("camera", why, "give [c, d, e] of a calibration, such as [1, 0, 0]"));
    }
    // In units of image points.
    let a = [a[0] / unit, 0.0, a[1] * unit, a[2] * unit * unit, a[3] * unit * unit * unit];
    let corner = plane.to_plane.abs() * (pixels.half() + plane.centre.abs());
    Lens::new(Taylor::new(a, 1.1 * corner.length()), plane, pixels.half())
}

/// The curve tan θ = ρ/f(ρ) with f = a₀ + a₂ρ² + a₃ρ³ + a₄ρ⁴.
#[derive(Clone, Debug, PartialEq)]
pub struct Taylor {
    /// The coefficients of f, lowest power first.
    f: [f64; 5],
    /// The radius at which θ stops growing; infinite if that is beyond what was asked for.
    end: f64,
}

impl Taylor {
    /// Creates the curve for radii up to `most`.
    fn new(f: [f64; 5], most: f64) -> Self {
        let end = roots(&numerator(f), 0.0, most).first().copied().unwrap_or(f64::INFINITY);
        Self { f, end }
    }

    /// Returns θ and its derivative.
    fn angle_and_slope(&self, radius: f64) -> (f64, f64) {
        let f = value(&self.f, radius);
        (radius.atan2(f), value(&numerator(self.f), radius) / (radius * radius + f * f))
    }
}

/// Returns the numerator of θ' = (f − ρf')/(ρ² + f²).
fn numerator(f: [f64; 5]) -> [f64; 5] {
    std::array::from_fn(|n| f[n] * (1.0 - n as f64))
}

impl Curve for Taylor {
    fn end(&self) -> f64 {
        self.end
    }

    fn angle(&self, radius: f64) -> f64 {
        self.angle_and_slope(radius).0
    }

    fn radius(&self, angle: f64, reach: f64) -> f64 {
        solve(|radius| self.angle_and_slope(radius), angle, [0.0, reach], self.f[0] * angle)
    }

    /// θ' is greatest where its derivative changes its sign, or at an end.
    fn steepest(&self, reach: f64) -> Option<f64> {
        // Radii in units of the reach, so that powers do not differ by orders of magnitude.
        let mut power = 1.0;
        let scaled: Vec<f64> = self.f.iter().map(|c| (c * power, power *= reach).0).collect();
        let scaled: [f64; 5] = scaled.try_into().ok()?;
        let above = numerator(scaled);
        let mut below = product(&scaled, &scaled);
        below[2] += reach * reach;
        let [first, second] = [product(&derivative(&above), &below), product(&above, &derivative(&below))];
        let turns: Vec<f64> = (0..first.len().max(second.len()))
            .map(|n| first.get(n).unwrap_or(&0.0) - second.get(n).unwrap_or(&0.0))
            .collect();
        let places = roots(&turns, 0.0, 1.0).into_iter().chain([0.0, 1.0]);
        let most = places.map(|x| value(&above, x) / value(&below, x)).fold(0.0, f64::max);
        let [least, _] = extremes(&below, 0.0, 1.0);
        // The quotient is in units of 1/reach; a thousandth more than enough covers its rounding.
        (least > 0.0 && most.is_finite()).then_some(1.001 * most)
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec2, DVec3};

    use super::*;
    use crate::render::Camera;
    use crate::render::camera::checks::{check_round_trip, check_turn};

    /// The calibration that is published with C3VD.
    const A: [f64; 4] = [769.2436, -8.127706e-4, 6.256742e-7, -1.196622e-9];
    const STRETCH: [f64; 3] = [0.999987, 0.00288274, -0.00296317];
    const PIXELS: Pixels = Pixels { size: [1350, 1080], centre: [678.5448, 542.9759] };

    /// The image point of a pixel's centre.
    fn point(x: f64, y: f64) -> DVec2 {
        DVec2::new(x + 0.5 - 675.0, 540.0 - y - 0.5) / 540.0
    }

    /// The definition, pixel by pixel: y down becomes y up in the camera's frame.
    #[test]
    fn rays_are_those_of_the_definition() {
        let camera = scaramuzza(PIXELS, A, STRETCH).unwrap();
        let [c, d, e] = STRETCH;
        for (u, v) in [(0.0, 0.0), (300.0, 0.0), (0.0, -420.0), (-500.0, 333.0), (610.0, 480.0)] {
            let rho = f64::hypot(u, v);
            let along = DVec3::new(u, -v, A[0] + A[1] * rho.powi(2) + A[2] * rho.powi(3) + A[3] * rho.powi(4));
            let pixel = point(c * u + d * v + PIXELS.centre[0], e * u + v + PIXELS.centre[1]);
            let found = camera.ray(pixel).unwrap().direction;
            assert!((found - along.normalize()).length() < 1e-12, "{u} {v}: {found}");
            assert!((camera.project(along * 7.0).unwrap() - pixel).length() < 1e-9, "{u} {v}");
        }
    }

    #[test]
    fn places_are_seen_where_their_rays_go_and_rays_turn_no_faster_than_they_say() {
        let other = [767.7337, -5.925064e-4, -2.694403e-7, -2.163804e-10];
        for (a, stretch) in [(A, STRETCH), (other, [0.9999, 1.1e-4, -1.83e-4]), (A, [1.2, 0.1, -0.2])] {
            let camera = scaramuzza(PIXELS, a, stretch).unwrap();
            assert!(camera.form().is_some());
            check_round_trip(&camera, 1.25);
            check_turn(&camera, 1.25);
        }
        // Angles beyond 90°: the third coordinate becomes negative.
        let wide = scaramuzza(PIXELS, [300.0, -1.5e-3, 0.0, -1e-9], [1.0, 0.0, 0.0]).unwrap();
        assert!(wide.ray(DVec2::new(0.0, 1.0)).unwrap().direction.z < 0.0);
        check_round_trip(&wide, 1.25);
        check_turn(&wide, 1.25);
    }

    #[test]
    fn polynomials_that_fold_back_end_the_image_and_those_that_never_grow_are_refused() {
        // θ stops growing where f = ρf': a₀ = a₂ρ², here at 400 pixels.
        let folds = scaramuzza(PIXELS, [160.0, 1e-3, 0.0, 0.0], [1.0, 0.0, 0.0]).unwrap();
        let at = |radius: f64| folds.ray(point(PIXELS.centre[0] + radius, PIXELS.centre[1]));
        assert!(at(399.9).is_some() && at(400.1).is_none());
        let refused = |a, stretch| scaramuzza(PIXELS, a, stretch).unwrap_err().to_string();
        let straight = [1.0, 0.0, 0.0];
        for a0 in [0.0, -769.0] {
            assert!(refused([a0, 0.0, 0.0, 0.0], straight).contains("never grow"), "{a0}");
        }
        assert!(refused([f64::NAN, 0.0, 0.0, 0.0], straight).contains("a0"));
        assert!(refused([700.0, 0.0, f64::INFINITY, 0.0], straight).contains("a3"));
        assert!(refused([700.0, 0.0, 0.0, 0.0], [0.0, 0.0, 5.0]).contains("stretch"));
        assert!(refused([700.0, 0.0, 0.0, 0.0], [1.0, f64::NAN, 5.0]).contains("stretch's d"));
    }
}
