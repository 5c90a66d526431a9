//! Numerical integrators for the equations of motion.
//!
//! They are interchangeable one-step methods; `colvis report dynamics` compares them.
//!
//! | name | order | implicit | stable step for `x″ = −ω² x − k x′` |
//! |---|---|---|---|
//! | `explicit-euler` | 1 | no | none without drag; `h < k/ω²` with a little |
//! | `semi-implicit-euler` | 1 | no | `h < 2/ω` |
//! | `rk4` | 4 | no | `h < 2.83/ω` |
//! | `dormand-prince` | 5(4), adaptive | no | divides the step into as many parts as it needs, up to a limit |
//! | `implicit-midpoint` | 2 | yes | every `h` (A-stable) |
//! | `backward-euler` | 1 | yes | every `h` (L-stable) |
//! | `rosenbrock` | 3 | linearly | every `h` (L-stable) |
//! | `exponential-euler` | 1 | no | `h ≲ 1/ω`; every `h` in the drag |
//!
//! A [`Stepper`] advances a [`System`] of two vectors, `u` (position or angle) and `w` (momentum). The translation and
//! the rotation of a rigid body are one such system each, with separate error control and separate Newton iterations.

mod control;
mod dormand_prince;
mod euler;
mod exponential;
mod newton;
mod phase;
mod rk4;
mod rosenbrock;

use serde::{Deserialize, Serialize};

#[doc(hidden)]
pub use control::Control;
#[doc(hidden)]
pub use dormand_prince::DormandPrince;
#[doc(hidden)]
pub use euler::{ExplicitEuler, SemiImplicitEuler};
#[doc(hidden)]
pub use exponential::ExponentialEuler;
#[doc(hidden)]
pub use newton::{BackwardEuler, ImplicitMidpoint};
#[doc(hidden)]
pub use phase::{Blocks, Phase};
#[doc(hidden)]
pub use rk4::Rk4;
#[doc(hidden)]
pub use rosenbrock::{Rosenbrock, RosenbrockAdaptive};

use glam::DMat3;

/// `u′, w′` as a function of time and state, with its derivatives. Time is 0 at the start of the step.
#[doc(hidden)]
pub trait System {
    /// Returns `(u′, w′)` at time `t` s.
    fn rate(&self, t: f64, y: Phase) -> Phase;

    /// Returns the derivative of the rate with respect to the state.
    fn jacobian(&self, t: f64, y: Phase) -> Blocks;

    /// Returns the derivative of the rate with respect to time, if it has one. `scale` is a time over which it changes little, s.
    fn time_rate(&self, _t: f64, _y: Phase, _scale: f64) -> Phase {
        Phase::default()
    }

    /// Returns the coefficient `k` of the term `−k w` in `w′`, 1/s.
    fn drag(&self) -> f64;

    /// Returns `∂u′/∂w` at the start of the step: it converts momenta into velocities.
    fn mobility(&self) -> DMat3;
}

/// The cost of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[doc(hidden)]
pub struct StepCost {
    /// Number of evaluations of the force or torque.
    pub rates: u32,
    /// Number of evaluations of its derivative.
    pub jacobians: u32,
    /// Number of parts that the step was divided into, including rejected ones.
    pub parts: u32,
    /// True if a limit was reached (on parts or on Newton iterations) and a cheap method took the remainder.
    pub cut_short: bool,
}

impl StepCost {
    /// Adds the cost of another step.
    #[doc(hidden)]
    pub fn add(&mut self, other: Self) {
        self.rates += other.rates;
        self.jacobians += other.jacobians;
        self.parts += other.parts;
        self.cut_short |= other.cut_short;
    }
}

/// A one-step method: advances a system by one step.
#[doc(hidden)]
pub trait Stepper: Sync {
    /// Returns the state `h` s after `y`.
    ///
    /// Always terminates, after a bounded number of evaluations. The caller checks for overflow ([`Phase::is_finite`]).
    fn step(&self, system: &dyn System, y: Phase, h: f64, cost: &mut StepCost) -> Phase;

    /// Returns the order of convergence for smooth forces.
    fn order(&self) -> u32;
}

/// A system that counts its evaluations.
pub(crate) struct Counted<'a> {
    system: &'a dyn System,
    cost: &'a mut StepCost,
}

impl<'a> Counted<'a> {
    pub(crate) fn new(system: &'a dyn System, cost: &'a mut StepCost) -> Self {
        Self { system, cost }
    }

    pub(crate) fn rate(&mut self, t: f64, y: Phase) -> Phase {
        self.cost.rates += 1;
        self.system.rate(t, y)
    }

    pub(crate) fn jacobian(&mut self, t: f64, y: Phase) -> Blocks {
        self.cost.jacobians += 1;
        self.system.jacobian(t, y)
    }
}

/// The available methods, named as in scene files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Integrator {
    /// For comparison only: unstable without drag.
    ExplicitEuler,
    /// Updates the velocity first, then the position with the new velocity.
    SemiImplicitEuler,
    /// The classical four-stage method.
    Rk4,
    /// Adaptive, explicit.
    DormandPrince,
    /// Nearly conserves energy; stable for every step.
    ImplicitMidpoint,
    /// Damps motion that it does not resolve.
    BackwardEuler,
    /// Linearly implicit, without iteration. The default, chosen by `colvis report dynamics`.
    #[default]
    Rosenbrock,
    /// Exact in the drag for a force that is constant during the step.
    ExponentialEuler,
}

impl Integrator {
    /// All methods with their names.
    pub const ALL: [(Self, &'static str); 8] = [
        (Self::ExplicitEuler, "explicit-euler"),
        (Self::SemiImplicitEuler, "semi-implicit-euler"),
        (Self::Rk4, "rk4"),
        (Self::DormandPrince, "dormand-prince"),
        (Self::ImplicitMidpoint, "implicit-midpoint"),
        (Self::BackwardEuler, "backward-euler"),
        (Self::Rosenbrock, "rosenbrock"),
        (Self::ExponentialEuler, "exponential-euler"),
    ];

    /// Returns the method with its settings for a flight.
    #[doc(hidden)]
    pub fn stepper(self) -> &'static dyn Stepper {
        const FLIGHT: DormandPrince = DormandPrince(Control { tolerance: 1e-4, most_parts: 256 });
        match self {
            Self::ExplicitEuler => &ExplicitEuler,
            Self::SemiImplicitEuler => &SemiImplicitEuler,
            Self::Rk4 => &Rk4,
            Self::DormandPrince => &FLIGHT,
            Self::ImplicitMidpoint => &ImplicitMidpoint,
            Self::BackwardEuler => &BackwardEuler,
            Self::Rosenbrock => &Rosenbrock,
            Self::ExponentialEuler => &ExponentialEuler,
        }
    }

    /// Returns the name used in scene files.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|i| i.0 == self).map_or("", |i| i.1)
    }
}

#[cfg(test)]
mod tests;
