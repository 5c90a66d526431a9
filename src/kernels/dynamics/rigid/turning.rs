//! The torque on the camera: it turns the view towards the path ahead, or as the operator commands.

use glam::{DQuat, DVec3};

/// The cause of the body's rotation, constant during a step.
///
/// The torque is `T = J (ω₀² e(q) + α)` in addition to the drag `−k L`, so the response does not depend on the body's
/// mass or shape (computed torque; Craig, *Introduction to Robotics*, 10.4).
///
/// `e(q)` is the rotation vector (rad) of the smallest turn that takes the view to the target, shortened to `e/√(1 +
/// (|e|/e_max)²)`. With `k = 2 ω₀` the turn is critically damped, and its rate stays below `ω₀ e_max/2`. The smallest
/// turn has no component about the view direction, and drag removes any that exists. The horizon therefore stays where it
/// was (a rotation-minimising frame) and rolls only on operator input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turning {
    /// Unit direction to look in, world; zero if there is none.
    pub target: DVec3,
    /// `ω₀`, rad/s.
    pub stiffness: f64,
    /// `e_max`, rad.
    pub reach: f64,
    /// `k`, 1/s.
    pub drag: f64,
    /// `α`: the angular acceleration from operator input, world rad/s².
    pub push: DVec3,
}

impl Turning {
    /// Nothing turns the body, not even drag.
    pub const FREE: Self = Self { target: DVec3::ZERO, stiffness: 0.0, reach: 1.0, drag: 0.0, push: DVec3::ZERO };

    /// Turns towards `target` (world, any length; zero for none), lagging `tau` s behind a moving target and no faster
    /// than `rate` rad/s. Critically damped: `ω₀ = 2/τ`, `k = 2 ω₀`.
    pub fn towards(target: DVec3, tau: f64, rate: f64) -> Self {
        let w = 2.0 / tau.max(1e-6);
        let target = target.normalize_or_zero();
        Self { target, stiffness: w, reach: 2.0 * rate.max(0.0) / w, drag: 2.0 * w, push: DVec3::ZERO }
    }

    /// Turns at `rate` (world, rad/s) as the operator commands. The drag `k` (1/s) sets how promptly the body responds,
    /// and brings it to rest without input.
    pub fn by_hand(rate: DVec3, drag: f64) -> Self {
        Self { target: DVec3::ZERO, stiffness: 0.0, reach: 1.0, drag, push: rate * drag }
    }

    /// Returns the angular acceleration without the drag, world rad/s².
    pub fn acceleration(&self, q: DQuat) -> DVec3 {
        if self.target == DVec3::ZERO || self.stiffness == 0.0 {
            return self.push;
        }
        let forward = q * DVec3::Z;
        let across = forward.cross(self.target);
        let (sine, cosine) = (across.length(), forward.dot(self.target));
        let angle = sine.atan2(cosine);
        let error = if sine > 1e-9 {
            across * (angle / sine)
        } else if cosine < 0.0 {
            // Directly behind: any axis works; the one along `up` keeps the horizon.
            q * DVec3::Y * angle
        } else {
            DVec3::ZERO
        };
        let short = if self.reach > 0.0 { 1.0 + (angle / self.reach).powi(2) } else { f64::INFINITY };
        self.push + error * (self.stiffness * self.stiffness / short.sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::attitude::Attitude;
    use crate::dynamics::rigid::orientation;

    #[test]
    fn pulls_along_the_least_turn_and_never_rolls() {
        for (f, t) in [(DVec3::X, DVec3::Y), (DVec3::Z, DVec3::new(1.0, 1.0, -1.0)), (DVec3::X, DVec3::NEG_X)] {
            let q = orientation(Attitude::new(f, DVec3::new(0.1, 0.2, 1.0)));
            let turning = Turning::towards(t, 0.45, 1.8);
            let a = turning.acceleration(q);
            assert!(a.dot(q * DVec3::Z).abs() < 1e-9, "no roll: {a}");
            assert!(a.length() > 0.1 && a.length() <= turning.stiffness.powi(2) * turning.reach);
            // The steady rate against the drag stays below the limit.
            assert!(a.length() / turning.drag <= 1.8);
        }
        let q = orientation(Attitude::new(DVec3::X, DVec3::Z));
        assert_eq!(Turning::towards(DVec3::X, 0.45, 1.8).acceleration(q).length(), 0.0);
        for t in [DVec3::ZERO, DVec3::NAN] {
            assert!(Turning::towards(t, 0.0, 1.8).acceleration(q).is_finite());
        }
        assert_eq!(Turning::towards(DVec3::Y, 0.45, 0.0).acceleration(q).length(), 0.0);
    }
}
