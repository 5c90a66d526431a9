//! The reference solution: the fifth order of Dormand and Prince in steps so small that only rounding is left.
//!
//! It shares coordinates and code with what is measured against it. Tests hold it against two solvers of diffsol, which
//! share neither: to [`ACCURACY`] against Tsitouras' explicit pair at a tolerance of 1e-13, to 2e-9 mm and 2e-10 rad
//! against BDF at 1e-11, which is as near as those two come to each other.

use super::contenders::Fifth;
use crate::dynamics::step::integrate;
use crate::dynamics::{Body, Forces, RigidBodyState, Turning};

/// Steps of the reference a second. With half and with twice as many the error against diffsol stays below 1e-12; not
/// one of the steps that are measured, which would meet the reference exactly.
pub const STEPS_PER_SECOND: u32 = 24_000;
/// What the reference is held to, mm and rad. Measured: 6e-13 and 8e-14 at the worst of the three walls.
pub const ACCURACY: [f64; 2] = [1e-11, 1e-12];

/// The same for the orientation. It does not depend on the wall, and its steps of this size are exact to 1e-15 rad; with more of
/// them, rounding adds up to some 6e-14 rad, which shows in the finest errors that orders are read off.
const TURNS_PER_SECOND: u32 = 1000;

/// The state `seconds` after `start`.
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
