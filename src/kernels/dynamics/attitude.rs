//! Where the camera looks: an orthonormal view frame.

use glam::{DQuat, DVec3};

/// An orthonormal view frame in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attitude {
    /// Unit view direction.
    pub forward: DVec3,
    /// Unit up direction, orthogonal to `forward`.
    pub up: DVec3,
}

impl Attitude {
    /// Creates a frame that looks along `forward`, with `up` made orthogonal to it.
    ///
    /// Accepts any vectors. Degenerate ones are replaced (by +z up, or +y if the view is along z).
    pub fn new(forward: DVec3, up: DVec3) -> Self {
        let forward = forward.try_normalize().unwrap_or(DVec3::Y);
        let up = [up, DVec3::Z, DVec3::Y]
            .into_iter()
            .map(|u| u.normalize_or_zero())
            .map(|u| u - forward * u.dot(forward))
            .find(|u| u.length() > 1e-4)
            .map_or(DVec3::X, DVec3::normalize);
        Self { forward, up }
    }

    /// Unit vector to the right of the image: `forward × up`.
    pub fn right(&self) -> DVec3 {
        self.forward.cross(self.up)
    }

    /// Rotates by `angle` rad about a unit world axis.
    pub fn rotate(&mut self, axis: DVec3, angle: f64) {
        let q = DQuat::from_axis_angle(axis, angle);
        *self = Self::new(q * self.forward, q * self.up);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orthonormal_whatever_comes_in() {
        for (f, u) in [
            (DVec3::Z, DVec3::Z),
            (DVec3::ZERO, DVec3::ZERO),
            (DVec3::NAN, DVec3::NAN),
            (DVec3::X * 1e9, DVec3::splat(1e-9)),
        ] {
            let a = Attitude::new(f, u);
            assert!((a.forward.length() - 1.0).abs() < 1e-12 && (a.up.length() - 1.0).abs() < 1e-12, "{a:?}");
            assert!(a.forward.dot(a.up).abs() < 1e-12);
        }
    }
}
