//! Lenses: cameras whose rays are symmetric about an axis.
//!
//! A point of the image is first moved to the lens's plane: p = M (point − centre), where M removes unequal scales and shear. The angle
//! between its ray and the axis follows from its radius |p| alone, by the [`Curve`] of the lens.

use std::f64::consts::PI;
use std::fmt::Debug;
use std::sync::Arc;

use glam::{DMat2, DVec2, DVec3};

use super::form::{Form, Plane, Profile};
use super::model::{Camera, CameraRay, Origins};
use crate::error::{Error, Result};

/// How the angle between a ray and the axis grows with the radius in the lens's plane.
pub trait Curve: Debug + PartialEq + Send + Sync + 'static {
    /// Returns the radius at which the angle stops growing, or reaches 180°: there are no rays beyond. Infinite if it grows on.
    fn end(&self) -> f64;

    /// Returns the angle at a radius from 0 to [`end`](Curve::end), radians.
    fn angle(&self, radius: f64) -> f64;

    /// Returns the radius at an angle (radians) that some radius up to `reach` has.
    fn radius(&self, angle: f64, reach: f64) -> f64;

    /// Returns the most that the angle grows per radius anywhere from 0 to `reach`, radians. `None` if that has no bound.
    fn steepest(&self, reach: f64) -> Option<f64>;
}

/// How far beyond its corners an image counts as inside, as a share of the radius there: rays of pixels that are moved by a fraction of
/// a pixel.
const BEYOND: f64 = 0.02;

/// A camera with a lens.
///
/// Outside the image for which it was made, and if the curve grows on there, angles grow linearly with the radius from the axis on: where
/// nobody looks, the curve of a calibration is not meant to be used, and may be as steep as it likes.
#[derive(Debug)]
pub struct Lens<C> {
    plane: Plane,
    from_plane: DMat2,
    curve: C,
    /// The radius up to which the curve is used.
    reach: f64,
    /// The angle there, radians.
    angle: f64,
    /// The radius beyond which there are no rays.
    end: f64,
    turn: Option<f64>,
    profile: Option<Arc<Profile>>,
}

impl<C: PartialEq> PartialEq for Lens<C> {
    fn eq(&self, other: &Self) -> bool {
        // All else follows from these.
        (self.plane, &self.curve, self.reach) == (other.plane, &other.curve, other.reach)
    }
}

impl<C: Curve> Lens<C> {
    /// Creates a camera from the `curve` of its lens and the image's half width and height, in halves of its shorter side.
    ///
    /// # Errors
    /// Returns status 2 if the matrix cannot be inverted, or the numbers are too large or too small.
    pub fn new(curve: C, plane: Plane, half: DVec2) -> Result<Self> {
        let from_plane = plane.to_plane.inverse();
        let corner = plane.corner(half) * (1.0 + BEYOND);
        let reach = corner.min(curve.end());
        let angle = curve.angle(reach);
        let numbers = [reach, angle, plane.stretch(), from_plane.determinant(), plane.to_plane.determinant()];
        if !(from_plane.is_finite() && numbers.iter().all(|n| n.is_finite() && *n != 0.0)) {
            let why = "its numbers do not describe a lens: too large, too small, or a stretch without area";
            return Err(Error::usage("camera", why, "give the numbers of a calibration, in pixels"));
        }
        let end = if curve.end() > corner { reach * PI / angle } else { reach };
        let turn = curve.steepest(reach).map(|steepest| steepest * plane.stretch()).filter(|t| t.is_finite());
        // Where directions turn without bound, no table follows them.
        let profile = turn.and_then(|_| Profile::new(plane, reach, |radius| curve.angle(radius)));
        Ok(Self { plane, from_plane, curve, reach, angle, end, turn, profile: profile.map(Arc::new) })
    }

    /// Returns the angle between the axis and the ray at a radius, radians; `None` if there is no ray.
    pub fn angle_at(&self, radius: f64) -> Option<f64> {
        if radius <= self.reach {
            return Some(self.curve.angle(radius));
        }
        (radius <= self.end).then_some(self.angle * (radius / self.reach))
    }

    /// Returns the radius at which a ray has an angle to the axis (radians); `None` if none has it.
    fn radius_at(&self, angle: f64) -> Option<f64> {
        if angle <= self.angle {
            return Some(self.curve.radius(angle, self.reach));
        }
        Some(self.reach * (angle / self.angle)).filter(|&r| r <= self.end)
    }
}

impl<C: Curve> Camera for Lens<C> {
    fn ray(&self, at: DVec2) -> Option<CameraRay> {
        let p = self.plane.to_plane * (at - self.plane.centre);
        let angle = self.angle_at(p.length())?;
        Some(CameraRay { origin: DVec3::ZERO, direction: (p.normalize_or_zero() * angle.sin()).extend(angle.cos()) })
    }

    fn project(&self, place: DVec3) -> Option<DVec2> {
        let across = place.truncate();
        let angle = across.length().atan2(place.z);
        // A place behind the camera, on its axis, is seen all around: any of these points will do.
        let outward = across.try_normalize().unwrap_or(DVec2::X);
        let radius = self.radius_at(angle).filter(|_| place != DVec3::ZERO)?;
        Some(self.plane.centre + self.from_plane * (outward * radius))
    }

    fn origins(&self) -> Origins {
        Origins::One
    }

    /// Along a radius directions turn like the curve. Across it they turn by sin(angle)/radius: at most angle/radius, which is a mean of
    /// the curve's slopes, or the slope beyond its reach, which is such a mean, too.
    fn most_turn(&self) -> Option<f64> {
        self.turn
    }

    fn form(&self) -> Option<Form<'_>> {
        self.profile.as_deref().map(Form::Lens)
    }
}

/// Where pixels lie: the intrinsics of a calibration, in pixels of the image. The first pixel's centre lies at (0, 0), y runs down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixels {
    /// Width and height of the image.
    pub size: [usize; 2],
    /// The pixel that the axis goes through.
    pub centre: [f64; 2],
}

impl Pixels {
    /// Returns half the shorter side, pixels: the unit of image points.
    pub(super) fn unit(&self) -> f64 {
        0.5 * self.size[0].min(self.size[1]) as f64
    }

    /// Returns the image point of the axis.
    pub(super) fn centre(&self) -> DVec2 {
        let [x, y] = [0, 1].map(|a| self.centre[a] + 0.5 - 0.5 * self.size[a] as f64);
        DVec2::new(x, -y) / self.unit()
    }

    /// Returns the image's half width and height, in halves of its shorter side.
    pub(super) fn half(&self) -> DVec2 {
        DVec2::from_array(self.size.map(|s| 0.5 * s as f64)) / self.unit()
    }

    /// Checks the image's size and the centre.
    pub(super) fn check(&self) -> Result<()> {
        if self.size.contains(&0) {
            return Err(Error::usage("image size", "has no pixels", "give WxH in pixels, such as 1024x1024"));
        }
        let [x, y] = self.centre;
        within("cx", x, -MOST..=MOST)?;
        within("cy", y, -MOST..=MOST)
    }
}

/// The largest number that a calibration may hold, and for lengths in pixels the inverse of the least.
pub(super) const MOST: f64 = 1e6;

/// Fails with status 2 unless a number of a calibration is within a range.
pub(super) fn within(name: &str, number: f64, range: std::ops::RangeInclusive<f64>) -> Result<()> {
    if range.contains(&number) {
        return Ok(());
    }
    let why = format!("{name} is {number}, which is not within {} to {}", range.start(), range.end());
    Err(Error::usage("camera", why, "give the numbers of a calibration, in pixels"))
}

/// Fails with status 2 unless a focal length (pixels) is above 0.
pub(super) fn focal(name: &str, length: f64) -> Result<()> {
    within(name, length, 1.0 / MOST..=MOST)
}
