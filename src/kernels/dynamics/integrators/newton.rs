//! Implicit methods, solved by Newton iteration with the analytic Hessian of the potential.

use super::{Counted, Phase, StepCost, Stepper, System};

/// Maximum number of iterations, and of step halvings in each.
const ITERATIONS: u32 = 20;
const HALVINGS: u32 = 8;
/// How long an error in the momentum keeps moving the body, s: about the time constant of the drag.
const LASTS_S: f64 = 0.05;
/// How often a step is halved if it cannot be solved.
const DEPTH: u32 = 4;

/// `y₁ = y₀ + h f(y₁)`. Order 1, L-stable: motion that a step does not resolve is damped out, in the drag and at the wall alike.
#[doc(hidden)]
pub struct BackwardEuler;

/// `y₁ = y₀ + h f((y₀ + y₁)/2)`. Order 2, A-stable, symplectic.
///
/// Without drag the energy of a smooth well does not drift (Hairer, Lubich and Wanner, *Geometric Numerical Integration*,
/// VI.4). Motion that it does not resolve oscillates undamped.
#[doc(hidden)]
pub struct ImplicitMidpoint;

impl Stepper for BackwardEuler {
    fn step(&self, system: &dyn System, y: Phase, h: f64, cost: &mut StepCost) -> Phase {
        step(system, y, 0.0, h, 1.0, DEPTH, cost)
    }

    fn order(&self) -> u32 {
        1
    }
}

impl Stepper for ImplicitMidpoint {
    fn step(&self, system: &dyn System, y: Phase, h: f64, cost: &mut StepCost) -> Phase {
        step(system, y, 0.0, h, 0.5, DEPTH, cost)
    }

    fn order(&self) -> u32 {
        2
    }
}

/// Solves `Y = y₀ + g h f(t + g h, Y)` and returns `y₁ = y₀ + (Y − y₀)/g`.
///
/// If Newton iteration fails, the step is split into halves. If that fails too, the linearly implicit Euler method is
/// used: `(I − h J) (y₁ − y₀) = h f(y₀)`.
fn step(system: &dyn System, y: Phase, t: f64, h: f64, g: f64, depth: u32, cost: &mut StepCost) -> Phase {
    cost.parts += 1;
    match solve(system, y, t + g * h, g * h, cost) {
        Ok(middle) => y + (middle - y) * (1.0 / g),
        Err(NoSolution) if depth > 0 => {
            let half = step(system, y, t, 0.5 * h, g, depth - 1, cost);
            step(system, half, t + 0.5 * h, 0.5 * h, g, depth - 1, cost)
        }
        Err(NoSolution) => {
            cost.cut_short = true;
            let mut f = Counted::new(system, cost);
            let rate = f.rate(t, y);
            let linear = f.jacobian(t, y).shifted(h).map(|solver| y + solver.solve(rate * h));
            // If that has no solution either, the state stays unchanged for the rest of the step.
            linear.filter(Phase::is_finite).unwrap_or(y)
        }
    }
}

/// Newton iteration did not converge within its limits.
struct NoSolution;

/// Solves `r(Y) = Y − y₀ − s f(t, Y) = 0` by Newton iteration from `y₀`.
///
/// Each iteration solves `(I − s J) δ = −r` and halves the step until the residual falls (Deuflhard, *Newton Methods for
/// Nonlinear Problems*, 3.3). Every loop is bounded.
fn solve(system: &dyn System, start: Phase, t: f64, s: f64, cost: &mut StepCost) -> Result<Phase, NoSolution> {
    let b = system.mobility();
    let mut f = Counted::new(system, cost);
    // In mm (or rad): an error in the momentum is measured by the distance that it moves the body within the step.
    let size = |r: Phase| Phase { u: r.u, w: r.w * s }.norm(b);
    let residual = |f: &mut Counted<'_>, y: Phase| {
        let r = y - start - f.rate(t, y) * s;
        (r, size(r))
    };
    let mut y = start;
    let (mut r, mut least) = residual(&mut f, y);
    for _ in 0..ITERATIONS {
        let Some(solver) = f.jacobian(t, y).shifted(s) else { break };
        let delta = solver.solve(r * -1.0);
        if !delta.is_finite() {
            break;
        }
        // An error in the momentum keeps moving the body after the step. The shorter the step, the less of that shows
        // within it, so the tolerance must be tighter.
        let enough = 1e-12 * (1.0 + y.u.length() + size(y)) * s / (s + LASTS_S);
        let mut share = 1.0;
        let mut better = None;
        for _ in 0..=HALVINGS {
            let to = y + delta * share;
            let (there, left) = residual(&mut f, to);
            if left <= (1.0 - 1e-4 * share) * least || (left.is_finite() && left <= enough) {
                better = Some((to, there, left));
                break;
            }
            share *= 0.5;
        }
        let Some((to, there, left)) = better else {
            // Only rounding error is left.
            if size(delta) <= 1e3 * enough {
                return Ok(y);
            }
            break;
        };
        (y, r, least) = (to, there, left);
        if share == 1.0 && (size(delta) <= enough || least <= enough) {
            return Ok(y);
        }
    }
    Err(NoSolution)
}
