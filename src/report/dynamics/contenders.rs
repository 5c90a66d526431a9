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
    use Integrator as I;
    let order = [
        I::ExplicitEuler,
        I::SemiImplicitEuler,
        I::ExponentialEuler,
        I::BackwardEuler,
        I::ImplicitMidpoint,
        I::Rosenbrock,
        I::Rk4,
        I::DormandPrince,
    ];
    let number = order.iter().position(|i| *i == integrator).expect("every integrator is compared");
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
