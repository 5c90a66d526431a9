//! Gradient and filtered density by 4D linear regression (Neumann, Csébfalvi, König, Gröller 2000; the paper's 2.2).
//!
//! f(x, y, z) = Ax + By + Cz + D is fitted to the 26 neighbours of a voxel by weighted least squares, with x, y, z in
//! mm along the index axes and weights w = 1/d². The window and the weights are symmetric in every axis, so all mixed
//! sums vanish and the fit decouples: A = Σwfx / Σwx², B and C likewise, D = Σwf / Σw. The centre voxel has d = 0 and
//! is left out, also of D: it contributes nothing to A, B and C, and would have infinite weight in D, which would then
//! filter nothing. On a sheared grid d is computed as if the axes were orthogonal. Any symmetric weights give a fit,
//! and the inverse transpose of the directions turns (A, B, C) into the world gradient, which is exact for every grid.
//!
//! At a point between voxels the paper interpolates the regressions of the eight voxels around it. Both steps are
//! linear, so they commute, and the kernel here interpolates first. Along each axis, with t the point's place between 0
//! and 1, linear interpolation of the four samples −1 … 2 around the point gives the shifted values f(−1), f(0), f(1).
//! The sums only need their even part e = f(−1) + f(1), their odd part o = f(1) − f(−1), and c = f(0). Since w depends
//! on |x|, |y|, |z| alone, A = Σ a(y, z) · o_x · (c or e)_y · (c or e)_z with four coefficients, B and C likewise, and
//! D has eight. The 64 voxels are read once and reduced axis by axis.

use std::ops::{Add, Mul, Sub};

use glam::{DVec3, Mat3, Vec3, Vec4};

use super::gather::Voxels;
use crate::volume::Volume;

/// The weight that the regression gives a neighbour at the distance d (mm).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Weighting {
    /// 1/d², the default.
    InverseSquare,
    /// 1/d: with cubic voxels the operator of Zucker and Hummel.
    Inverse,
}

/// A regression fit: the gradient along the index axes in HU/mm, and the filtered density in HU.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// (A, B, C): change along each index axis, HU/mm.
    pub gradient: Vec3,
    /// D, HU.
    pub density: f32,
}

/// Rows of four voxels along x: `[z][y]`.
#[doc(hidden)]
pub type Block = [[Vec4; 4]; 4];

/// The regression coefficients for one grid.
#[derive(Clone, Copy, Debug)]
pub struct Regression {
    /// For A, indexed by |z|, then |y| (each 0 or 1).
    pub(super) a: [[f32; 2]; 2],
    /// For B, indexed by |x|, then |z|.
    pub(super) b: [[f32; 2]; 2],
    /// For C, indexed by |x|, then |y|.
    pub(super) c: [[f32; 2]; 2],
    /// For D, indexed by |x|, then |z|, then |y|.
    d: [[[f32; 2]; 2]; 2],
}

impl Regression {
    /// Computes the coefficients for voxels of `spacing` mm.
    pub fn new(spacing: DVec3, weighting: Weighting) -> Self {
        let weight = |x: usize, y: usize, z: usize| {
            let d2 = (DVec3::new(x as f64, y as f64, z as f64) * spacing).length_squared();
            match weighting {
                _ if d2 == 0.0 => 0.0,
                Weighting::InverseSquare => 1.0 / d2,
                Weighting::Inverse => 1.0 / d2.sqrt(),
            }
        };
        let two = [0, 1];
        // An offset of ±1 stands for two voxels.
        let count = |n: usize| (1 + n) as f64;
        let sum = |axis: usize| -> f64 {
            let places = two.iter().flat_map(|&u| two.map(|v| (u, v)));
            let w = |u, v| [weight(1, u, v), weight(u, 1, v), weight(u, v, 1)][axis];
            2.0 * places.map(|(u, v)| w(u, v) * count(u) * count(v)).sum::<f64>()
        };
        // w·x / Σwx², with ±spacing as the x of the neighbour at ±1.
        let scale: [f64; 3] = std::array::from_fn(|axis| 1.0 / (sum(axis) * spacing[axis]));
        let all: f64 = two
            .iter()
            .flat_map(|&x| two.iter().flat_map(move |&y| two.map(|z| (x, y, z))))
            .map(|(x, y, z)| weight(x, y, z) * count(x) * count(y) * count(z))
            .sum();
        Self {
            a: two.map(|z| two.map(|y| (weight(1, y, z) * scale[0]) as f32)),
            b: two.map(|x| two.map(|z| (weight(x, 1, z) * scale[1]) as f32)),
            c: two.map(|x| two.map(|y| (weight(x, y, 1) * scale[2]) as f32)),
            d: two.map(|x| two.map(|z| two.map(|y| (weight(x, y, z) / all) as f32))),
        }
    }

    /// Returns the fit at the point `t` (0 to 1 along each axis) of the block's inner cell.
    #[inline(always)]
    pub fn fit(&self, block: &Block, t: Vec3) -> Fit {
        let z = std::array::from_fn::<_, 4, _>(|y| parts([block[0][y], block[1][y], block[2][y], block[3][y]], t.z));
        let part = |n: usize| parts([z[0][n], z[1][n], z[2][n], z[3][n]], t.y);
        // Named after the part along z, then along y.
        let [cc, ce, co] = part(0);
        let [ec, ee, eo] = part(1);
        let [oc, oe, _] = part(2);
        let (s, t) = (1.0 - t.x, t.x);
        let (c, e, o) = (Vec4::new(0.0, s, t, 0.0), Vec4::new(s, t, s, t), Vec4::new(-s, -t, s, t));
        let even = |k: &[[f32; 2]; 2]| cc * k[0][0] + ce * k[0][1] + ec * k[1][0] + ee * k[1][1];
        let pair =
            |u: Vec4, v: Vec4, k: &[[f32; 2]; 2]| c.dot(u * k[0][0] + v * k[0][1]) + e.dot(u * k[1][0] + v * k[1][1]);
        Fit {
            gradient: Vec3::new(o.dot(even(&self.a)), pair(co, eo, &self.b), pair(oc, oe, &self.c)),
            density: c.dot(even(&self.d[0])) + e.dot(even(&self.d[1])),
        }
    }
}

/// Returns c, e and o (see the module) of four samples at `t` between the middle two.
#[inline(always)]
pub(super) fn parts<V: Copy + Add<Output = V> + Sub<Output = V> + Mul<T, Output = V>, T: Copy>(
    r: [V; 4],
    t: T,
) -> [V; 3] {
    let (e0, e1) = (r[0] + r[2], r[1] + r[3]);
    let (o0, o1) = (r[2] - r[0], r[3] - r[1]);
    [r[1] + (r[2] - r[1]) * t, e0 + (e1 - e0) * t, o0 + (o1 - o0) * t]
}

/// Returns the 4×4×4 voxels from `first` on, with air outside the volume.
#[inline(always)]
pub fn block(volume: &Volume, first: [i32; 3]) -> Block {
    Voxels::of(volume).block(first.map(|c| c + 1), f32::from)
}

/// Returns central differences at voxels, interpolated to the point `t` of the block's inner cell, HU/mm along the
/// index axes. The regression is compared with them.
pub fn central_differences(block: &Block, t: Vec3, spacing: Vec3) -> Vec3 {
    let z = std::array::from_fn::<_, 4, _>(|y| parts([block[0][y], block[1][y], block[2][y], block[3][y]], t.z));
    let [cc, _, co] = parts([z[0][0], z[1][0], z[2][0], z[3][0]], t.y);
    let [oc, ..] = parts([z[0][2], z[1][2], z[2][2], z[3][2]], t.y);
    let (s, t) = (1.0 - t.x, t.x);
    let (c, o) = (Vec4::new(0.0, s, t, 0.0), Vec4::new(-s, -t, s, t));
    Vec3::new(o.dot(cc), c.dot(co), c.dot(oc)) / (2.0 * spacing)
}

/// Returns the matrix that turns changes along the index axes (per mm) into the world gradient: the inverse transpose
/// of the directions.
pub fn to_world(volume: &Volume) -> Mat3 {
    volume.grid().direction().inverse().transpose().as_mat3()
}

#[cfg(test)]
#[path = "regression_tests.rs"]
mod tests;
