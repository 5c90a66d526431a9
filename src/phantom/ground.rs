//! The surface on which lesions and decoys are placed, and what is taken there already.

use std::ops::Range;

use glam::DVec3;

use super::centerline::FootPoint;
use super::shape::Shape;
use super::solid::Surface;

/// Least distance between the surfaces of lesions and decoys, mm.
pub(crate) const APART_MM: f64 = 12.0;

/// A place on the surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spot {
    /// World mm.
    pub at: DVec3,
    /// Unit normal into the lumen.
    pub up: DVec3,
    /// Arc length of its foot point, mm.
    pub s: f64,
}

/// A shape, searched around known arc lengths.
pub(crate) struct Ground<'a> {
    pub shape: &'a Shape,
    reach: Vec<f64>,
}

impl<'a> Ground<'a> {
    pub(crate) fn new(shape: &'a Shape) -> Self {
        Self { shape, reach: shape.reach() }
    }

    /// Returns the knots within 45 mm of arc length `s`.
    fn knots(&self, s: f64) -> Range<usize> {
        let step = self.shape.axis.knot_step();
        let last = self.shape.axis.knots().len();
        (((s - 45.0) / step).max(0.0) as usize).min(last - 1)..(((s + 45.0) / step).max(1.0) as usize).min(last)
    }

    /// Returns the foot point of `p` in the loop around arc length `s`.
    pub(crate) fn foot(&self, p: DVec3, s: f64) -> Option<FootPoint> {
        let mut best: Option<FootPoint> = None;
        self.shape.axis.feet(p, self.knots(s), &self.reach, |f| {
            if best.is_none_or(|b| f.rho < b.rho) {
                best = Some(f);
            }
        });
        best
    }

    /// Returns the unsaturated surface at `p` in the loop around arc length `s`.
    pub(crate) fn surface(&self, p: DVec3, s: f64) -> Option<Surface> {
        self.foot(p, s).map(|foot| self.shape.surface(p, &foot))
    }

    /// Returns the place where the surface is met from `from`, in the lumen, along the unit vector `along`.
    pub(crate) fn cast(&self, from: DVec3, along: DVec3, s: f64) -> Option<Spot> {
        let mut t = 0.0;
        for _ in 0..60 {
            let p = from + along * t;
            let foot = self.foot(p, s)?;
            let here = self.shape.surface(p, &foot);
            if here.d > -1e-4 {
                return (t > 0.0).then_some(Spot { at: p, up: -here.normal, s: foot.s });
            }
            t += (-0.9 * here.d).max(2e-4);
        }
        None
    }

    /// Returns the place on the surface at arc length `s` and angle `phi`, seen from the axis.
    pub(crate) fn spot(&self, s: f64, phi: f64) -> Option<Spot> {
        let frame = self.shape.axis.frame(s);
        let out = frame.direction(phi);
        self.cast(frame.at + out, out, s)
    }

    /// Returns the least distance between the axis around arc length `s` and a surface, mm.
    pub(crate) fn clear_of_axis(&self, s: f64, surface: impl Fn(DVec3) -> Surface) -> f64 {
        let end = self.shape.axis.length();
        let places = (-15..=15).map(|i| (s + 2.0 * f64::from(i)).clamp(0.0, end));
        places.map(|s| -surface(self.shape.axis.frame(s).at).d).fold(f64::INFINITY, f64::min)
    }
}

/// Balls that are taken: centres (world mm) and radii (mm).
#[derive(Clone, Debug, Default)]
pub(crate) struct Taken(Vec<(DVec3, f64)>);

impl Taken {
    /// Returns true if balls are at least [`APART_MM`] away from all that is taken.
    pub(crate) fn has_room_for(&self, balls: &[(DVec3, f64)]) -> bool {
        balls.iter().all(|(c, r)| self.0.iter().all(|(d, q)| c.distance(*d) - r - q >= APART_MM))
    }

    /// Takes balls.
    pub(crate) fn take(&mut self, balls: impl IntoIterator<Item = (DVec3, f64)>) {
        self.0.extend(balls);
    }
}
