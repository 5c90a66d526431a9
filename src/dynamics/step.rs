//! One step of the rigid body: integrated by whichever method, and moved as far as the wall allows.

use glam::DVec3;

use super::advance::{Advance, sweep};
use super::body::Body;
use super::forces::Forces;
use super::integrators::{Effort, Method, Phase};
use super::rigid::rotation::Rotation;
use super::rigid::translation::Translation;
use super::rigid::{Motion, Turning};
use crate::fields::Clearances;

/// The outcome of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Where the body came to and how it moves.
    pub motion: Motion,
    /// What the wall had to say.
    pub advance: Advance,
    /// What it took, translation and rotation together.
    pub effort: Effort,
}

/// Moves a body by `dt` seconds under `forces` and `turning`, both as they are at the beginning of the step.
///
/// The displacement goes through [`super::advance()`], whatever the method told: perforation is impossible by construction. What
/// of the momentum went into the wall is gone (inelastic). A method that overflows leaves the body where it is, at rest;
/// a `dt` that is not positive and finite does not move it.
pub fn step(
    method: &dyn Method,
    body: &Body,
    motion: &Motion,
    forces: &dyn Forces,
    turning: &Turning,
    walls: &impl Clearances,
    dt: f64,
) -> Step {
    step_told(method, body, motion, forces, turning, walls, dt, &mut |_, _| {})
}

/// [`step()`], telling each straight piece of the way (world mm), from its beginning to its end.
#[expect(clippy::too_many_arguments, reason = "those of `step`, and who is told")]
pub fn step_told(
    method: &dyn Method,
    body: &Body,
    motion: &Motion,
    forces: &dyn Forces,
    turning: &Turning,
    walls: &impl Clearances,
    dt: f64,
    piece: &mut dyn FnMut(DVec3, DVec3),
) -> Step {
    let (mut next, effort) = integrate(method, body, motion, forces, turning, dt);
    let advance = sweep(walls, motion.position, next.position - motion.position, body.radius_mm, piece);
    next.position = advance.position;
    if let Some(into) = advance.blocked {
        next.momentum -= into * next.momentum.dot(into).max(0.0);
    }
    if advance.stuck {
        next.momentum = DVec3::ZERO;
    }
    Step { motion: next, advance, effort }
}

/// The step without walls, for measurements.
pub fn integrate(
    method: &dyn Method,
    body: &Body,
    motion: &Motion,
    forces: &dyn Forces,
    turning: &Turning,
    dt: f64,
) -> (Motion, Effort) {
    let mut effort = Effort::default();
    if !(dt.is_finite() && dt > 0.0 && motion.is_finite()) {
        return (*motion, effort);
    }
    let (moved, there) = translate(method, body, motion, forces, dt);
    effort.add(there);
    let (turned, there) = turn(method, body, motion, turning, dt);
    effort.add(there);
    (Motion { orientation: turned.orientation, angular: turned.angular, ..moved }, effort)
}

/// The part of the step that moves the centre of mass.
pub fn translate(method: &dyn Method, body: &Body, motion: &Motion, forces: &dyn Forces, dt: f64) -> (Motion, Effort) {
    let mut effort = Effort::default();
    let system = Translation { forces, origin: motion.position, mass_g: body.mass_g, drag: body.drag_per_s };
    let y = method.step(&system, Phase { u: DVec3::ZERO, w: motion.momentum }, dt, &mut effort);
    let next = Motion { position: motion.position + y.u, momentum: y.w, ..*motion };
    let halted = Motion { momentum: DVec3::ZERO, ..*motion };
    (if next.is_finite() { next } else { halted }, effort)
}

/// The part of the step that turns the body.
pub fn turn(method: &dyn Method, body: &Body, motion: &Motion, turning: &Turning, dt: f64) -> (Motion, Effort) {
    let mut effort = Effort::default();
    let system = Rotation::new(turning, body.inertia(), motion.orientation, motion.angular);
    let y = method.step(&system, Phase::default(), dt, &mut effort);
    effort.rates += system.beside.get();
    let (orientation, angular) = system.read(dt, y);
    let next = Motion { orientation, angular, ..*motion };
    let halted = Motion { angular: DVec3::ZERO, ..*motion };
    (if next.is_finite() { next } else { halted }, effort)
}
