//! Samples of distance fields: the interface between the fields and the potential built on them.

use glam::{DMat3, DVec3};

/// A distance with its first and second derivatives at a position, in the world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Distance, mm.
    pub mm: f64,
    /// Gradient, dimensionless; of length 1 for a distance away from its ridges.
    pub gradient: DVec3,
    /// Second derivatives, 1/mm; symmetric.
    pub hessian: DMat3,
}

/// Zero. Not derived, because the default matrix is the identity.
impl Default for Sample {
    fn default() -> Self {
        Self { mm: 0.0, gradient: DVec3::ZERO, hessian: DMat3::ZERO }
    }
}

/// A scalar field of distances over the world: to the wall (D_s) or to the target (D_t).
pub trait Distance: Sync {
    /// Returns the sample at a world point (mm), or `None` where the field is undefined and for a point that is not finite.
    fn sample(&self, at: DVec3) -> Option<Sample>;
}
