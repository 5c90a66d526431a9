//! The cell between eight neighbouring voxels, in which the volume is trilinear.

use std::array::from_fn;

use glam::DVec3;

use super::Volume;

/// Returns the eight corner values of the cell at `base`: x fastest, then y, then z.
#[inline(always)]
pub fn corners(volume: &Volume, base: [i64; 3]) -> [i16; 8] {
    let dims = volume.grid().dims();
    let inside = |a: usize| base[a] >= 0 && (base[a] as usize) + 1 < dims[a];
    if inside(0) && inside(1) && inside(2) {
        let n = volume.grid().index(base[0] as usize, base[1] as usize, base[2] as usize);
        let (row, slice) = (dims[0], dims[0] * dims[1]);
        let data = volume.data();
        let pair = |n: usize| [data[n], data[n + 1]];
        let ([a, b], [c, d]) = (pair(n), pair(n + row));
        let ([e, f], [g, h]) = (pair(n + slice), pair(n + slice + row));
        [a, b, c, d, e, f, g, h]
    } else {
        let at = |n: i64| volume.get(base[0] + (n & 1), base[1] + (n >> 1 & 1), base[2] + (n >> 2));
        from_fn(|n| at(n as i64))
    }
}

/// A cell's value as a polynomial in the coordinates within it: k₀ + k₁u + k₂v + k₃w + k₄uv + k₅uw + k₆vw + k₇uvw.
#[derive(Clone, Copy, Debug)]
pub struct Cell([f64; 8]);

impl Cell {
    /// Loads the cell whose lowest corner is the voxel `base`. Voxels outside the volume are air.
    #[inline]
    pub fn load(volume: &Volume, base: [i64; 3]) -> Self {
        Self::new(corners(volume, base))
    }

    /// Creates a cell from its corner values, HU, x fastest.
    #[inline]
    pub fn new(corners: [i16; 8]) -> Self {
        let [a, b, c, d, e, f, g, h] = corners.map(f64::from);
        Self([a, b - a, c - a, e - a, d - c - b + a, f - e - b + a, g - e - c + a, h - g - f + e - d + c + b - a])
    }

    /// Returns the HU at `p`, in voxels from the lowest corner.
    #[inline]
    pub fn at(&self, p: DVec3) -> f64 {
        let [k0, k1, k2, k3, k4, k5, k6, k7] = self.0;
        let (u, v, w) = (p.x, p.y, p.z);
        k0 + k1 * u + k2 * v + k3 * w + k4 * u * v + k5 * u * w + k6 * v * w + k7 * u * v * w
    }

    /// Returns the change of HU per voxel along each axis at `p`, in voxels from the lowest corner.
    #[inline]
    pub fn gradient(&self, p: DVec3) -> DVec3 {
        let [_, k1, k2, k3, k4, k5, k6, k7] = self.0;
        let (u, v, w) = (p.x, p.y, p.z);
        DVec3::new(
            k1 + k4 * v + k5 * w + k7 * v * w,
            k2 + k4 * u + k6 * w + k7 * u * w,
            k3 + k5 * u + k6 * v + k7 * u * v,
        )
    }

    /// Returns the value at `p + s·d` as a cubic in s: its coefficients, lowest power first. `p` and `d` are in voxels.
    #[inline]
    pub fn along(&self, p: DVec3, d: DVec3) -> [f64; 4] {
        let [_, k1, k2, k3, k4, k5, k6, k7] = self.0;
        let (u, v, w) = (p.x, p.y, p.z);
        let (du, dv, dw) = (d.x, d.y, d.z);
        // uv, uw and vw as quadratics of s, without their constants.
        let (uv1, uv2) = (u * dv + v * du, du * dv);
        let (uw1, uw2) = (u * dw + w * du, du * dw);
        let (vw1, vw2) = (v * dw + w * dv, dv * dw);
        [
            self.at(p),
            k1 * du + k2 * dv + k3 * dw + k4 * uv1 + k5 * uw1 + k6 * vw1 + k7 * (u * v * dw + uv1 * w),
            k4 * uv2 + k5 * uw2 + k6 * vw2 + k7 * (uv1 * dw + uv2 * w),
            k7 * uv2 * dw,
        ]
    }
}
