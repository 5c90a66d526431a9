//! The camera of a dataset, and its poses, in the terms of those who read them.

use glam::{DMat3, DQuat, DVec3};

use crate::render::View;

/// The intrinsics of a camera. Numbers are pixels; the first pixel's centre is at (0, 0), x to the right, y down.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(tag = "model", rename_all = "kebab-case")]
pub enum Intrinsics {
    /// A pinhole camera.
    Perspective {
        /// Focal length across.
        fx: f64,
        /// Focal length down.
        fy: f64,
        /// The principal point across.
        cx: f64,
        /// The principal point down.
        cy: f64,
    },
    /// Kannala and Brandt's: r = θ + k1 θ³ + k2 θ⁵ + k3 θ⁷ + k4 θ⁹, times the focal lengths.
    Fisheye {
        /// Focal length across.
        fx: f64,
        /// Focal length down.
        fy: f64,
        /// The principal point across.
        cx: f64,
        /// The principal point down.
        cy: f64,
        /// The four coefficients.
        k: [f64; 4],
    },
    /// Scaramuzza's polynomial: the ray of (u, v) is (u, v, a0 + a2 ρ² + a3 ρ³ + a4 ρ⁴).
    Scaramuzza {
        /// a0, a2, a3, a4.
        a: [f64; 4],
        /// The centre across.
        cx: f64,
        /// The centre down.
        cy: f64,
        /// c, d, e.
        stretch: [f64; 3],
    },
    /// Longitude and latitude, linear in pixels.
    Panorama,
    /// Another model, by its name: its rays are only in the pictures.
    Other {
        /// Its name.
        name: String,
    },
}

impl Intrinsics {
    /// Returns those of a pinhole camera; `None` unless the view is one.
    pub fn of_perspective(view: &View) -> Option<Self> {
        let f = view.pixel()?.recip();
        let [cx, cy] = view.centre().map(|c| c - 0.5);
        Some(Self::Perspective { fx: f, fy: f, cx, cy })
    }

    /// Returns those of an equidistant fisheye with a view angle over the shorter side, degrees, for a picture of `size` pixels.
    pub fn of_equidistant(fov_degrees: f64, size: [usize; 2]) -> Self {
        let f = size[0].min(size[1]) as f64 / fov_degrees.to_radians();
        let [cx, cy] = size.map(|n| 0.5 * n as f64 - 0.5);
        Self::Fisheye { fx: f, fy: f, cx, cy, k: [0.0; 4] }
    }

    /// Returns what messages call it.
    pub fn told(&self) -> String {
        match self {
            Self::Perspective { .. } => "a pinhole camera".into(),
            Self::Fisheye { .. } => "a fisheye camera".into(),
            Self::Scaramuzza { .. } => "a camera of Scaramuzza's model".into(),
            Self::Panorama => "a panorama".into(),
            Self::Other { name } => format!("the camera {name}"),
        }
    }

    /// Returns the focal lengths, the principal point, and the coefficients of Kannala and Brandt's model, none for a pinhole camera.
    /// The first pixel's centre is at (`first`, `first`). `None` for other cameras.
    pub fn central(&self, first: f64) -> Option<([f64; 4], Option<[f64; 4]>)> {
        match *self {
            Self::Perspective { fx, fy, cx, cy } => Some(([fx, fy, cx + first, cy + first], None)),
            Self::Fisheye { fx, fy, cx, cy, k } => Some(([fx, fy, cx + first, cy + first], Some(k))),
            _ => None,
        }
    }
}

/// A camera's pose with the axes of computer vision: x to the right, y down, z forward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VisionPose {
    /// Its position, world, mm.
    pub position: DVec3,
    /// Turns a direction of the camera into one of the world; its columns are right, down and forward.
    pub to_world: DMat3,
}

impl VisionPose {
    /// Returns that of a view.
    pub fn of(view: &View) -> Self {
        Self { position: view.position(), to_world: DMat3::from_cols(view.right(), -view.up(), view.forward()) }
    }

    /// Returns the rotation as a unit quaternion x, y, z, w with w not negative.
    pub fn quaternion(&self) -> [f64; 4] {
        let q = DQuat::from_mat3(&self.to_world).normalize();
        (if q.w < 0.0 { -q } else { q }).to_array()
    }

    /// Returns the rows of the 4×4 matrix from the camera to the world, with positions in mm times `scale`.
    pub fn rows(&self, scale: f64) -> [[f64; 4]; 4] {
        let m = self.to_world.transpose().to_cols_array_2d();
        let p = (self.position * scale).to_array();
        let row = |n: usize| [m[n][0], m[n][1], m[n][2], p[n]];
        [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_have_the_axes_of_computer_vision() {
        // Looking to posterior with superior on top.
        let view = View::new(DVec3::new(1.0, 2.0, 3.0), DVec3::Y, DVec3::Z, 90.0, 64, 48).unwrap();
        let pose = VisionPose::of(&view);
        assert!((pose.to_world * DVec3::Z - DVec3::Y).length() < 1e-12, "z is forward");
        assert!((pose.to_world * DVec3::Y - DVec3::NEG_Z).length() < 1e-12, "y is down");
        assert!((pose.to_world.determinant() - 1.0).abs() < 1e-12, "right-handed");
        let [x, y, z, w] = pose.quaternion();
        assert!((DMat3::from_quat(DQuat::from_xyzw(x, y, z, w)) - pose.to_world).abs_diff_eq(DMat3::ZERO, 1e-12));
        assert_eq!(pose.rows(0.001)[1][3], 0.002);
        let Some(Intrinsics::Perspective { fx, cx, cy, .. }) = Intrinsics::of_perspective(&view) else { panic!() };
        assert_eq!((fx, cx, cy), (24.0, 31.5, 23.5));
        // A point's pixel by the intrinsics is where the view has it, half a pixel less.
        let place = DVec3::new(4.0, 30.0, -1.0);
        let local = pose.to_world.transpose() * (place - pose.position);
        let at = [fx * local.x / local.z + cx, fx * local.y / local.z + cy];
        let seen = view.project(place).unwrap();
        assert!((0..2).all(|n| (at[n] + 0.5 - seen[n]).abs() < 1e-9), "{at:?} {seen:?}");
    }
}
