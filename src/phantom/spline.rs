//! Cubic splines: a B-spline smooths the anatomy's control points, and an interpolating spline on uniform knots is used
//! for all evaluation.

use glam::DVec3;

/// Continuation beyond the ends of a B-spline's control points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Beyond {
    /// Reflects the curve through its end point: no curvature there. Use it for positions.
    PointReflection,
    /// Mirrors the curve: no slope there. Use it for quantities along a curve.
    MirrorImage,
}

/// Evaluates a uniform cubic B-spline at `u` spans from the first control point; `u` runs from 0 to `points.len() - 1`.
///
/// With [`Beyond::PointReflection`] the curve starts at the first and ends at the last control point.
pub(crate) fn b_spline(points: &[DVec3], u: f64, ends: Beyond) -> DVec3 {
    let last = points.len() - 1;
    let at = |i: isize| {
        let beyond = |end: DVec3, inner: DVec3| match ends {
            Beyond::PointReflection => 2.0 * end - inner,
            Beyond::MirrorImage => inner,
        };
        if i < 0 {
            beyond(points[0], points[1])
        } else if i as usize > last {
            beyond(points[last], points[last - 1])
        } else {
            points[i as usize]
        }
    };
    let span = (u.floor() as isize).clamp(0, last as isize - 1);
    let t = u - span as f64;
    let (t2, t3) = (t * t, t * t * t);
    let w = [(1.0 - t).powi(3), 3.0 * t3 - 6.0 * t2 + 4.0, -3.0 * t3 + 3.0 * t2 + 3.0 * t + 1.0, t3];
    (0..4).map(|k| at(span - 1 + k as isize) * w[k]).sum::<DVec3>() / 6.0
}

/// Returns the control points of the B-spline with [`Beyond::PointReflection`] that passes `beside` at whole parameters.
///
/// It starts and ends at its first and last control point; between them p₋ + 4p + p₊ = 6q. Thomas's algorithm solves this tridiagonal
/// system.
pub(crate) fn control_points(beside: &[DVec3]) -> Vec<DVec3> {
    let last = beside.len() - 1;
    let (mut points, mut upper) = (beside.to_vec(), vec![0.0; beside.len()]);
    for i in 1..last {
        let pivot = 1.0 / (4.0 - upper[i - 1]);
        upper[i] = pivot;
        points[i] = (6.0 * beside[i] - points[i - 1]) * pivot;
    }
    for i in (1..last).rev() {
        let next = points[i + 1];
        points[i] -= upper[i] * next;
    }
    points
}

/// A C2 cubic spline through given points on uniform knots, in Hermite form.
#[derive(Clone, Debug)]
pub(crate) struct Spline {
    step: f64,
    points: Vec<DVec3>,
    slopes: Vec<DVec3>,
}

/// A spline's value with its first and second derivative.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Jet {
    /// Value.
    pub at: DVec3,
    /// First derivative.
    pub d1: DVec3,
    /// Second derivative.
    pub d2: DVec3,
}

impl Spline {
    /// Creates the spline through `points`, spaced by `step` in the parameter, with the given end slopes.
    ///
    /// The inner slopes make the second derivative continuous: m₋ + 4m + m₊ = 3(p₊ − p₋)/step. Thomas's algorithm
    /// solves this tridiagonal system.
    pub(crate) fn new(step: f64, points: Vec<DVec3>, first: DVec3, last: DVec3) -> Self {
        let n = points.len();
        let mut slopes = vec![DVec3::ZERO; n];
        let mut upper = vec![0.0; n];
        slopes[0] = first;
        slopes[n - 1] = last;
        for i in 1..n - 1 {
            let right = 3.0 * (points[i + 1] - points[i - 1]) / step;
            let pivot = 1.0 / (4.0 - upper[i - 1]);
            upper[i] = pivot;
            slopes[i] = (right - slopes[i - 1]) * pivot;
        }
        for i in (1..n - 1).rev() {
            let next = slopes[i + 1];
            slopes[i] -= upper[i] * next;
        }
        Self { step, points, slopes }
    }

    /// Returns the interpolated points.
    pub(crate) fn points(&self) -> &[DVec3] {
        &self.points
    }

    /// Returns the knot distance in the parameter.
    pub(crate) fn step(&self) -> f64 {
        self.step
    }

    /// Returns the parameter of the last knot.
    pub(crate) fn end(&self) -> f64 {
        self.step * (self.points.len() - 1) as f64
    }

    /// Returns the value and derivatives at `s`, clamped to the knots' range. Inlined, so that a caller computes only what it uses.
    #[inline(always)]
    pub(crate) fn jet(&self, s: f64) -> Jet {
        let x = (s / self.step).clamp(0.0, (self.points.len() - 1) as f64);
        let i = (x as usize).min(self.points.len() - 2);
        let t = x - i as f64;
        let h = self.step;
        let (p, q) = (self.points[i], self.points[i + 1]);
        let (m, n) = (self.slopes[i] * h, self.slopes[i + 1] * h);
        // p + m t + c t² + e t³
        let c = 3.0 * (q - p) - 2.0 * m - n;
        let e = 2.0 * (p - q) + m + n;
        Jet {
            at: p + t * (m + t * (c + t * e)),
            d1: (m + t * (2.0 * c + t * 3.0 * e)) / h,
            d2: (2.0 * c + 6.0 * t * e) / (h * h),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spline_is_smooth_to_the_second_derivative_and_meets_its_ends() {
        let points: Vec<DVec3> =
            (0..12).map(|i| DVec3::new(f64::from(i * i % 7), f64::from(i % 3), f64::from(i))).collect();
        let s = Spline::new(1.5, points.clone(), DVec3::X, DVec3::Y);
        assert_eq!(s.end(), 16.5, "eleven steps between twelve points");
        for (i, p) in points.iter().enumerate() {
            let x = 1.5 * i as f64;
            assert!((s.jet(x).at - *p).length() < 1e-12);
            let (a, b) = (s.jet(x - 1e-9), s.jet(x + 1e-9));
            assert!((a.d1 - b.d1).length() < 1e-6 && (a.d2 - b.d2).length() < 1e-6, "knot {i}");
        }
        assert!((s.jet(0.0).d1 - DVec3::X).length() < 1e-12 && (s.jet(s.end()).d1 - DVec3::Y).length() < 1e-12);
        let (x, h) = (4.3, 1e-5);
        let d1 = (s.jet(x + h).at - s.jet(x - h).at) / (2.0 * h);
        assert!((d1 - s.jet(x).d1).length() < 1e-8);
    }

    #[test]
    fn control_points_are_found_from_the_curve() {
        let points: Vec<DVec3> =
            (0..9).map(|i| DVec3::new(f64::from(i * i % 7), f64::from(i % 3), f64::from(i))).collect();
        let beside: Vec<DVec3> = (0..9).map(|i| b_spline(&points, f64::from(i), Beyond::PointReflection)).collect();
        for (found, point) in control_points(&beside).iter().zip(&points) {
            assert!((*found - *point).length() < 1e-12, "{found} for {point}");
        }
    }

    #[test]
    fn a_straight_b_spline_stays_straight() {
        let points: Vec<DVec3> = (0..5).map(|i| DVec3::new(f64::from(i), 2.0 * f64::from(i), 0.0)).collect();
        for u in [0.0, 0.3, 1.0, 2.7, 4.0] {
            assert!((b_spline(&points, u, Beyond::PointReflection) - DVec3::new(u, 2.0 * u, 0.0)).length() < 1e-12);
        }
    }
}
