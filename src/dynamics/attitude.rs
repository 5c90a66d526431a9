//! Where the camera looks: it turns towards the way ahead at a bounded rate, without rolling more than it must.

use glam::{DQuat, DVec3};

/// An orthonormal view frame in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attitude {
    /// Unit view direction.
    pub forward: DVec3,
    /// Unit up direction, orthogonal to `forward`.
    pub up: DVec3,
}

impl Attitude {
    /// Looks along `forward` with `up` made orthogonal to it; any vectors do, as a fallback takes the place of
    /// degenerate ones (+z up; or +y where the view is along z).
    pub fn new(forward: DVec3, up: DVec3) -> Self {
        let forward = forward.try_normalize().unwrap_or(DVec3::Y);
        let up = [up, DVec3::Z, DVec3::Y]
            .into_iter()
            .map(|u| u.normalize_or_zero())
            .map(|u| u - forward * u.dot(forward))
            .find(|u| u.length() > 1e-4)
            .map_or(DVec3::X, DVec3::normalize);
        Self { forward, up }
    }

    /// Unit vector to the right of the image: `forward × up`.
    pub fn right(&self) -> DVec3 {
        self.forward.cross(self.up)
    }

    /// Turns towards `target` for `dt` seconds: the angle left decays with the time constant `tau`, no faster than
    /// `rate` rad/s. The turn is about `forward × target`, so the frame is parallel-transported along the flight (a
    /// rotation-minimising frame). An exact exponential, so no step is too large for it.
    pub fn turn_towards(&mut self, target: DVec3, tau: f64, rate: f64, dt: f64) {
        let Some(target) = target.try_normalize() else { return };
        let angle = self.forward.angle_between(target);
        let share = if tau > 0.0 { 1.0 - (-dt / tau).exp() } else { 1.0 };
        let turn = (angle * share).min(rate * dt);
        // Also where an angle is no number.
        if turn.is_nan() || turn <= 1e-9 {
            return;
        }
        // Straight behind: any axis does; about `up` keeps the horizon.
        let axis = self.forward.cross(target).try_normalize().unwrap_or(self.up);
        self.rotate(axis, turn);
    }

    /// Rotates by `angle` rad about a unit world axis.
    pub fn rotate(&mut self, axis: DVec3, angle: f64) {
        let q = DQuat::from_axis_angle(axis, angle);
        *self = Self::new(q * self.forward, q * self.up);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orthonormal_whatever_comes_in() {
        for (f, u) in [
            (DVec3::Z, DVec3::Z),
            (DVec3::ZERO, DVec3::ZERO),
            (DVec3::NAN, DVec3::NAN),
            (DVec3::X * 1e9, DVec3::splat(1e-9)),
        ] {
            let a = Attitude::new(f, u);
            assert!((a.forward.length() - 1.0).abs() < 1e-12 && (a.up.length() - 1.0).abs() < 1e-12, "{a:?}");
            assert!(a.forward.dot(a.up).abs() < 1e-12);
        }
    }

    #[test]
    fn turns_at_a_bounded_rate_and_arrives() {
        let mut a = Attitude::new(DVec3::X, DVec3::Z);
        let before = a.forward;
        a.turn_towards(DVec3::NEG_X, 0.1, 2.0, 0.01);
        assert!((a.forward.angle_between(before) - 0.02).abs() < 1e-9);
        for _ in 0..600 {
            a.turn_towards(DVec3::NEG_X, 0.1, 2.0, 0.01);
        }
        assert!(a.forward.angle_between(DVec3::NEG_X) < 1e-6 && a.up.angle_between(DVec3::Z) < 1e-6);
        a.turn_towards(DVec3::Y, 0.1, 1e9, 1e9);
        assert!(a.forward.angle_between(DVec3::Y) < 1e-6, "a huge step does not overshoot");
    }
}
