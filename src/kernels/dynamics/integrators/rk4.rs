//! The classical Runge–Kutta method (Kutta 1901; Hairer, Nørsett and Wanner, *Solving ODEs I*, II.1).

use super::{Counted, Phase, StepCost, Stepper, System};

/// `y₁ = y₀ + h/6 (k₁ + 2 k₂ + 2 k₃ + k₄)`. Order 4.
///
/// Stable for `h < 2.83/ω` in a well and for `h < 2.79/k` in the drag.
#[doc(hidden)]
pub struct Rk4;

impl Stepper for Rk4 {
    fn step(&self, system: &dyn System, y: Phase, h: f64, cost: &mut StepCost) -> Phase {
        cost.parts += 1;
        let mut f = Counted::new(system, cost);
        let k1 = f.rate(0.0, y);
        let k2 = f.rate(0.5 * h, y + k1 * (0.5 * h));
        let k3 = f.rate(0.5 * h, y + k2 * (0.5 * h));
        let k4 = f.rate(h, y + k3 * h);
        y + (k1 + (k2 + k3) * 2.0 + k4) * (h / 6.0)
    }

    fn order(&self) -> u32 {
        4
    }
}
