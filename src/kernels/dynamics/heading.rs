//! The direction in which a body has been moving: its velocity's direction, smoothed.

use glam::DVec3;

/// Time constant with which the heading follows the velocity, s.
const HEADING_S: f64 = 0.25;
/// Below this speed the body drifts and its velocity does not indicate where the flight is heading, mm/s.
const LEAST_MM_S: f64 = 2.0;

/// Returns the unit heading after `dt` seconds at `velocity` (world mm/s).
#[doc(hidden)]
pub fn follow_velocity(heading: DVec3, velocity: DVec3, dt: f64) -> DVec3 {
    if velocity.length() <= LEAST_MM_S {
        return heading;
    }
    let share = 1.0 - (-dt / HEADING_S).exp();
    let towards = velocity.normalize();
    (heading + (towards - heading) * share).try_normalize().unwrap_or(towards)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::STEP_S;

    #[test]
    fn follows_and_keeps_what_drifting_does_not_tell() {
        let mut h = DVec3::X;
        for _ in 0..240 {
            h = follow_velocity(h, DVec3::Y * 30.0, STEP_S);
        }
        assert!(h.y > 0.999 && (h.length() - 1.0).abs() < 1e-12);
        assert_eq!(follow_velocity(h, DVec3::NEG_Y, 0.1), h);
        assert_eq!(follow_velocity(DVec3::ZERO, DVec3::Z * 9.0, 0.1), DVec3::Z);
        assert!(
            follow_velocity(DVec3::X, DVec3::NEG_X * 9.0, 0.17328679513998632).is_finite(),
            "half-way of a reversal"
        );
    }
}
