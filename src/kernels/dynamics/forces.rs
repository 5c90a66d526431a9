//! The force on the body's centre as a function of position, with its derivative.

use glam::{DMat3, DVec3};

use super::potential::Potential;
use crate::fields::Distance;

/// A force on the body during one step.
pub trait Forces: Sync {
    /// Returns the force at a world point (mm), g·mm/s².
    fn force(&self, at: DVec3) -> DVec3;

    /// Returns `∂F/∂x` at that point, g/s².
    fn slope(&self, at: DVec3) -> DMat3;
}

/// A force that is constant during the step, g·mm/s²: the force of tentacles, mines and operator input.
impl Forces for DVec3 {
    fn force(&self, _: DVec3) -> DVec3 {
        *self
    }

    fn slope(&self, _: DVec3) -> DMat3 {
        DMat3::ZERO
    }
}

/// The paper's `−∇V(x) + F_user` over distance fields. A field contributes zero where it is undefined.
#[derive(Clone, Copy)]
pub struct PotentialForce<'a> {
    /// `V`.
    pub potential: Potential,
    /// `D_s`.
    pub wall: Option<&'a dyn Distance>,
    /// `D_t`.
    pub target: Option<&'a dyn Distance>,
    /// `F_user` and all other forces that are constant during the step, world g·mm/s².
    pub push: DVec3,
}

impl PotentialForce<'_> {
    /// Samples `V` and its derivatives at a world point, mm.
    pub fn sample(&self, at: DVec3) -> super::potential::PotentialSample {
        let reported = |field: Option<&dyn Distance>| field.and_then(|f| f.sample(at));
        self.potential.at(reported(self.wall), reported(self.target))
    }
}

impl Forces for PotentialForce<'_> {
    fn force(&self, at: DVec3) -> DVec3 {
        self.push - self.sample(at).gradient
    }

    fn slope(&self, at: DVec3) -> DMat3 {
        -self.sample(at).hessian
    }
}
