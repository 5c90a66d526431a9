//! The exponential Euler method.

use super::{Counted, Phase, StepCost, Stepper, System};

/// Exact in the drag, with the force `N` held constant during the step.
///
/// `w′ = N − k w` is linear in `w`, so `w₁ = e^(−k h) w₀ + h φ₁(k h) N` and, with `u′ = B w`, `u₁ = u₀ + B (h φ₁ w₀ + h²
/// φ₂ N)`, where `φ₁(x) = (1 − e⁻ˣ)/x` and `φ₂ = (1 − φ₁)/x` (Hochbruck and Ostermann, *Exponential integrators*, Acta
/// Numerica 2010). Order 1 if the force varies with position, exact if it does not. Stable in the drag for every `h`, as
/// `e^(−k h)` never leaves [0, 1]; in a well only for steps of about `1/ω` and less.
#[doc(hidden)]
pub struct ExponentialEuler;

impl Stepper for ExponentialEuler {
    fn step(&self, system: &dyn System, y: Phase, h: f64, cost: &mut StepCost) -> Phase {
        cost.parts += 1;
        let f = Counted::new(system, cost).rate(0.0, y);
        let k = system.drag();
        let force = f.w + y.w * k;
        let [decay, phi1, phi2] = phi(k * h);
        let b = system.mobility();
        Phase { u: y.u + b * (y.w * (h * phi1) + force * (h * h * phi2)), w: y.w * decay + force * (h * phi1) }
    }

    fn order(&self) -> u32 {
        1
    }
}

/// Returns `e⁻ˣ`, `φ₁(x)` and `φ₂(x)` for `x ≥ 0`, using their series where the quotients cancel.
fn phi(x: f64) -> [f64; 3] {
    let decay = (-x).exp();
    if x < 1e-4 {
        return [decay, 1.0 - x / 2.0 + x * x / 6.0, 0.5 - x / 6.0 + x * x / 24.0];
    }
    let phi1 = (1.0 - decay) / x;
    [decay, phi1, (1.0 - phi1) / x]
}
