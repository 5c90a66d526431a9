//! The rotation as a system to integrate, relative to the free motion, so that everything known exactly stays exact.
//!
//! The orientation is written as `q(t) = exp(θ(t)) R(t)`, where `R` is the body's free, damped motion of [`free`], and the angular
//! momentum as `L(t) = L₀ e^(−k t) + w(t)`. The remainder to integrate starts at zero and does not contain the fast spin (an
//! interaction picture; for the chart see Iserles, Munthe-Kaas, Nørsett and Zanna, *Lie-group methods*, Acta Numerica 2000):
//!
//! ```text
//! θ′ = dexp⁻¹(θ) (ω(q, L) − exp(θ) ω_R)      w′ = T(q) − k w
//! dexp⁻¹(θ) v = v − ½ θ×v + c θ×(θ×v),       c = (1 − (|θ|/2) cot(|θ|/2))/|θ|²
//! ```
//!
//! Every method keeps its order, `q` is a unit quaternion by construction, and without a torque every method is exact.

use std::cell::Cell;

use glam::{DMat3, DQuat, DVec3};

use super::free::{self, exp};
use super::{Inertia, Turning, unit};
use crate::dynamics::integrators::{Blocks, Phase, System};

/// The chart is singular at a turn of 2π relative to the free motion. Beyond this angle its factor is held constant, and
/// all else stays finite.
const FAR: f64 = 6.0;

/// `u = θ` (rad) and `w` (g·mm²/s) as above, over one step.
pub(crate) struct Rotation<'a> {
    /// `T`.
    pub turning: &'a Turning,
    /// `J`.
    pub inertia: Inertia,
    /// `q₀`.
    pub start: DQuat,
    /// `L₀`, world g·mm²/s.
    pub angular: DVec3,
    /// Number of torque evaluations for finite differences, which are not stages of a method.
    pub beside: Cell<u32>,
}

impl<'a> Rotation<'a> {
    /// Creates the rotation that starts at `start`.
    pub(crate) fn new(turning: &'a Turning, inertia: Inertia, start: DQuat, angular: DVec3) -> Self {
        Self { turning, inertia, start, angular, beside: Cell::new(0) }
    }

    /// Returns the orientation and the angular momentum at time `t` for a state of the system.
    pub(crate) fn read(&self, t: f64, y: Phase) -> (DQuat, DVec3) {
        let free = free::turn(self.start, self.angular, &self.inertia, self.turning.drag, t);
        (unit(exp(y.u) * free), self.angular * (-self.turning.drag * t).exp() + y.w)
    }
}

impl System for Rotation<'_> {
    fn rate(&self, t: f64, y: Phase) -> Phase {
        let free = free::turn(self.start, self.angular, &self.inertia, self.turning.drag, t);
        let decayed = self.angular * (-self.turning.drag * t).exp();
        let turn = exp(y.u);
        let q = unit(turn * free);
        let axis = q * DVec3::Z;
        let angular = decayed + y.w;
        // exp(θ) ω_R, with the axis of the free motion rotated too.
        let carried = self.inertia.rate(turn * decayed, axis);
        let u = inverse_dexp(y.u, self.inertia.rate(angular, axis) - carried);
        let torque = self.inertia.momentum(self.turning.acceleration(q), axis);
        Phase { u, w: torque - y.w * self.turning.drag }
    }

    /// By central differences over three angles and three momenta: twelve torques.
    fn jacobian(&self, t: f64, y: Phase) -> Blocks {
        self.beside.set(self.beside.get() + 12);
        let angle = 1e-5 * (1.0 + y.u.length());
        let momentum = angle * (self.inertia.transverse + self.inertia.axial + y.w.length());
        let column = |du: DVec3, dw: DVec3, h: f64| {
            let ahead = self.rate(t, Phase { u: y.u + du, w: y.w + dw });
            let behind = self.rate(t, Phase { u: y.u - du, w: y.w - dw });
            (ahead - behind) * (0.5 / h)
        };
        let axes = [DVec3::X, DVec3::Y, DVec3::Z];
        let by_u = axes.map(|a| column(a * angle, DVec3::ZERO, angle));
        let by_w = axes.map(|a| column(DVec3::ZERO, a * momentum, momentum));
        let block = |c: &[Phase; 3], part: fn(&Phase) -> DVec3| DMat3::from_cols(part(&c[0]), part(&c[1]), part(&c[2]));
        Blocks {
            uu: block(&by_u, |p| p.u),
            uw: block(&by_w, |p| p.u),
            wu: block(&by_u, |p| p.w),
            ww: block(&by_w, |p| p.w),
        }
    }

    fn time_rate(&self, t: f64, y: Phase, scale: f64) -> Phase {
        self.beside.set(self.beside.get() + 2);
        let h = 1e-5 * scale;
        (self.rate(t + h, y) - self.rate(t - h, y)) * (0.5 / h)
    }

    fn drag(&self) -> f64 {
        self.turning.drag
    }

    fn mobility(&self) -> DMat3 {
        self.inertia.inverse(self.start * DVec3::Z)
    }
}

/// `dexp⁻¹(θ) v`.
fn inverse_dexp(theta: DVec3, v: DVec3) -> DVec3 {
    let angle = theta.length().min(FAR);
    let c = if angle < 1e-2 {
        1.0 / 12.0 + angle * angle / 720.0
    } else {
        (1.0 - 0.5 * angle / (0.5 * angle).tan()) / (angle * angle)
    };
    let first = theta.cross(v);
    v - first * 0.5 + theta.cross(first) * c
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_chart_is_that_of_the_exponential() {
        // d/dt exp(θ(t)) = ω^ exp(θ) for θ′ = dexp⁻¹(θ) ω.
        for theta in [DVec3::ZERO, DVec3::new(0.004, 0.001, -0.002), DVec3::new(1.0, -0.7, 2.0)] {
            let omega = DVec3::new(0.3, 1.0, -0.6);
            let h = 1e-6;
            let rate = inverse_dexp(theta, omega);
            let moved = exp(theta + rate * h) * exp(theta - rate * h).conjugate();
            let reported = moved.to_scaled_axis() / (2.0 * h);
            assert!((reported - omega).length() < 1e-6, "{theta}: {reported}");
        }
        assert!(inverse_dexp(DVec3::splat(1e6), DVec3::ONE).is_finite());
    }

    #[test]
    fn without_a_torque_nothing_is_left_to_integrate() {
        let j = Inertia::cylinder(1.0, 1.0, 0.3);
        let r = Rotation::new(&Turning::FREE, j, exp(DVec3::new(0.3, 0.1, 0.0)), DVec3::new(3.0, 1e3, -2e2));
        for t in [0.0, 1e-3, 0.7] {
            let f = r.rate(t, Phase::default());
            assert!(f.u.length() < 1e-9 && f.w == DVec3::ZERO, "{f:?}");
        }
    }

    /// Against differences over a hundred times the interval.
    #[test]
    fn the_rate_changes_with_time_as_the_free_motion_does() {
        let turning = Turning { drag: 0.8, ..Turning::FREE };
        let r = Rotation::new(&turning, Inertia::cylinder(1.0, 1.0, 3.0), DQuat::IDENTITY, DVec3::new(2.0, -1.0, 0.5));
        let y = Phase { u: DVec3::new(0.3, -0.2, 0.4), w: DVec3::new(0.5, 0.1, -0.7) };
        for t in [0.2, 1.0] {
            let h = 1e-3;
            let wide = (r.rate(t + h, y) - r.rate(t - h, y)) * (0.5 / h);
            let rate = r.time_rate(t, y, 1.0);
            assert!((rate.u - wide.u).length() < 1e-5 && (rate.w - wide.w).length() < 1e-5, "{rate:?}, not {wide:?}");
            assert!(rate.u.length() > 1e-2, "{rate:?}");
        }
    }
}
