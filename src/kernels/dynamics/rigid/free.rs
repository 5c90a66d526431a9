//! The free motion of a body with an axis of symmetry, exact for any time and any spin.

use glam::{DQuat, DVec3};

use super::{Inertia, unit};

/// Returns the orientation `seconds` after `start` of a body on which nothing acts but drag.
///
/// Its angular momentum (world, g·mm²/s) decays as `L(t) = L₀ e^(−k t)` with `drag` `k` (1/s).
///
/// `ω = L/J_t + (1/J_a − 1/J_t)(L·a) a` for the axis `a`. Without drag `L` and `L·a` are constant, and the motion is a turn about
/// the body's axis followed by one about `L` (regular precession; Goldstein, *Classical Mechanics*, 5.6): `q(t) = exp(t L/J_t) q₀
/// exp(t (1/J_a − 1/J_t)(L·a) e_z)`. Drag only rescales `L`, so it only slows time down to `s(t) = (1 − e^(−k t))/k`.
pub fn turn(start: DQuat, angular: DVec3, inertia: &Inertia, drag: f64, seconds: f64) -> DQuat {
    let s = slowed(drag, seconds);
    let along = angular.dot(start * DVec3::Z);
    let about_axis = exp(DVec3::Z * (inertia.excess() * along * s));
    unit(exp(angular * (s / inertia.transverse)) * start * about_axis)
}

/// Returns `(1 − e^(−k t))/k`, s: the integral of a decay at rate `k` over the time `t`.
pub(crate) fn slowed(k: f64, t: f64) -> f64 {
    if k * t < 1e-300 { t } else { -(-k * t).exp_m1() / k }
}

/// Returns the rotation by the vector `v` (rad, about its direction); the identity if `v` is not finite.
pub fn exp(v: DVec3) -> DQuat {
    if v.is_finite() { unit(DQuat::from_scaled_axis(v)) } else { DQuat::IDENTITY }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares with the equation `q′ = ½ ω q`, solved in many small steps.
    #[test]
    fn is_the_solution_of_the_equation() {
        for (j, drag) in [
            (Inertia { axial: 1.0, transverse: 3.0 }, 0.0),
            (Inertia { axial: 4.0, transverse: 2.1 }, 0.7),
            (Inertia { axial: 2.0, transverse: 2.0 }, 3.0),
        ] {
            let l0 = DVec3::new(3.0, -1.0, 2.0);
            let (q0, n, t) = (exp(DVec3::new(0.4, 0.2, -1.0)), 20_000, 2.0);
            let mut q = q0;
            let dt = t / f64::from(n);
            for i in 0..n {
                let l = |time: f64| l0 * (-drag * time).exp();
                let time = f64::from(i) * dt;
                let first = j.rate(l(time), q * DVec3::Z);
                let middle = exp(first * (0.5 * dt)) * q;
                q = exp(j.rate(l(time + 0.5 * dt), middle * DVec3::Z) * dt) * q;
            }
            let exact = turn(q0, l0, &j, drag, t);
            assert!(q.angle_between(exact) < 1e-5, "{j:?}: {}", q.angle_between(exact));
        }
    }

    #[test]
    fn spins_of_ten_thousand_radians_a_second_and_thin_bodies() {
        for (r, l) in [(1.0, 2.0), (1e-6, 2.0), (1.0, 1e-6), (1.0, 3f64.sqrt())] {
            let j = Inertia::cylinder(1.0, r, l);
            let q0 = exp(DVec3::new(0.1, 0.2, 0.3));
            let axis = q0 * DVec3::Z;
            let angular = j.momentum((axis + DVec3::new(0.1, 0.0, -0.1)).normalize() * 1e4, axis);
            for t in [1e-6, crate::dynamics::STEP_S, 10.0] {
                let q = turn(q0, angular, &j, 0.0, t);
                assert!((q.length() - 1.0).abs() < 1e-12);
                // Conserved: the momentum along the axis, and so the energy.
                let along = |q: DQuat| angular.dot(q * DVec3::Z) / angular.length();
                assert!((along(q) - along(q0)).abs() < 1e-9, "{r} {l} {t}");
                // A group: two halves make the whole, to the rounding of an angle of 1e5 rad.
                let halves = turn(turn(q0, angular, &j, 0.0, t / 2.0), angular, &j, 0.0, t / 2.0);
                if r > 1e-3 && l > 1e-3 {
                    assert!(q.angle_between(halves) < 1e-7, "{}", q.angle_between(halves));
                }
            }
        }
    }

    #[test]
    fn slowing_has_its_limits() {
        assert_eq!(slowed(0.0, 3.0), 3.0);
        assert!((slowed(1e-20, 3.0) - 3.0).abs() < 1e-12 && (slowed(1e9, 10.0) - 1e-9).abs() < 1e-18);
        assert_eq!(exp(DVec3::NAN), DQuat::IDENTITY);
    }
}
