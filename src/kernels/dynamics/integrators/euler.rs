//! Euler methods (Hairer, Lubich and Wanner, *Geometric Numerical Integration*, I.1).

use super::{Counted, Phase, StepCost, Stepper, System};

/// `y₁ = y₀ + h f(y₀)`. Order 1.
///
/// Gains energy in every well: for `x″ = −ω² x − k x′` it is stable only for `h < k/ω²` (if `k < 2ω`), so never without drag.
#[doc(hidden)]
pub struct ExplicitEuler;

impl Stepper for ExplicitEuler {
    fn step(&self, system: &dyn System, y: Phase, h: f64, cost: &mut StepCost) -> Phase {
        cost.parts += 1;
        y + Counted::new(system, cost).rate(0.0, y) * h
    }

    fn order(&self) -> u32 {
        1
    }
}

/// `w₁ = w₀ + h w′(u₀, w₀)`, `u₁ = u₀ + h u′(u₀, w₁)`. Order 1.
///
/// Symplectic without drag, so the energy oscillates but does not drift. Stable for `h < 2/ω`; with drag for `h < (√(k² +
/// 4ω²) − k)/ω²`, which falls to `2/k`.
#[doc(hidden)]
pub struct SemiImplicitEuler;

impl Stepper for SemiImplicitEuler {
    fn step(&self, system: &dyn System, y: Phase, h: f64, cost: &mut StepCost) -> Phase {
        cost.parts += 1;
        let w = y.w + Counted::new(system, cost).rate(0.0, y).w * h;
        // Not counted: `u′` needs no force evaluation.
        Phase { u: y.u + system.rate(h, Phase { u: y.u, w }).u * h, w }
    }

    fn order(&self) -> u32 {
        1
    }
}
