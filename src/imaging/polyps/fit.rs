//! The ellipsoid that fits a part of the wall best.
//!
//! A point d from the centre is on the ellipsoid where |S d| = 1; S is symmetric, with the reciprocals of the half axes as
//! eigenvalues. The distance of a point is (|S d| − 1) · |S d| / |S² d| to first order (Taubin 1991). The sum of squared
//! distances over [`NOISE_MM`] is least, with Huber's weights against points of something else, plus the squared deviation of
//! S from a multiple of the unit matrix over [`ROUND`], which decides where a small cap does not. Levenberg and Marquardt's
//! method, from the best sphere (Kåsa 1976).

use glam::{DMat3, DVec3};

/// Standard deviation of a point, mm, for one in each [`EACH_MM2`].
const NOISE_MM: f64 = 0.06;
/// Area that counts as one independent point, mm².
const EACH_MM2: f64 = 1.0;
/// Standard deviation of the relative deviation from a sphere.
const ROUND: f64 = 0.3;
/// Points beyond this distance count less, mm.
const HUBER_MM: f64 = 0.2;
/// Steps of the iteration.
const STEPS: usize = 30;

/// An ellipsoid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Ellipsoid {
    /// Its centre, mm.
    pub centre: DVec3,
    /// Its points are where |S (p − centre)| = 1.
    pub s: DMat3,
    /// Root mean square of the distance of the points from it, mm.
    pub rms: f64,
}

impl Ellipsoid {
    /// Fits points with weights (areas, mm²). Returns `None` for fewer than four, points in a plane and values that are not finite.
    /// Points may be `noisy` times as noisy as usual.
    pub(crate) fn fit(points: &[(DVec3, f64)], noisy: f64) -> Option<Self> {
        // Only the weight against the deviation from a sphere matters: less area is as good as more noise.
        let points: &[(DVec3, f64)] = &points.iter().map(|(p, a)| (*p, a / (noisy * noisy))).collect::<Vec<_>>();
        let (centre, radius) = sphere(points)?;
        let mut best = Self { centre, s: DMat3::from_diagonal(DVec3::splat(1.0 / radius)), rms: 0.0 };
        let (mut damping, mut cost) = (1e-3, best.cost(points));
        for _ in 0..STEPS {
            let (matrix, side) = best.normal_equations(points);
            let mut damped = matrix;
            for (n, row) in damped.iter_mut().enumerate() {
                row[n] *= 1.0 + damping;
            }
            let Some(step) = solve(damped, side) else { break };
            let next = best.moved(&step);
            let reached = next.cost(points);
            if reached < cost && next.is_sound() {
                let gain = cost - reached;
                (best, cost, damping) = (next, reached, (damping * 0.3).max(1e-9));
                if gain < 1e-7 * cost {
                    break;
                }
            } else {
                damping *= 8.0;
                if damping > 1e6 {
                    break;
                }
            }
        }
        let weight: f64 = points.iter().map(|p| p.1).sum();
        best.rms = (points.iter().map(|(p, a)| a * best.distance(*p).powi(2)).sum::<f64>() / weight).sqrt();
        best.is_sound().then_some(best)
    }

    /// Returns the distance of a point to first order, mm; negative inside.
    pub(crate) fn distance(&self, p: DVec3) -> f64 {
        let d = p - self.centre;
        let u = self.s * d;
        let (length, steep) = (u.length(), (self.s * u).length());
        if steep > 1e-12 { (length - 1.0) * length / steep } else { -1.0 / self.s.col(0).length().max(1e-9) }
    }

    /// Returns the point of the surface in a direction from the centre.
    pub(crate) fn point(&self, direction: DVec3) -> DVec3 {
        self.centre + direction / (self.s * direction).length().max(1e-9)
    }

    /// Returns the mean of the half axes' reciprocals, inverted, mm.
    pub(crate) fn radius(&self) -> f64 {
        3.0 / (self.s.x_axis.x + self.s.y_axis.y + self.s.z_axis.z)
    }

    fn is_sound(&self) -> bool {
        let trace = 3.0 / self.radius();
        let det = self.s.determinant();
        let minor = self.s.x_axis.x * self.s.y_axis.y - self.s.x_axis.y * self.s.y_axis.x;
        self.centre.is_finite()
            && trace.is_finite()
            && self.s.x_axis.x > 0.0
            && minor > 0.0
            && det > (trace / 3.0).powi(3) * 1e-4
    }

    /// Returns the deviations from a multiple of the unit matrix, relative to it.
    fn uneven(&self) -> [f64; 6] {
        let [a, b, c, d, e, f] = self.entries();
        let mean = (a + b + c) / 3.0;
        [a / mean - 1.0, b / mean - 1.0, c / mean - 1.0, 1.41 * d / mean, 1.41 * e / mean, 1.41 * f / mean]
    }

    /// Returns xx, yy, zz, xy, xz, yz of S.
    fn entries(&self) -> [f64; 6] {
        let s = &self.s;
        [s.x_axis.x, s.y_axis.y, s.z_axis.z, s.x_axis.y, s.x_axis.z, s.y_axis.z]
    }

    fn cost(&self, points: &[(DVec3, f64)]) -> f64 {
        let huber = |r: f64| {
            let r = r.abs();
            if r <= HUBER_MM { r * r } else { 2.0 * HUBER_MM * r - HUBER_MM * HUBER_MM }
        };
        let data: f64 = points.iter().map(|(p, a)| a / EACH_MM2 * huber(self.distance(*p)) / NOISE_MM.powi(2)).sum();
        data + self.uneven().iter().map(|x| x * x / ROUND.powi(2)).sum::<f64>()
    }

    /// Returns the normal equations of the linearised problem, for centre and entries.
    fn normal_equations(&self, points: &[(DVec3, f64)]) -> ([[f64; 9]; 9], [f64; 9]) {
        let (mut matrix, mut side) = ([[0.0; 9]; 9], [0.0; 9]);
        let mut add = |row: &[f64; 9], residual: f64, weight: f64| {
            for i in 0..9 {
                for j in 0..9 {
                    matrix[i][j] += weight * row[i] * row[j];
                }
                side[i] -= weight * row[i] * residual;
            }
        };
        for (p, area) in points {
            let d = *p - self.centre;
            let u = self.s * d;
            let v = self.s * u;
            let (length, steep) = (u.length(), v.length());
            if length < 1e-9 || steep < 1e-9 {
                continue;
            }
            let scale = length / steep;
            let residual = (length - 1.0) * scale;
            let weight = area / EACH_MM2 / NOISE_MM.powi(2) * (HUBER_MM / residual.abs().max(HUBER_MM));
            // Derivatives of |S d|, times the scale.
            let by = scale / length;
            let row = [
                -v.x * by,
                -v.y * by,
                -v.z * by,
                u.x * d.x * by,
                u.y * d.y * by,
                u.z * d.z * by,
                (u.x * d.y + u.y * d.x) * by,
                (u.x * d.z + u.z * d.x) * by,
                (u.y * d.z + u.z * d.y) * by,
            ];
            add(&row, residual, weight);
        }
        let uneven = self.uneven();
        let mean = 1.0 / self.radius();
        for (n, &value) in uneven.iter().enumerate() {
            let mut row = [0.0; 9];
            if n < 3 {
                for m in 0..3 {
                    row[3 + m] = (f64::from(u8::from(m == n)) - (value + 1.0) / 3.0) / mean;
                }
            } else {
                row[3 + n] = 1.41 / mean;
            }
            add(&row, value, 1.0 / ROUND.powi(2));
        }
        (matrix, side)
    }

    fn moved(&self, step: &[f64; 9]) -> Self {
        let e = self.entries();
        let [a, b, c, d, x, f] = std::array::from_fn(|n| e[n] + step[3 + n]);
        let s = DMat3::from_cols(DVec3::new(a, d, x), DVec3::new(d, b, f), DVec3::new(x, f, c));
        Self { centre: self.centre + DVec3::new(step[0], step[1], step[2]), s, rms: 0.0 }
    }
}

/// Returns centre and radius of the sphere that fits best: the linear least squares of |p|² = 2 p · c + (r² − |c|²).
fn sphere(points: &[(DVec3, f64)]) -> Option<(DVec3, f64)> {
    let weight: f64 = points.iter().map(|p| p.1).sum();
    let mean = points.iter().map(|(p, a)| *p * *a).sum::<DVec3>() / weight;
    let (mut matrix, mut side, mut square) = (DMat3::ZERO, DVec3::ZERO, 0.0);
    for (p, a) in points {
        square += a * (*p - mean).length_squared() / weight;
    }
    for (p, a) in points {
        let d = *p - mean;
        matrix += DMat3::from_cols(d * d.x, d * d.y, d * d.z) * (a / weight);
        side += d * (0.5 * a / weight * (d.length_squared() - square));
    }
    let det = matrix.determinant();
    if points.len() < 4 || (det / square.powi(3)).is_nan() || det <= 1e-9 * square.powi(3) {
        return None;
    }
    let centre = matrix.inverse() * side;
    let radius = (square + centre.length_squared()).sqrt();
    (centre.is_finite() && radius.is_finite() && radius > 0.0).then_some((mean + centre, radius))
}

/// Solves a symmetric positive definite system by Cholesky's method.
pub(super) fn solve<const N: usize>(mut a: [[f64; N]; N], mut b: [f64; N]) -> Option<[f64; N]> {
    for j in 0..N {
        for k in 0..j {
            a[j][j] -= a[j][k] * a[j][k];
        }
        if !(a[j][j] > 0.0 && a[j][j].is_finite()) {
            return None;
        }
        a[j][j] = a[j][j].sqrt();
        for i in j + 1..N {
            for k in 0..j {
                a[i][j] -= a[i][k] * a[j][k];
            }
            a[i][j] /= a[j][j];
        }
    }
    for i in 0..N {
        for k in 0..i {
            b[i] -= a[i][k] * b[k];
        }
        b[i] /= a[i][i];
    }
    for i in (0..N).rev() {
        for k in i + 1..N {
            b[i] -= a[k][i] * b[k];
        }
        b[i] /= a[i][i];
    }
    Some(b)
}
