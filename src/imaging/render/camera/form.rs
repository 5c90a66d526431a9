//! Cameras in a form of which renderers compute sixteen rays at once.

use glam::{DMat2, DVec2};

/// How directions follow from image points, for renderers that compute many rays at once.
#[derive(Clone, Copy, Debug)]
pub enum Form<'a> {
    /// As the [`Lens`](super::lens::Lens) that the profile is of shows them.
    Lens(&'a Profile),
    /// As [`Panorama`](super::panorama::Panorama) shows them.
    Panorama,
}

/// Where the pixels of an image lie in a lens's plane: p = `to_plane` · (point − `centre`), with points as for
/// [`Camera::ray`](super::Camera::ray).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// The image point that the axis goes through.
    pub centre: DVec2,
    /// Turns offsets from it into positions in the plane.
    pub to_plane: DMat2,
}

impl Plane {
    /// The plane of a lens in front of the image's middle, in whose plane radii are those of the image.
    pub const IMAGE: Self = Self { centre: DVec2::ZERO, to_plane: DMat2::IDENTITY };

    /// Returns how much longer offsets become at most.
    pub(super) fn stretch(&self) -> f64 {
        // The largest singular value of a 2×2 matrix.
        let [a, b, c, d] = self.to_plane.to_cols_array();
        0.5 * ((a + d).hypot(b - c) + (a - d).hypot(b + c))
    }

    /// Returns the largest radius, in the plane, of the corners of an image with this half width and height.
    pub(super) fn corner(&self, half: DVec2) -> f64 {
        let corners = [DVec2::new(1.0, 1.0), DVec2::new(1.0, -1.0), DVec2::new(-1.0, 1.0), DVec2::new(-1.0, -1.0)];
        corners.map(|c| (self.to_plane * (c * half - self.centre)).length()).into_iter().fold(0.0, f64::max)
    }
}

/// Pieces of the table.
pub(crate) const PIECES: usize = 128;
/// The largest error of a direction's component that a table may have. This is below single precision.
const ERROR: f64 = 3e-8;

/// One piece of the table: the coefficients of two cubics of the place within the piece, from 0 to 1, lowest power first.
pub(crate) type Piece = [[f32; 4]; 2];

/// A lens as a table.
///
/// For the radius ρ in the lens's plane it holds sin θ/ρ and cos θ: a point p of the plane is seen along (p · sin θ/ρ, cos θ).
#[derive(Debug)]
pub struct Profile {
    pub(crate) plane: Plane,
    /// The radius at which the table ends.
    pub(crate) reach: f64,
    pub(crate) pieces: Vec<Piece>,
}

impl Profile {
    /// Creates the table for radii up to `reach` from a lens's angles (radians). `None` if it would not have single precision.
    pub fn new(plane: Plane, reach: f64, angle: impl Fn(f64) -> f64) -> Option<Self> {
        let width = reach / PIECES as f64;
        let exact = |place: f64| {
            let radius = (place * width).max(1e-6 * width);
            let angle = angle(radius);
            [angle.sin() / radius, angle.cos()]
        };
        let pieces: Vec<Piece> = (0..PIECES)
            .map(|n| {
                // The cubic through four places.
                let at = [0.0, 1.0, 2.0, 3.0].map(|k| exact(n as f64 + k / 3.0));
                [0, 1].map(|f| {
                    let [a, b, c, d] = at.map(|v| v[f]);
                    let linear = 0.5 * (-11.0 * a + 18.0 * b - 9.0 * c + 2.0 * d);
                    let square = 4.5 * (2.0 * a - 5.0 * b + 4.0 * c - d);
                    let cube = 4.5 * (-a + 3.0 * b - 3.0 * c + d);
                    [a, linear, square, cube].map(|v| v as f32)
                })
            })
            .collect();
        let profile = Self { plane, reach, pieces };
        // Between the places that the cubics are exact at.
        let is_exact = (0..6 * PIECES).map(|n| (n as f64 + 0.5) / 6.0).all(|place| {
            let ([sine, cosine], radius) = (profile.at(place), place * width);
            let [s, c] = exact(place);
            // Single precision is relative: half a unit in the last place of each number on top.
            let rounded = |v: f64, r: f64| (v - r).abs() <= ERROR + 2.0 * f64::from(f32::EPSILON) * r.abs();
            rounded(sine * radius, s * radius) && rounded(cosine, c)
        });
        is_exact.then_some(profile)
    }

    /// Returns both functions at a place, in pieces from the axis on.
    fn at(&self, place: f64) -> [f64; 2] {
        let n = (place as usize).min(PIECES - 1);
        let t = place - n as f64;
        self.pieces[n].map(|c| c.iter().rev().fold(0.0, |sum, &c| sum * t + f64::from(c)))
    }

    /// Returns the direction through an image point by the table, in the camera's frame; `None` beyond its end.
    #[cfg(test)]
    pub(crate) fn direction(&self, at: DVec2) -> Option<glam::DVec3> {
        let p = self.plane.to_plane * (at - self.plane.centre);
        let [sine, cosine] = self.at(p.length() / self.reach * PIECES as f64);
        (p.length() < self.reach).then(|| (p * sine).extend(cosine))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::Camera;
    use crate::render::camera::fisheye::{equidistant, kannala_brandt};
    use crate::render::camera::lens::Pixels;

    #[test]
    fn tables_hold_directions_in_single_precision() {
        let pixels = Pixels { size: [200, 160], centre: [90.0, 88.0] };
        let bent = kannala_brandt(pixels, [60.0, 70.0], [0.05, -0.01, 0.002, -1e-4]).unwrap();
        let cameras: [&dyn Camera; 3] = [&equidistant(220.0, 1.25).unwrap(), &equidistant(2.0, 1.25).unwrap(), &bent];
        for camera in cameras {
            let Some(Form::Lens(profile)) = camera.form() else { panic!("{camera:?}") };
            for n in 0..2000 {
                let at = DVec2::new(f64::from(n % 50) / 20.0 - 1.25, f64::from(n / 50) / 20.0 - 1.0);
                let exact = camera.ray(at).unwrap().direction;
                let found = profile.direction(at).unwrap();
                assert!((found - exact).length() < 4e-7, "{camera:?} {at}: {found} {exact}");
            }
        }
        assert!(Profile::new(Plane::IMAGE, 1.0, |radius| 1.0 - (1.0 - radius).sqrt()).is_none(), "infinitely steep");
    }
}
