//! One step of the rigid body: integrated by the chosen method, then moved as far as the wall allows.

use glam::DVec3;

use super::advance::{Advance, sweep};
use super::body::Body;
use super::forces::Forces;
use super::integrators::{Phase, StepCost, Stepper};
use super::rigid::rotation::Rotation;
use super::rigid::translation::Translation;
use super::rigid::{RigidBodyState, Turning};
use crate::fields::Clearances;

/// The outcome of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
#[doc(hidden)]
pub struct Step {
    /// New state of the body.
    pub motion: RigidBodyState,
    /// Result of the move along the displacement, limited by the wall.
    pub advance: Advance,
    /// Combined cost of translation and rotation.
    pub cost: StepCost,
}

/// Moves a body by `dt` seconds under `forces` and `turning`, both as given at the start of the step.
///
/// The displacement goes through [`super::advance()`] regardless of what the method returns, so perforation is impossible
/// by construction. The momentum into the wall is lost (inelastic). A wedged body loses all of it: the clearance names one
/// of the walls that hold it, and the momentum into the others would grow without a motion. If a method overflows, the
/// body stays where it is, at rest. A `dt` that is not positive and finite does not move it.
#[doc(hidden)]
pub fn step(
    method: &dyn Stepper,
    body: &Body,
    motion: &RigidBodyState,
    forces: &dyn Forces,
    turning: &Turning,
    walls: &impl Clearances,
    dt: f64,
) -> Step {
    step_reporting(method, body, motion, forces, turning, walls, dt, &mut |_, _| {})
}

/// Does the same as [`step()`] and calls `piece` with the start and end of each straight piece of the path (world mm).
#[expect(clippy::too_many_arguments, reason = "those of `step`, and the callback")]
#[doc(hidden)]
pub fn step_reporting(
    method: &dyn Stepper,
    body: &Body,
    motion: &RigidBodyState,
    forces: &dyn Forces,
    turning: &Turning,
    walls: &impl Clearances,
    dt: f64,
    piece: &mut dyn FnMut(DVec3, DVec3),
) -> Step {
    let (mut next, cost) = integrate(method, body, motion, forces, turning, dt);
    let advance = sweep(walls, motion.position, next.position - motion.position, body.radius_mm, piece);
    next.position = advance.position;
    if let Some(into) = advance.blocked {
        next.momentum -= into * next.momentum.dot(into).max(0.0);
    }
    if advance.stuck || advance.wedged {
        next.momentum = DVec3::ZERO;
    }
    Step { motion: next, advance, cost }
}

/// Steps without walls, for measurements.
#[doc(hidden)]
pub fn integrate(
    method: &dyn Stepper,
    body: &Body,
    motion: &RigidBodyState,
    forces: &dyn Forces,
    turning: &Turning,
    dt: f64,
) -> (RigidBodyState, StepCost) {
    let mut cost = StepCost::default();
    if !(dt.is_finite() && dt > 0.0 && motion.is_finite()) {
        return (*motion, cost);
    }
    let (moved, there) = translate(method, body, motion, forces, dt);
    cost.add(there);
    let (turned, there) = turn(method, body, motion, turning, dt);
    cost.add(there);
    (RigidBodyState { orientation: turned.orientation, angular: turned.angular, ..moved }, cost)
}

/// Moves the centre of mass.
#[doc(hidden)]
pub fn translate(
    method: &dyn Stepper,
    body: &Body,
    motion: &RigidBodyState,
    forces: &dyn Forces,
    dt: f64,
) -> (RigidBodyState, StepCost) {
    let mut cost = StepCost::default();
    let system = Translation { forces, origin: motion.position, mass_g: body.mass_g, drag: body.drag_per_s };
    let y = method.step(&system, Phase { u: DVec3::ZERO, w: motion.momentum }, dt, &mut cost);
    let next = RigidBodyState { position: motion.position + y.u, momentum: y.w, ..*motion };
    let halted = RigidBodyState { momentum: DVec3::ZERO, ..*motion };
    (if next.is_finite() { next } else { halted }, cost)
}

/// Turns the body.
pub(crate) fn turn(
    method: &dyn Stepper,
    body: &Body,
    motion: &RigidBodyState,
    turning: &Turning,
    dt: f64,
) -> (RigidBodyState, StepCost) {
    let mut cost = StepCost::default();
    let system = Rotation::new(turning, body.inertia(), motion.orientation, motion.angular);
    let y = method.step(&system, Phase::default(), dt, &mut cost);
    cost.rates += system.beside.get();
    let (orientation, angular) = system.read(dt, y);
    let next = RigidBodyState { orientation, angular, ..*motion };
    let halted = RigidBodyState { angular: DVec3::ZERO, ..*motion };
    (if next.is_finite() { next } else { halted }, cost)
}
