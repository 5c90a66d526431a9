//! Operator input in flight: how a push builds up, how fast the view turns, and how control passes between guide and operator.

use glam::DVec3;

use super::Attitude;

/// Speed that a full push holds against the drag, mm/s. Faster than the guide's cruise speed, so operator input wins.
#[doc(hidden)]
pub const PUSH_MM_S: f64 = 45.0;
/// Least speed multiple that a push is scaled by, so that a slow flight can still be steered.
const LEAST_SPEED: f64 = 0.3;
/// Angular rate of a full turn, rad/s.
const TURN_RATE: f64 = 1.2;
/// Time constant with which a push builds up and decays, s: no hand is faster, and the flight must not jerk.
const PUSH_S: f64 = 0.06;
/// A decaying push below this value counts as zero, mm/s².
const NO_PUSH: f64 = 1e-3;
/// Time in which the guide releases control after operator input starts, s.
const LET_GO_S: f64 = 0.15;
/// Time in which the guide takes control again, s.
const TAKE_UP_S: f64 = 0.8;

/// Returns a push in the world, given its components along the view's right, up and forward axes, each −1 to 1.
#[doc(hidden)]
pub fn push_direction(view: &Attitude, push: DVec3) -> DVec3 {
    view.right() * push.x + view.up * push.y + view.forward * push.z
}

/// Returns the angular velocity (world rad/s) for a turn: yaw to the right, pitch upwards, roll clockwise, each −1 to 1.
#[doc(hidden)]
pub fn turning(view: &Attitude, turn: DVec3) -> DVec3 {
    let turn = turn * TURN_RATE;
    view.right() * turn.y - view.up * turn.x + view.forward * turn.z
}

/// Returns the acceleration from operator input (world mm/s²) after `dt` seconds.
///
/// `before` approaches the value that `push` (see [`push_direction`]) asks for, exponentially. A full push settles at 45
/// mm/s times `speed`, the operator's multiple of the cruise speed, against a drag of `drag_per_s`.
#[doc(hidden)]
pub fn push_acceleration(before: DVec3, push: DVec3, drag_per_s: f64, speed: f64, dt: f64) -> DVec3 {
    let asked = push * (PUSH_MM_S * drag_per_s * speed.max(LEAST_SPEED));
    let after = asked + (before - asked) * (-dt / PUSH_S).exp();
    if asked == DVec3::ZERO && after.length() < NO_PUSH { DVec3::ZERO } else { after }
}

/// Returns the guide's part of the control, 0 to 1, after another `dt` seconds of operator input; 0 after 0.15 s.
#[doc(hidden)]
pub fn let_go(guided: f64, dt: f64) -> f64 {
    (guided + -dt / LET_GO_S).clamp(0.0, 1.0)
}

/// Returns the guide's part of the control, 0 to 1, `dt` seconds later while it takes control again; 1 after 0.8 s.
#[doc(hidden)]
pub fn take_up(guided: f64, dt: f64) -> f64 {
    (guided + dt / TAKE_UP_S).clamp(0.0, 1.0)
}

/// Returns the share of its thrust, 0 to 1, that a guide with the part `guided` of the control may use: eased in and out
/// (smoothstep).
#[doc(hidden)]
pub fn share(guided: f64) -> f64 {
    let g = guided.clamp(0.0, 1.0);
    g * g * (3.0 - 2.0 * g)
}

#[cfg(test)]
mod tests {
    use super::*;

    use crate::dynamics::STEP_S as DT;

    fn after(seconds: f64, mut a: DVec3, push: DVec3) -> DVec3 {
        for _ in 0..(seconds / DT) as usize {
            a = push_acceleration(a, push, 6.0, 1.0, DT);
        }
        a
    }

    #[test]
    fn a_push_builds_up_and_dies_away() {
        let full = after(1.0, DVec3::ZERO, DVec3::X);
        assert!((full.x / 6.0 - 45.0).abs() < 1e-3, "{full}");
        let early = after(0.06, DVec3::ZERO, DVec3::X);
        assert!((early.x / full.x - (1.0 - (-1f64).exp())).abs() < 0.06, "one time constant: {early}");
        assert_eq!(after(2.0, full, DVec3::ZERO), DVec3::ZERO, "exactly none in the end");
        let slow = push_acceleration(DVec3::ZERO, DVec3::X, 6.0, 0.1, 10.0);
        assert!((slow.x / 6.0 - 0.3 * 45.0).abs() < 1e-9);
    }

    #[test]
    fn a_turn_is_about_the_axes_of_the_view() {
        let view = Attitude::new(DVec3::Y, DVec3::Z);
        assert_eq!(view.right(), DVec3::X);
        assert!(turning(&view, DVec3::X).distance(DVec3::NEG_Z * 1.2) < 1e-12, "yaw to the right");
        assert!(turning(&view, DVec3::Y).distance(DVec3::X * 1.2) < 1e-12, "pitch upwards");
        assert!(turning(&view, DVec3::Z).distance(DVec3::Y * 1.2) < 1e-12, "roll clockwise");
        assert_eq!(push_direction(&view, DVec3::new(1.0, 2.0, 3.0)), DVec3::new(1.0, 3.0, 2.0));
    }

    #[test]
    fn the_guide_lets_go_fast_and_comes_back_slowly() {
        let steps = |next: fn(f64, f64) -> f64, from: f64, until: f64| {
            std::iter::successors(Some(from), |g| Some(next(*g, DT))).take_while(|g| *g != until).count()
        };
        assert!((18..=19).contains(&steps(let_go, 1.0, 0.0)), "0.15 s");
        assert!((96..=97).contains(&steps(take_up, 0.0, 1.0)), "0.8 s");
        assert_eq!([share(-1.0), share(0.0), share(0.5), share(1.0), share(2.0)], [0.0, 0.0, 0.5, 1.0, 1.0]);
    }
}
