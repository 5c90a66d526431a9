//! Shapes of lesions, as signed distances to their surfaces.

use std::f64::consts::TAU;

use glam::{DMat3, DVec3};

use super::draw;
use crate::math::hash::Stream;
use crate::math::smooth;
use crate::math::sphere::directions;
use crate::phantom::{PolypShape, PolypSite, TruePolyp};

/// Fillet between a lesion and its wall, and between a head and its stalk, mm.
const FILLET_MM: f64 = 1.2;
const JOINT_MM: f64 = 2.0;
/// Waves that make a surface uneven, and how far they move it together, shares of the radius.
const WAVES: usize = 5;
const UNEVEN: f64 = 0.06;
/// Points of a head's surface among which the largest diameter is sought.
const POINTS: usize = 600;

/// Where a lesion grows: the place on the wall, and the unit vector into the lumen. World, mm.
#[derive(Clone, Copy, Debug)]
pub(super) struct Root {
    pub(super) place: DVec3,
    pub(super) up: DVec3,
    pub(super) site: PolypSite,
}

/// A lesion.
#[derive(Clone, Debug)]
pub(super) struct Form {
    pub(super) shape: PolypShape,
    pub(super) root: Root,
    /// Middle of the head; of a flat one, the root.
    head: DVec3,
    /// Directions of the half axes, and the half axes, mm. The third one is that of a flat lesion's height.
    axes: DMat3,
    radii: DVec3,
    /// Radius of the stalk, mm.
    stalk_mm: f64,
    /// Wave vectors and phases.
    waves: [(DVec3, f64); WAVES],
}

impl Form {
    /// Draws a lesion with about this diameter, mm.
    pub(super) fn drawn(shape: PolypShape, diameter_mm: f64, root: Root, draw: &mut Stream) -> Self {
        let radius = 0.5 * diameter_mm;
        let lean = (root.up + 0.25 * draw::direction(draw)).normalize();
        let (u, w) = lean.any_orthonormal_pair();
        let (sin, cos) = draw.within(0.0, TAU).sin_cos();
        let axes = DMat3::from_cols(u * cos + w * sin, w * cos - u * sin, lean);
        let waves = std::array::from_fn(|_| (draw::direction(draw) * draw.within(1.5, 4.0), draw.within(0.0, TAU)));
        let across = radius * draw.within(0.8, 1.0);
        let (radii, head, stalk_mm) = match shape {
            PolypShape::Flat => {
                let axes_mm = DVec3::new(radius, across, draw.within(1.6, 3.0).min(0.6 * radius));
                return Self {
                    shape,
                    root,
                    head: root.place,
                    axes: upright(root.up, &axes),
                    radii: axes_mm,
                    stalk_mm: 0.0,
                    waves,
                };
            }
            PolypShape::Stalked => {
                let high = radius * draw.within(0.8, 1.0);
                let stalk = draw.within(2.0, 7.0);
                let bent = (root.up + 0.3 * draw::direction(draw)).normalize();
                (DVec3::new(radius, across, high), root.place + bent * (stalk + high), draw.within(1.2, 1.8))
            }
            _ => {
                let high = radius * draw.within(0.7, 1.0);
                (DVec3::new(radius, across, high), root.place + root.up * (high * draw.within(0.05, 0.5)), 0.0)
            }
        };
        Self { shape, root, head, axes, radii, stalk_mm, waves }
    }

    /// Returns the distance from the root within which all of the lesion is, mm.
    pub(super) fn reach_mm(&self) -> f64 {
        self.head.distance(self.root.place) + (1.0 + UNEVEN) * self.radii.max_element() + FILLET_MM
    }

    /// Returns how high the lesion reaches above its root, mm.
    pub(super) fn top_mm(&self) -> f64 {
        (self.head - self.root.place).dot(self.root.up) + (1.0 + UNEVEN) * self.radii.z
    }

    /// Returns a number that is below 0 in the lesion and rises by about 1 per mm outwards, at a place (world, mm) that is `wall_mm` from
    /// the wall, in the lumen. It does not count the wall itself.
    pub(super) fn distance(&self, place: DVec3, wall_mm: f64) -> f64 {
        if self.shape == PolypShape::Flat {
            return self.plaque(place, wall_mm);
        }
        let own = match self.stalk_mm > 0.0 {
            true => smooth::min(self.ball(place), self.stalk(place), JOINT_MM),
            false => self.ball(place),
        };
        let fillet = (FILLET_MM - (own - wall_mm).abs()).max(0.0).powi(2) / (4.0 * FILLET_MM);
        match own <= wall_mm {
            true => own - fillet,
            false if fillet > 0.0 => wall_mm - fillet,
            false => own,
        }
    }

    fn ball(&self, place: DVec3) -> f64 {
        let d = self.axes.transpose() * (place - self.head);
        let u = d / self.radii;
        let (length, steep) = (u.length(), (u / self.radii).length());
        if length < 1e-9 {
            return -self.radii.min_element();
        }
        (length - self.uneven(u / length)) * length / steep
    }

    fn stalk(&self, place: DVec3) -> f64 {
        let (from, to) = (self.root.place - self.root.up * 1.0, self.head);
        let t = ((place - from).dot(to - from) / (to - from).length_squared()).clamp(0.0, 1.0);
        place.distance(from + (to - from) * t) - self.stalk_mm
    }

    /// A plaque follows the wall: its height falls from the middle to the rim.
    fn plaque(&self, place: DVec3, wall_mm: f64) -> f64 {
        let d = self.axes.transpose() * (place - self.root.place);
        // On the face of a fold, the way from the root along the wall is down, too.
        let down = d.z - wall_mm.clamp(0.0, self.radii.z);
        let off = DVec3::new(d.x / self.radii.x, d.y / self.radii.y, down / self.radii.x);
        let share = off.length() / self.uneven(off.with_z(0.0).normalize_or_zero());
        if share >= 1.0 {
            return 1.0 + self.radii.y * (share - 1.0).max(0.0);
        }
        let high = self.radii.z * (1.0 - share.powi(4));
        let slope = self.radii.z * 4.0 * share.powi(3) / self.radii.y;
        (wall_mm - high) / (1.0 + slope * slope).sqrt()
    }

    /// Returns the radius in a direction, shares of that of the smooth shape.
    fn uneven(&self, direction: DVec3) -> f64 {
        1.0 + UNEVEN / WAVES as f64 * self.waves.iter().map(|(k, phase)| (k.dot(direction) + phase).sin()).sum::<f64>()
    }

    /// Returns the truth that needs no wall. `is_free` tells whether a place (world, mm) is in the lumen.
    pub(super) fn truth(&self, is_free: impl Fn(DVec3) -> bool) -> TruePolyp {
        let (shape, site) = (self.shape, self.root.site);
        let on = |d: DVec3| self.head + self.axes * (d * self.radii * self.uneven(d));
        let points: Vec<DVec3> = match shape {
            PolypShape::Flat => (0..POINTS)
                .map(|n| {
                    let (sin, cos) = (TAU * n as f64 / POINTS as f64).sin_cos();
                    on(DVec3::new(cos, sin, 0.0))
                })
                .collect(),
            _ => directions(POINTS).map(on).filter(|p| is_free(*p)).collect(),
        };
        let position = match shape {
            PolypShape::Flat => self.root.place + self.root.up * (0.5 * self.radii.z),
            _ => self.head,
        };
        TruePolyp { position, diameter_mm: widest(&points), shape, site, ..TruePolyp::default() }
    }
}

/// Turns axes so that the third one is `up`.
fn upright(up: DVec3, axes: &DMat3) -> DMat3 {
    let u = axes.x_axis.reject_from_normalized(up).normalize();
    DMat3::from_cols(u, up.cross(u), up)
}

fn widest(points: &[DVec3]) -> f64 {
    let mut most = 0.0;
    for (n, a) in points.iter().enumerate() {
        most = points[n + 1..].iter().map(|b| a.distance_squared(*b)).fold(most, f64::max);
    }
    most.sqrt()
}
