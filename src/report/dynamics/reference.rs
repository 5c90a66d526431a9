//! The reference solution: the fifth-order method of Dormand and Prince with steps so small that only rounding errors remain.
//!
//! It shares coordinates and code with the methods that are measured against it. `tests/bench/independent.rs` compares it with two solvers of diffsol,
//! which share neither: to [`ACCURACY`] with Tsitouras' explicit pair at a tolerance of 1e-13, and to 2e-9 mm and 2e-10 rad with
//! BDF at 1e-11, which is also the difference between those two.

use super::contenders::Fifth;
use crate::dynamics::step::integrate;
use crate::dynamics::{Body, Forces, RigidBodyState, Turning};

/// Steps of the reference per second. With half or twice as many, the error against diffsol stays below 1e-12. No measured method
/// uses this step size: it would match the reference exactly.
pub(crate) const STEPS_PER_SECOND: u32 = 24_000;
/// Required accuracy of the reference, mm and rad. Measured: 6e-13 and 8e-14 for the worst of the three walls.
pub const ACCURACY: [f64; 2] = [1e-11, 1e-12];

/// Steps per second for the orientation. It does not depend on the wall, and steps of this size are exact to 1e-15 rad. With more
/// steps, rounding accumulates to about 6e-14 rad, which affects the smallest errors from which orders are derived.
const TURNS_PER_SECOND: u32 = 1000;

/// Returns the state `seconds` after `start`.
pub fn solve(
    body: &Body,
    start: &RigidBodyState,
    forces: &dyn Forces,
    turning: &Turning,
    seconds: f64,
) -> RigidBodyState {
    let after = |per_second: u32| {
        let steps = (seconds * f64::from(per_second)).round().max(1.0);
        let h = seconds / steps;
        (0..steps as u64).fold(*start, |state, _| integrate(&Fifth, body, &state, forces, turning, h).0)
    };
    let turned = after(TURNS_PER_SECOND);
    RigidBodyState { orientation: turned.orientation, angular: turned.angular, ..after(STEPS_PER_SECOND) }
}
