//! The camera as a rigid body (paper, section 3.1.1): a small cylinder with six degrees of freedom.
//!
//! State: position `x` (mm), momentum `P = m v` (g·mm/s), orientation `q` (body to world) and angular momentum `L`
//! (g·mm²/s), all in the world frame. Equations of motion, where `k_t` and `k` are the drags:
//!
//! ```text
//! x′ = P/m      P′ = F(x) − k_t P           q′ = ½ ω q,  ω = J(q)⁻¹ L      L′ = T(q) − k L
//! ```
//!
//! In the world frame `L′` has no gyroscopic term; it is contained in `ω = J(q)⁻¹ L`. The free motion of a cylinder is
//! known exactly ([`free`]), so a fast spin costs no stability (`rotation`).

#[doc(hidden)]
pub mod free;
pub(crate) mod rotation;
pub(crate) mod translation;
pub(crate) mod turning;

pub use turning::Turning;

use glam::{DMat3, DQuat, DVec3};

use super::attitude::Attitude;

/// The state of a rigid body in the world: its position, its orientation and its motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidBodyState {
    /// Centre of mass, mm.
    pub position: DVec3,
    /// Momentum, g·mm/s.
    pub momentum: DVec3,
    /// Unit quaternion from the body's axes (x left, y up, z forward) to the world.
    pub orientation: DQuat,
    /// Angular momentum about the centre of mass, g·mm²/s.
    pub angular: DVec3,
}

impl RigidBodyState {
    /// Creates a state at rest, at a world position (mm).
    pub fn at_rest(position: DVec3, attitude: Attitude) -> Self {
        Self { position, momentum: DVec3::ZERO, orientation: orientation(attitude), angular: DVec3::ZERO }
    }

    /// Returns the view frame.
    pub fn attitude(&self) -> Attitude {
        Attitude::new(self.orientation * DVec3::Z, self.orientation * DVec3::Y)
    }

    /// Returns true if all components are finite.
    pub fn is_finite(&self) -> bool {
        self.position.is_finite()
            && self.momentum.is_finite()
            && self.orientation.is_finite()
            && self.angular.is_finite()
    }
}

/// Returns the unit quaternion that takes the body's axes (x left, y up, z forward) to a view frame.
#[doc(hidden)]
pub fn orientation(attitude: Attitude) -> DQuat {
    let frame = DMat3::from_cols(-attitude.right(), attitude.up, attitude.forward);
    DQuat::from_mat3(&frame).normalize()
}

/// Normalises `q`; the identity if `q` has no direction.
pub(crate) fn unit(q: DQuat) -> DQuat {
    let length = q.length();
    if length.is_finite() && length > 1e-150 { q / length } else { DQuat::IDENTITY }
}

/// Returns the angle between two orientations, rad, 0 to π. Exact for small angles too; the lengths do not matter.
pub fn angle(a: DQuat, b: DQuat) -> f64 {
    let turn = a * b.conjugate();
    // Both signs of a quaternion are the same rotation. The sine resolves small angles, the cosine does not.
    2.0 * turn.xyz().length().atan2(turn.w.abs())
}

/// Moments of inertia of a body with an axis of symmetry, g·mm².
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inertia {
    /// About the axis (the view direction).
    pub axial: f64,
    /// About any line perpendicular to the axis.
    pub transverse: f64,
}

impl Inertia {
    /// Returns the moments of a solid cylinder: `½ m r²` about its axis and `m (3 r² + l²)/12` across it.
    ///
    /// Lengths below 10⁻⁶ mm are raised to that value, so needles, discs and points also have an inverse.
    pub fn cylinder(mass_g: f64, radius_mm: f64, length_mm: f64) -> Self {
        let (r, l) = (radius_mm.max(1e-6), length_mm.max(1e-6));
        Self { axial: 0.5 * mass_g * r * r, transverse: mass_g * (3.0 * r * r + l * l) / 12.0 }
    }

    /// Returns `1/J_a − 1/J_t`, 1/(g·mm²): how much faster the body turns about its axis than a ball with `J_t` would.
    pub fn excess(&self) -> f64 {
        1.0 / self.axial - 1.0 / self.transverse
    }

    /// Returns the angular velocity, rad/s, of a body with angular momentum `angular` (g·mm²/s) and unit axis `axis`.
    pub fn rate(&self, angular: DVec3, axis: DVec3) -> DVec3 {
        angular / self.transverse + axis * (self.excess() * angular.dot(axis))
    }

    /// Returns the angular momentum, g·mm²/s, of a body that turns at `rate` rad/s: the inertia tensor applied to `rate`.
    pub fn momentum(&self, rate: DVec3, axis: DVec3) -> DVec3 {
        rate * self.transverse + axis * ((self.axial - self.transverse) * rate.dot(axis))
    }

    /// Returns the inverse inertia tensor in the world, 1/(g·mm²).
    pub fn inverse(&self, axis: DVec3) -> DMat3 {
        let outer = DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
        DMat3::IDENTITY * (1.0 / self.transverse) + outer * self.excess()
    }

    /// Returns the rotational energy, g·mm²/s².
    pub fn energy(&self, angular: DVec3, axis: DVec3) -> f64 {
        0.5 * angular.dot(self.rate(angular, axis))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cylinder_has_its_moments() {
        let j = Inertia::cylinder(12.0, 1.0, 3.0);
        assert_eq!((j.axial, j.transverse), (6.0, 12.0));
        // With a length of √3 radii, the moment is the same about every line.
        let ball = Inertia::cylinder(2.0, 1.0, 3f64.sqrt());
        assert!((ball.axial - ball.transverse).abs() < 1e-12);
        let axis = DVec3::new(1.0, 2.0, -2.0) / 3.0;
        for (r, l) in [(1.0, 3.0), (1e-7, 2.0), (2.0, 1e-9), (0.0, 0.0)] {
            let j = Inertia::cylinder(3.0, r, l);
            let rate = DVec3::new(0.3, -4.0, 1.0);
            let l = j.momentum(rate, axis);
            assert!((j.rate(l, axis) - rate).length() < 1e-3 && l.is_finite(), "{r}: {}", j.rate(l, axis));
            assert!((j.inverse(axis) * l - j.rate(l, axis)).length() < 1e-2);
        }
    }

    #[test]
    fn a_view_frame_there_and_back() {
        for (f, u) in [(DVec3::X, DVec3::Z), (DVec3::new(1.0, -2.0, 0.5), DVec3::Y), (DVec3::NEG_Z, DVec3::X)] {
            let a = Attitude::new(f, u);
            let m = RigidBodyState::at_rest(DVec3::ZERO, a);
            let b = m.attitude();
            assert!((a.forward - b.forward).length() < 1e-12 && (a.up - b.up).length() < 1e-12);
            assert!((m.orientation * DVec3::X + a.right()).length() < 1e-12);
        }
        assert_eq!(unit(DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0)), DQuat::IDENTITY);
        assert_eq!(unit(DQuat::from_xyzw(f64::NAN, 0.0, 0.0, 1.0)), DQuat::IDENTITY);
    }

    #[test]
    fn a_state_is_finite_only_if_all_of_it_is() {
        let sound = RigidBodyState::at_rest(DVec3::ONE, Attitude::new(DVec3::X, DVec3::Z));
        assert!(sound.is_finite());
        for bad in [f64::NAN, f64::INFINITY] {
            for broken in [
                RigidBodyState { position: DVec3::X * bad, ..sound },
                RigidBodyState { momentum: DVec3::Y * bad, ..sound },
                RigidBodyState { orientation: DQuat::from_xyzw(0.0, 0.0, bad, 1.0), ..sound },
                RigidBodyState { angular: DVec3::new(0.0, 0.0, bad), ..sound },
            ] {
                assert!(!broken.is_finite(), "{broken:?}");
            }
        }
    }
}
