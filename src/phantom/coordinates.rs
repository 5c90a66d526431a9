//! The colon's own coordinates — arc length, angle about the axis, distance from it — and how they change between two positions of
//! the patient.

use glam::DVec3;

use super::centerline::{Centerline, FootPoint};
use super::spline::Spline;

/// A position in the coordinates of a colon.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    /// Arc length, mm.
    pub s: f64,
    /// Angle about the axis, radians.
    pub phi: f64,
    /// Cosine of the angle between the axis' tangent and the offset from the axis: 0 except beyond the two ends.
    pub lean: f64,
    /// Distance from the axis, mm.
    pub rho: f64,
}

impl Place {
    /// Returns the place of a position with this foot point.
    pub(crate) fn at_foot(axis: &Centerline, foot: &FootPoint) -> Self {
        let lean = (foot.offset.dot(foot.tangent) / foot.rho.max(1e-12)).clamp(-1.0, 1.0);
        Self { s: foot.s, phi: axis.angle(foot), lean, rho: foot.rho }
    }

    /// Returns the position, world mm.
    pub(crate) fn position(&self, axis: &Centerline) -> DVec3 {
        let frame = axis.frame(self.s);
        let across = (1.0 - self.lean * self.lean).max(0.0).sqrt();
        frame.at + (frame.tangent * self.lean + frame.direction(self.phi) * across) * self.rho
    }
}

/// A strictly increasing map of arc lengths: a piecewise cubic through pairs of them whose slopes are the weighted harmonic means of
/// the neighbouring secants (Fritsch and Butland 1984), which keeps it monotone.
#[derive(Clone, Debug)]
pub(crate) struct Along {
    from: Vec<f64>,
    to: Vec<f64>,
    slopes: Vec<f64>,
}

impl Along {
    /// Creates the map of `from` to `to`, mm, both strictly increasing and equally long.
    pub(crate) fn new(from: Vec<f64>, to: Vec<f64>) -> Self {
        let last = from.len() - 1;
        let secant = |i: usize| (to[i + 1] - to[i]) / (from[i + 1] - from[i]);
        let slope = |i: usize| {
            if i == 0 || i == last {
                return secant(i.min(last - 1));
            }
            let (h, k) = (from[i] - from[i - 1], from[i + 1] - from[i]);
            let (v, w) = (h + 2.0 * k, 2.0 * h + k);
            3.0 * (h + k) / (v / secant(i - 1) + w / secant(i))
        };
        let slopes = (0..=last).map(slope).collect();
        Self { from, to, slopes }
    }

    /// Returns what `s` is mapped to, mm, and the derivative there. Beyond the ends it is the end's.
    fn jet(&self, s: f64) -> (f64, f64) {
        let s = s.clamp(self.from[0], self.from[self.from.len() - 1]);
        let i = self.from.partition_point(|x| *x <= s).clamp(1, self.from.len() - 1) - 1;
        self.within(i, s)
    }

    /// Returns the value and derivative at `s` of the piece that begins at pair `i`.
    fn within(&self, i: usize, s: f64) -> (f64, f64) {
        let h = self.from[i + 1] - self.from[i];
        let t = (s - self.from[i]) / h;
        let rise = self.to[i + 1] - self.to[i];
        let (m, n) = (self.slopes[i] * h, self.slopes[i + 1] * h);
        let (c, e) = (3.0 * rise - 2.0 * m - n, m + n - 2.0 * rise);
        (self.to[i] + t * (m + t * (c + t * e)), (m + t * (2.0 * c + t * 3.0 * e)) / h)
    }

    /// Returns what `s` is mapped to, mm.
    pub(crate) fn at(&self, s: f64) -> f64 {
        self.jet(s).0
    }

    /// Returns the derivative at `s`: how much the colon is stretched there.
    pub(crate) fn slope(&self, s: f64) -> f64 {
        self.jet(s).1
    }

    /// Returns the arc length that is mapped to `t`, mm, by Newton's method within a shrinking bracket.
    pub(crate) fn back(&self, t: f64) -> f64 {
        let t = t.clamp(self.to[0], self.to[self.to.len() - 1]);
        let i = self.to.partition_point(|x| *x <= t).clamp(1, self.to.len() - 1) - 1;
        let (mut lo, mut hi) = (self.from[i], self.from[i + 1]);
        let mut s = lo + (hi - lo) * (t - self.to[i]) / (self.to[i + 1] - self.to[i]);
        for _ in 0..60 {
            let (value, slope) = self.within(i, s);
            if value < t {
                lo = s;
            } else {
                hi = s;
            }
            let next = s - (value - t) / slope;
            let next = if next > lo && next < hi { next } else { 0.5 * (lo + hi) };
            if (next - s).abs() < 1e-11 {
                return next;
            }
            s = next;
        }
        s
    }
}

/// How a colon's coordinates change from the patient's first to the second position.
#[derive(Clone, Debug)]
pub(crate) struct Motion {
    /// Arc lengths of the first position to those of the second.
    pub along: Along,
    /// By arc length in the second position, radians. x: what is added to φ. y: the turn about the axis that is seen, beyond the
    /// shortest rotation between the axes' tangents.
    pub turn: Spline,
}

impl Motion {
    /// Returns where a place of the first colon is in the second, given the lumen's radius at arc lengths and angles of both.
    pub(crate) fn forth(
        &self,
        place: Place,
        first: impl Fn(f64, f64) -> f64,
        second: impl Fn(f64, f64) -> f64,
    ) -> Place {
        let s = self.along.at(place.s);
        let phi = place.phi + self.turn.jet(s).at.x;
        Place { s, phi, rho: rescaled(place.rho, first(place.s, place.phi), second(s, phi)), ..place }
    }

    /// Does the opposite of [`Motion::forth`].
    pub(crate) fn back(
        &self,
        place: Place,
        first: impl Fn(f64, f64) -> f64,
        second: impl Fn(f64, f64) -> f64,
    ) -> Place {
        let s = self.along.back(place.s);
        let phi = place.phi - self.turn.jet(place.s).at.x;
        Place { s, phi, rho: rescaled(place.rho, second(place.s, place.phi), first(s, phi)), ..place }
    }
}

/// Returns the distance from the axis, mm, in a lumen of radius `to` that belongs to the distance `rho` in one of radius `from`. Up to
/// half the smaller radius from the wall, and outside of it, the distance to the wall is the same; nearer to the axis, distances are
/// scaled.
fn rescaled(rho: f64, from: f64, to: f64) -> f64 {
    let kept = 0.5 * from.min(to);
    if rho >= from - kept { (to + (rho - from)).max(0.0) } else { rho * (to - kept) / (from - kept) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash;

    #[test]
    fn arc_lengths_map_both_ways_and_never_turn_back() {
        for seed in 0..20 {
            let draw = |n: u64| hash::uniform(seed, n);
            let sums = |k: u64| {
                (0..30).scan(0.0, |s, n| Some(std::mem::replace(s, *s + 20.0 + 60.0 * draw(40 * k + n)))).collect()
            };
            let (from, to): (Vec<f64>, Vec<f64>) = (sums(0), sums(1));
            let map = Along::new(from.clone(), to.clone());
            let mut before = f64::NEG_INFINITY;
            for n in 0..=3000 {
                let s = from[29] * f64::from(n) / 3000.0;
                let (t, slope) = map.jet(s);
                assert!(t > before && slope > 0.0, "{seed}: {s} to {t}, slope {slope}");
                assert!((map.back(t) - s).abs() < 1e-9, "{seed}: {s} comes back as {}", map.back(t));
                let h = 1e-6;
                let numeric = (map.at(s + h) - map.at(s - h)) / (2.0 * h);
                assert!(n == 0 || n == 3000 || (numeric - slope).abs() < 1e-4, "{seed}, {s}: {numeric} {slope}");
                before = t;
            }
            assert!((0..30).all(|i| (map.at(from[i]) - to[i]).abs() < 1e-9));
        }
    }

    #[test]
    fn distances_from_the_axis_map_both_ways() {
        for (from, to) in [(15.0, 18.0), (18.0, 15.0), (20.0, 0.2), (0.2, 20.0)] {
            let mut before = -1.0;
            for n in 0..200 {
                let rho = 0.13 * f64::from(n);
                let there = rescaled(rho, from, to);
                assert!(there > before && (rescaled(there, to, from) - rho).abs() < 1e-9, "{rho}: {from} to {to}");
                before = there;
            }
            assert!((rescaled(from - 0.05, from, to) - (to - 0.05)).abs() < 1e-12, "as far from the wall");
        }
    }
}
