//! The motion of the centre of mass as a system to integrate.

use glam::{DMat3, DVec3};

use crate::dynamics::forces::Forces;
use crate::dynamics::integrators::{Blocks, Phase, System};

/// `u = x − x₀` (mm), `w = P` (g·mm/s): `u′ = w/m`, `w′ = F(x₀ + u) − k w`.
pub(crate) struct Translation<'a> {
    /// `F` and its derivative.
    pub forces: &'a dyn Forces,
    /// `x₀`: the start of the step, world mm. Small differences are not lost next to large coordinates.
    pub origin: DVec3,
    /// `m`, g.
    pub mass_g: f64,
    /// `k`, 1/s.
    pub drag: f64,
}

impl System for Translation<'_> {
    fn rate(&self, _: f64, y: Phase) -> Phase {
        Phase { u: y.w / self.mass_g, w: self.forces.force(self.origin + y.u) - y.w * self.drag }
    }

    fn jacobian(&self, _: f64, y: Phase) -> Blocks {
        Blocks {
            uu: DMat3::ZERO,
            uw: self.mobility(),
            wu: self.forces.slope(self.origin + y.u),
            ww: DMat3::IDENTITY * -self.drag,
        }
    }

    fn drag(&self) -> f64 {
        self.drag
    }

    fn mobility(&self) -> DMat3 {
        DMat3::IDENTITY * (1.0 / self.mass_g)
    }
}
