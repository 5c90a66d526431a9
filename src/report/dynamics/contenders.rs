//! The integration methods that are compared.

use crate::dynamics::integrators::{
    BackwardEuler, Control, DormandPrince, ExplicitEuler, ExponentialEuler, ImplicitMidpoint, Integrator, Phase, Rk4,
    Rosenbrock, RosenbrockAdaptive, SemiImplicitEuler, StepCost, Stepper, System,
};

/// Methods with a fixed step. To add one, add a line here.
pub(crate) const FIXED: [(&str, &dyn Stepper); 8] = [
    ("explicit Euler", &ExplicitEuler),
    ("semi-implicit Euler", &SemiImplicitEuler),
    ("exponential Euler", &ExponentialEuler),
    ("backward Euler", &BackwardEuler),
    ("implicit midpoint", &ImplicitMidpoint),
    ("Rosenbrock ROS34PW2", &Rosenbrock),
    ("RK4", &Rk4),
    ("Dormand–Prince 5(4), fixed", &Fifth),
];

/// Returns the report's name for an integrator of a scene file.
pub(crate) fn label(integrator: Integrator) -> &'static str {
    let number = match integrator {
        Integrator::ExplicitEuler => 0,
        Integrator::SemiImplicitEuler => 1,
        Integrator::ExponentialEuler => 2,
        Integrator::BackwardEuler => 3,
        Integrator::ImplicitMidpoint => 4,
        Integrator::Rosenbrock => 5,
        Integrator::Rk4 => 6,
        Integrator::DormandPrince => 7,
    };
    FIXED[number].0
}

/// Creates an adaptive method with its tolerance.
type Make = fn(Control) -> Box<dyn Stepper>;

/// The adaptive methods.
pub(crate) const ADAPTIVE: [(&str, Make); 2] = [
    ("Dormand–Prince 5(4), adaptive", |c| Box::new(DormandPrince(c))),
    ("Rosenbrock ROS34PW2, adaptive", |c| Box::new(RosenbrockAdaptive(c))),
];

/// The fifth-order method of Dormand and Prince without step control.
pub(crate) struct Fifth;

impl Stepper for Fifth {
    fn step(&self, system: &dyn System, y: Phase, h: f64, cost: &mut StepCost) -> Phase {
        DormandPrince::fixed(system, y, h, cost)
    }

    fn order(&self) -> u32 {
        5
    }
}
