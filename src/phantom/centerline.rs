//! The colon's axis: a smooth curve with frames through anatomical control points, and the search for the points of the
//! curve nearest to a position.

use std::ops::Range;

use glam::DVec3;

use super::spline::{self, Beyond, Spline, b_spline};
use crate::math::hash;

/// Distance between the curve's knots, mm. Approximate: the length is divided into a whole number of steps.
const KNOT_MM: f64 = 4.0;

/// An anatomical control point of the full-sized colon.
struct Station {
    /// World position, mm LPS; the origin is the middle of the body.
    at: [f64; 3],
    /// Mean radius of the lumen, mm.
    radius: f64,
    /// How triangular the cross-section is, as a fraction of the radius.
    triangle: f64,
    /// Fold spacing relative to the usual one.
    spacing: f64,
}

/// The parts of the colon, and the control point at which each begins.
pub(crate) const PARTS: [(&str, usize); 8] = [
    ("rectum", 0),
    ("sigmoid", 4),
    ("descending", 11),
    ("splenic flexure", 15),
    ("transverse", 17),
    ("hepatic flexure", 22),
    ("ascending", 24),
    ("cecum", 27),
];

const fn station(at: [f64; 3], radius: f64, triangle: f64, spacing: f64) -> Station {
    Station { at, radius, triangle, spacing }
}

/// Control points from rectum to cecum.
const STATIONS: [Station; 29] = [
    // Rectum, along the sacrum.
    station([2.0, 52.0, -156.5], 18.0, 0.0, 1.6),
    station([0.0, 74.0, -128.0], 22.0, 0.0, 1.6),
    station([-3.0, 80.0, -88.0], 21.0, 0.0, 1.5),
    station([2.0, 62.0, -54.0], 17.0, 0.0, 1.2),
    // Sigmoid: up and right, forward and down, then left.
    station([-20.0, 24.0, -38.0], 14.0, 0.01, 1.0),
    station([-42.0, -14.0, -58.0], 13.0, 0.01, 1.0),
    station([-36.0, -52.0, -98.0], 13.0, 0.01, 1.0),
    station([4.0, -66.0, -126.0], 13.5, 0.01, 1.0),
    station([50.0, -48.0, -138.0], 13.0, 0.01, 1.0),
    station([84.0, -6.0, -122.0], 13.5, 0.01, 1.0),
    station([102.0, 38.0, -88.0], 14.5, 0.02, 1.0),
    // Descending.
    station([112.0, 58.0, -40.0], 15.5, 0.02, 1.0),
    station([117.0, 62.0, 10.0], 16.0, 0.03, 1.0),
    station([115.0, 60.0, 60.0], 16.5, 0.03, 1.0),
    station([114.0, 58.0, 104.0], 17.5, 0.04, 1.0),
    // Splenic flexure.
    station([106.0, 40.0, 138.0], 18.0, 0.05, 1.0),
    station([80.0, -2.0, 142.0], 18.0, 0.06, 1.0),
    // Transverse, sagging in front.
    station([62.0, -46.0, 112.0], 17.5, 0.07, 1.0),
    station([44.0, -72.0, 66.0], 17.5, 0.07, 1.0),
    station([6.0, -80.0, 34.0], 18.0, 0.07, 1.0),
    station([-36.0, -78.0, 44.0], 18.5, 0.07, 1.0),
    station([-66.0, -60.0, 80.0], 18.5, 0.06, 1.0),
    // Hepatic flexure.
    station([-86.0, -16.0, 106.0], 19.0, 0.05, 1.0),
    station([-104.0, 30.0, 100.0], 19.5, 0.04, 1.0),
    // Ascending.
    station([-114.0, 54.0, 58.0], 20.5, 0.04, 1.0),
    station([-117.0, 60.0, 8.0], 21.5, 0.04, 1.0),
    station([-114.0, 54.0, -40.0], 23.0, 0.03, 1.1),
    // Cecum.
    station([-104.0, 40.0, -80.0], 25.0, 0.02, 1.2),
    station([-94.0, 24.0, -104.0], 24.0, 0.0, 1.2),
];

/// Quantities that vary slowly along the axis.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Profile {
    /// Mean radius, mm, and its derivative in s.
    pub radius: (f64, f64),
    /// Triangularity (a fraction of the radius) and its derivative in s.
    pub triangle: (f64, f64),
}

/// The axis, parametrised by arc length s in mm from the rectal end.
#[derive(Clone, Debug)]
pub struct Centerline {
    curve: Spline,
    normals: Spline,
    /// x: mean radius, y: triangularity, z: relative fold spacing.
    profile: Spline,
    /// Arc length beside each control point, mm.
    stations: Vec<f64>,
}

/// A point of the axis that is locally nearest to a position.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FootPoint {
    /// Arc length, mm.
    pub s: f64,
    /// Vector from the axis to the position, world mm.
    pub offset: DVec3,
    /// Length of `offset`, mm.
    pub rho: f64,
    /// Unit tangent of the axis, towards the cecum.
    pub tangent: DVec3,
    /// Millimetres at the position for each mm of arc length: 1 − offset · curvature vector.
    pub stretch: f64,
}

/// The axis' local frame: right-handed unit vectors at a point.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// Point of the axis, world mm.
    pub at: DVec3,
    /// Tangent of the axis, towards the cecum.
    pub tangent: DVec3,
    /// Direction of φ = 0; it does not rotate about the axis.
    pub normal: DVec3,
    /// Direction of φ = 90°.
    pub binormal: DVec3,
}

impl Frame {
    /// Returns the unit direction of angle φ.
    pub fn direction(&self, phi: f64) -> DVec3 {
        self.normal * phi.cos() + self.binormal * phi.sin()
    }

    /// Returns the angle φ of a direction.
    pub(crate) fn angle(&self, direction: DVec3) -> f64 {
        direction.dot(self.binormal).atan2(direction.dot(self.normal))
    }
}

impl Centerline {
    /// Creates the axis of an anatomy of `scale` (1 is an adult). `radius` maps an adult's radius to this anatomy's.
    /// Control points move at random by up to `jitter` mm (in the adult).
    pub(crate) fn new(scale: f64, radius: impl Fn(f64) -> f64, jitter: f64, seed: u64) -> Self {
        let (places, profile) = control_points(scale, radius, jitter, seed);
        Self::through(&places, &profile)
    }

    /// Creates the axis near `places` (world mm), which it is drawn to but does not meet; it starts at the first and ends at
    /// the last one. For each place, `profile` holds the radius, mm, the triangularity and the fold spacing.
    pub(crate) fn through(places: &[DVec3], profile: &[DVec3]) -> Self {
        // Measure arc length over the B-spline's parameter by short chords.
        const FINE: usize = 128;
        let count = (places.len() - 1) * FINE;
        let fine: Vec<DVec3> =
            (0..=count).map(|i| b_spline(places, i as f64 / FINE as f64, Beyond::PointReflection)).collect();
        let mut length = vec![0.0; count + 1];
        for i in 0..count {
            length[i + 1] = length[i] + (fine[i + 1] - fine[i]).length();
        }
        let knots = (length[count] / KNOT_MM).round() as usize;
        let step = length[count] / knots as f64;
        let mut j = 0;
        let (mut points, mut along) = (Vec::with_capacity(knots + 1), Vec::with_capacity(knots + 1));
        for i in 0..=knots {
            let s = (i as f64 * step).min(length[count]);
            while j + 1 < count && length[j + 1] < s {
                j += 1;
            }
            let u = (j as f64 + ((s - length[j]) / (length[j + 1] - length[j])).clamp(0.0, 1.0)) / FINE as f64;
            points.push(b_spline(places, u, Beyond::PointReflection));
            along.push(b_spline(profile, u, Beyond::MirrorImage));
        }
        let (first, last) = ((fine[1] - fine[0]).normalize(), (fine[count] - fine[count - 1]).normalize());
        let curve = Spline::new(step, points, first, last);
        let normals = transport(&curve);
        let stations = length.iter().step_by(FINE).copied().collect();
        Self { curve, normals, profile: Spline::new(step, along, DVec3::ZERO, DVec3::ZERO), stations }
    }

    /// Returns the same axis with these arc lengths beside its control points (mm), and the profile that `profile` returns for an
    /// arc length: radius (mm), triangularity and fold spacing.
    pub(crate) fn with_profile(self, stations: Vec<f64>, profile: impl Fn(f64) -> DVec3) -> Self {
        let step = self.curve.step();
        let along = (0..self.knots().len()).map(|i| profile(i as f64 * step)).collect();
        Self { profile: Spline::new(step, along, DVec3::ZERO, DVec3::ZERO), stations, ..self }
    }

    /// Returns the control points that the axis was created through, world mm, if its stations are beside them.
    pub(crate) fn control_points(&self) -> Vec<DVec3> {
        let beside: Vec<DVec3> = self.stations.iter().map(|s| self.at(*s)).collect();
        spline::control_points(&beside)
    }

    /// Returns the length between the centres of the two end caps, mm.
    pub fn length(&self) -> f64 {
        self.curve.end()
    }

    /// Returns the arc length beside each control point, mm.
    pub(crate) fn stations(&self) -> &[f64] {
        &self.stations
    }

    /// Returns the curve's knots, world mm.
    pub(crate) fn knots(&self) -> &[DVec3] {
        self.curve.points()
    }

    /// Returns the arc length between knots, mm.
    pub(crate) fn knot_step(&self) -> f64 {
        self.curve.step()
    }

    /// Returns the mean radius and triangularity at s.
    #[inline]
    pub(crate) fn profile(&self, s: f64) -> Profile {
        let j = self.profile.jet(s);
        Profile { radius: (j.at.x, j.d1.x), triangle: (j.at.y, j.d1.y) }
    }

    /// Returns the mean radius (mm), the triangularity and the fold spacing at s.
    pub(crate) fn profile_at(&self, s: f64) -> DVec3 {
        self.profile.jet(s).at
    }

    /// Returns the fold spacing at s, relative to the usual one.
    pub(crate) fn fold_spacing(&self, s: f64) -> f64 {
        self.profile_at(s).z
    }

    /// Returns the curvature at s, 1/mm.
    pub(crate) fn curvature(&self, s: f64) -> f64 {
        let j = self.curve.jet(s);
        j.d1.cross(j.d2).length() / j.d1.length().powi(3)
    }

    /// Returns the angle φ of a foot point's offset.
    #[inline]
    pub(crate) fn angle(&self, foot: &FootPoint) -> f64 {
        let n = self.normals.jet(foot.s).at;
        // The vectors' lengths do not matter; only the tangential part of the normal has to be removed.
        let normal = n - foot.tangent * n.dot(foot.tangent);
        foot.offset.dot(foot.tangent.cross(normal)).atan2(foot.offset.dot(normal))
    }

    /// Returns the point at s, world mm.
    pub(crate) fn at(&self, s: f64) -> DVec3 {
        self.curve.jet(s).at
    }

    /// Returns the frame at s.
    #[inline]
    pub fn frame(&self, s: f64) -> Frame {
        let j = self.curve.jet(s);
        let tangent = j.d1.normalize();
        let n = self.normals.jet(s).at;
        let normal = (n - tangent * n.dot(tangent)).normalize();
        Frame { at: j.at, tangent, normal, binormal: tangent.cross(normal) }
    }

    /// Collects the runs of knots that are within `more` mm plus their own entry in `reach` of `centre`.
    pub(crate) fn runs_near(&self, centre: DVec3, more: f64, reach: &[f64], out: &mut Vec<Range<usize>>) {
        out.clear();
        for (i, c) in self.knots().iter().enumerate() {
            let r = more + reach[i];
            if (centre - *c).length_squared() <= r * r {
                match out.last_mut() {
                    Some(run) if run.end == i => run.end = i + 1,
                    _ => out.push(i..i + 1),
                }
            }
        }
    }

    /// Calls `found` with the foot points of `p`: one for each knot of `run` that is nearer than both its neighbours
    /// and within its entry in `reach`, mm.
    #[inline]
    pub(crate) fn feet(&self, p: DVec3, run: Range<usize>, reach: &[f64], mut found: impl FnMut(FootPoint)) {
        let knots = self.knots();
        let far = |i: usize| knots.get(i).map_or(f64::INFINITY, |c| (p - *c).length_squared());
        let mut before = if run.start > 0 { far(run.start - 1) } else { f64::INFINITY };
        let mut here = far(run.start);
        for i in run {
            let after = far(i + 1);
            if before >= here && here < after && here <= reach[i] * reach[i] {
                found(self.foot(p, i, [before, here, after]));
            }
            (before, here) = (here, after);
        }
    }

    /// Returns the foot point that belongs to knot `i`, given the squared distances of the knot and its neighbours.
    ///
    /// Solves (p − c(s)) · c'(s) = 0 with Newton's method, starting from the parabola through the three squared
    /// distances. If the foot would be beyond an end of the curve, that end is returned (the caps).
    fn foot(&self, p: DVec3, i: usize, [before, here, after]: [f64; 3]) -> FootPoint {
        let h = self.curve.step();
        let mut s = i as f64 * h;
        if before.is_finite() && after.is_finite() {
            s += 0.5 * h * (before - after) / (before - 2.0 * here + after);
        }
        let (lo, hi) = ((s - 1.5 * h).max(0.0), (s + 1.5 * h).min(self.length()));
        let mut j = self.curve.jet(s);
        for _ in 0..6 {
            let w = p - j.at;
            let slope = j.d1.length_squared() - w.dot(j.d2);
            let next = (s + w.dot(j.d1) / slope.max(0.1)).clamp(lo, hi);
            let moved = next - s;
            s = next;
            j = self.curve.jet(s);
            // The remaining error is below moved² · curvature, 10⁻⁹ mm.
            if moved.abs() < 1e-4 {
                break;
            }
        }
        let offset = p - j.at;
        let stretch = (j.d1.length_squared() - offset.dot(j.d2)).max(0.2);
        FootPoint { s, offset, rho: offset.length(), tangent: j.d1.normalize(), stretch }
    }
}

/// Returns the control points of [`Centerline::new`] and their profile, for [`Centerline::through`].
pub(crate) fn control_points(
    scale: f64,
    radius: impl Fn(f64) -> f64,
    jitter: f64,
    seed: u64,
) -> (Vec<DVec3>, Vec<DVec3>) {
    let draw = |i: usize, k: u64| 2.0 * hash::uniform(seed, 16 * i as u64 + k) - 1.0;
    let places = (STATIONS.iter().enumerate())
        .map(|(i, s)| (DVec3::from_array(s.at) + jitter * DVec3::new(draw(i, 0), draw(i, 1), draw(i, 2))) * scale)
        .collect();
    let profile = (STATIONS.iter().enumerate())
        .map(|(i, s)| DVec3::new(radius(s.radius) * (1.0 + 0.008 * jitter * draw(i, 3)), s.triangle, s.spacing))
        .collect();
    (places, profile)
}

/// Transports normals along the curve without rotation, by the double reflection method (Wang, Jüttler, Zheng, Liu
/// 2008). The first normal faces anterior.
fn transport(curve: &Spline) -> Spline {
    let step = curve.step();
    let count = curve.points().len();
    let tangent = |i: usize| curve.jet(i as f64 * step).d1.normalize();
    let mut t = tangent(0);
    let mut n = (DVec3::NEG_Y - t * DVec3::NEG_Y.dot(t)).normalize();
    let mut normals = vec![n];
    for i in 1..count {
        let v1 = curve.points()[i] - curve.points()[i - 1];
        let c1 = v1.length_squared();
        let (n_l, t_l) = (n - v1 * (2.0 / c1 * v1.dot(n)), t - v1 * (2.0 / c1 * v1.dot(t)));
        t = tangent(i);
        let v2 = t - t_l;
        let c2 = v2.length_squared();
        n = if c2 > 1e-24 { n_l - v2 * (2.0 / c2 * v2.dot(n_l)) } else { n_l };
        n = (n - t * n.dot(t)).normalize();
        normals.push(n);
    }
    let slope = |i: usize, n: DVec3| {
        let j = curve.jet(i as f64 * step);
        -j.d1 * n.dot(j.d2)
    };
    let (first, last) = (slope(0, normals[0]), slope(count - 1, n));
    Spline::new(step, normals, first, last)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis() -> Centerline {
        Centerline::new(1.0, |r| r, 3.0, 5)
    }

    #[test]
    fn the_parameter_is_arc_length_and_frames_do_not_rotate() {
        let c = axis();
        let mut s = 0.5;
        while s < c.length() - 1.0 {
            let j = c.curve.jet(s);
            assert!((j.d1.length() - 1.0).abs() < 2e-3, "{s}: {}", j.d1.length());
            let (a, b) = (c.frame(s), c.frame(s + 0.01));
            assert!(((b.normal - a.normal).dot(a.binormal) / 0.01).abs() < 2e-3, "rotation at {s}");
            assert!((a.tangent.cross(a.normal) - a.binormal).length() < 1e-12);
            s += 3.7;
        }
    }

    #[test]
    fn the_foot_is_where_the_place_was_put() {
        let c = axis();
        for n in 0..400 {
            let s = 2.0 + (c.length() - 4.0) * hash::uniform(1, n);
            let f = c.frame(s);
            let p = f.at + f.direction(6.0 * hash::uniform(2, n)) * (1.0 + 12.0 * hash::uniform(3, n));
            let mut best: Option<FootPoint> = None;
            let reach = vec![40.0; c.knots().len()];
            c.feet(p, 0..c.knots().len(), &reach, |f| {
                if best.is_none_or(|b| f.rho < b.rho) {
                    best = Some(f);
                }
            });
            let best = best.unwrap();
            assert!((best.s - s).abs() < 1e-6, "{} for {s}", best.s);
        }
    }

    /// The outermost knots have one neighbour each, so the search starts at the knot, up to half a step from the foot.
    #[test]
    fn feet_are_found_up_to_both_ends() {
        let c = axis();
        let reach = vec![40.0; c.knots().len()];
        let end = c.length();
        for s in [0.0, 0.5, 1.5, end - 1.5, end - 0.5, end] {
            let f = c.frame(s);
            let p = f.at + f.direction(1.0) * 8.0;
            let mut nearest = (f64::INFINITY, f64::NAN);
            c.feet(p, 0..c.knots().len(), &reach, |foot| {
                if foot.rho < nearest.0 {
                    nearest = (foot.rho, foot.s);
                }
            });
            assert!((nearest.1 - s).abs() < 1e-6, "{} for {s} of {end}", nearest.1);
        }
    }
}
