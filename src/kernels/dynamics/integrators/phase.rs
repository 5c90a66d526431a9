//! The state of a system, and the small linear algebra for its derivatives.

use std::ops::{Add, Mul, Sub};

use glam::{DMat3, DVec3};

/// A position (or angle) and a momentum, or their rates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[doc(hidden)]
pub struct Phase {
    /// mm or rad.
    pub u: DVec3,
    /// g·mm/s or g·mm²/s.
    pub w: DVec3,
}

impl Phase {
    /// Returns true if all components are finite.
    pub(crate) fn is_finite(&self) -> bool {
        self.u.is_finite() && self.w.is_finite()
    }

    /// Returns the norm used to measure errors: the larger of `|u|` and `|B w|` times one second, where `B` is the mobility.
    pub(crate) fn norm(&self, mobility: DMat3) -> f64 {
        let (u, w) = (self.u.length(), (mobility * self.w).length());
        // `max` would drop a NaN.
        if u.is_nan() || w.is_nan() { f64::NAN } else { u.max(w) }
    }
}

impl Add for Phase {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self { u: self.u + o.u, w: self.w + o.w }
    }
}

impl Sub for Phase {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        Self { u: self.u - o.u, w: self.w - o.w }
    }
}

impl Mul<f64> for Phase {
    type Output = Self;
    fn mul(self, s: f64) -> Self {
        Self { u: self.u * s, w: self.w * s }
    }
}

/// The derivative of a rate with respect to the state, in blocks: `uw` is `∂u′/∂w`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[doc(hidden)]
pub struct Blocks {
    /// `∂u′/∂u`.
    pub uu: DMat3,
    /// `∂u′/∂w`.
    pub uw: DMat3,
    /// `∂w′/∂u`.
    pub wu: DMat3,
    /// `∂w′/∂w`.
    pub ww: DMat3,
}

impl Blocks {
    /// Returns the product of this matrix and a state.
    pub(crate) fn apply(&self, y: Phase) -> Phase {
        Phase { u: self.uu * y.u + self.uw * y.w, w: self.wu * y.u + self.ww * y.w }
    }

    /// Decomposes `I − g J` for solving. Returns `None` if it is singular or not finite.
    ///
    /// `w` is scaled by the magnitude of the mobility, so masses of 10⁻⁶ g and 10⁶ g are solved equally well.
    pub(crate) fn shifted(&self, g: f64) -> Option<Solver> {
        let scale = self.uw.to_cols_array().iter().fold(0.0f64, |m, x| m.max(x.abs()));
        let scale = if scale > 1e-300 && scale.is_finite() { scale } else { 1.0 };
        let mut a = [[0.0; 6]; 6];
        for r in 0..3 {
            for c in 0..3 {
                let one = f64::from(u8::from(r == c));
                a[r][c] = one - g * self.uu.col(c)[r];
                a[r][c + 3] = -g * self.uw.col(c)[r] / scale;
                a[r + 3][c] = -g * self.wu.col(c)[r] * scale;
                a[r + 3][c + 3] = one - g * self.ww.col(c)[r];
            }
        }
        Solver::new(a, scale)
    }
}

/// A 6×6 matrix, decomposed by Gaussian elimination with row scaling and partial pivoting.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Solver {
    lu: [[f64; 6]; 6],
    rows: [usize; 6],
    weight: [f64; 6],
    scale: f64,
}

impl Solver {
    fn new(mut a: [[f64; 6]; 6], scale: f64) -> Option<Self> {
        let mut weight = [0.0; 6];
        for (row, weight) in a.iter_mut().zip(&mut weight) {
            let most = row.iter().fold(0.0f64, |m, x| m.max(x.abs()));
            // `max` ignores NaN, so each value is checked.
            if !(most > 0.0 && row.iter().all(|x| x.is_finite())) {
                return None;
            }
            *weight = 1.0 / most;
            row.iter_mut().for_each(|x| *x *= *weight);
        }
        let mut rows = [0, 1, 2, 3, 4, 5];
        for k in 0..6 {
            let best = (k..6).max_by(|&i, &j| a[i][k].abs().total_cmp(&a[j][k].abs()))?;
            a.swap(k, best);
            rows.swap(k, best);
            if a[k][k].abs() < 1e-280 {
                return None;
            }
            let pivot = a[k];
            for row in a.iter_mut().skip(k + 1) {
                let f = row[k] / pivot[k];
                row[k] = f;
                for c in k + 1..6 {
                    row[c] -= f * pivot[c];
                }
            }
        }
        Some(Self { lu: a, rows, weight, scale })
    }

    /// Returns the solution for a right-hand side.
    pub(crate) fn solve(&self, b: Phase) -> Phase {
        let w = b.w * self.scale;
        let given = [b.u.x, b.u.y, b.u.z, w.x, w.y, w.z];
        let mut x: [f64; 6] = std::array::from_fn(|r| given[self.rows[r]] * self.weight[self.rows[r]]);
        for r in 0..6 {
            for c in 0..r {
                x[r] -= self.lu[r][c] * x[c];
            }
        }
        for r in (0..6).rev() {
            for c in r + 1..6 {
                x[r] -= self.lu[r][c] * x[c];
            }
            x[r] /= self.lu[r][r];
        }
        Phase { u: DVec3::new(x[0], x[1], x[2]), w: DVec3::new(x[3], x[4], x[5]) * (1.0 / self.scale) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Solves `(I − g J) x = b` for masses over twelve orders of magnitude.
        #[test]
        fn solves(values in prop::collection::vec(-1.0f64..1.0, 30), g in 1e-3f64..1.0, mass in -6.0f64..6.0) {
            let m = |n: usize| DMat3::from_cols_array(&std::array::from_fn(|i| values[(n + i) % 30]));
            let mass = 10f64.powf(mass);
            let j = Blocks { uu: m(0) * 0.3, uw: DMat3::IDENTITY * (1.0 / mass), wu: m(9) * mass, ww: m(18) * 0.3 };
            let b = Phase { u: m(4).x_axis, w: m(13).y_axis * mass };
            if let Some(s) = j.shifted(g) {
                let x = s.solve(b);
                let back = x - j.apply(x) * g;
                let size = 1.0 + x.norm(j.uw);
                prop_assert!((back - b).norm(j.uw) < 1e-9 * size * size, "{back:?} for {b:?}");
            }
        }
    }

    #[test]
    fn what_has_no_solution_has_none() {
        let one = DMat3::IDENTITY;
        let singular = Blocks { uu: one, uw: DMat3::ZERO, wu: DMat3::ZERO, ww: one };
        assert!(singular.shifted(1.0).is_none());
        let broken = Blocks { uu: one * f64::NAN, ..singular };
        assert!(broken.shifted(0.5).is_none());
        assert!(Phase { u: DVec3::NAN, w: DVec3::X }.norm(one).is_nan());
    }
}
