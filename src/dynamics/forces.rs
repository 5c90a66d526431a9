//! What acts on the body's centre: a force that depends on the place, with its derivative.

use glam::{DMat3, DVec3};

use super::potential::Potential;
use crate::fields::Distance;

/// A force on the body over one step.
pub trait Forces: Sync {
    /// Force at a world point (mm), g·mm/s².
    fn force(&self, at: DVec3) -> DVec3;

    /// `∂F/∂x` there, g/s².
    fn slope(&self, at: DVec3) -> DMat3;
}

/// A force that is constant over the step, g·mm/s²: what tentacles, mines and the operator's hand exert.
impl Forces for DVec3 {
    fn force(&self, _: DVec3) -> DVec3 {
        *self
    }

    fn slope(&self, _: DVec3) -> DMat3 {
        DMat3::ZERO
    }
}

/// The paper's `−∇V(x) + F_user` over fields of distances. Where a field is not defined its part is zero.
#[derive(Clone, Copy)]
pub struct PotentialForce<'a> {
    /// `V`.
    pub potential: Potential,
    /// `D_s`.
    pub wall: Option<&'a dyn Distance>,
    /// `D_t`.
    pub target: Option<&'a dyn Distance>,
    /// `F_user`, and whatever else is constant over the step, world g·mm/s².
    pub push: DVec3,
}

impl PotentialForce<'_> {
    /// `V` and its derivatives at a world point, mm.
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
