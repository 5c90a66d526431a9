//! Sampling of the volume: the value and the fit at a point, interpolated (high detail) or from the nearest voxel (low detail).

use glam::{DVec3, Vec3};

use super::gather::Voxels;
use super::march::round;
use super::regression::{Fit, Regression, Weighting, block};
use crate::space::PreparedVolume;
use crate::volume::Volume;

/// Evaluates the volume between voxels. Positions are grown voxel coordinates: voxel coordinates plus one.
pub trait Sampler: Sync {
    /// Returns the HU at `q`.
    fn value(&self, q: Vec3) -> f32;
    /// Returns the 4D regression at `q`.
    fn fit(&self, q: Vec3) -> Fit;
    /// Returns true if `q` is in a homogeneous region that is not empty: the nearest voxel is flagged and opaque.
    fn is_within_tissue(&self, q: Vec3) -> bool;

    /// Returns the gradient at a point that is not empty, HU/mm along the index axes.
    ///
    /// It is 0 in a homogeneous region, which stands for a gradient that points at the camera (the paper's section 2.2).
    #[inline(always)]
    fn gradient(&self, q: Vec3) -> Vec3 {
        if self.is_within_tissue(q) { Vec3::ZERO } else { self.fit(q).gradient }
    }
}

/// A sampler whose regressions are computed at voxels, so that they can be kept. Each is that of one voxel, or is
/// interpolated between eight.
pub trait VoxelSampler: Sampler {
    /// True if a fit is interpolated between the eight voxels around it, false if it is that of the nearest one.
    const INTERPOLATES: bool;

    /// Returns the regression at voxel `v`, counted from voxel −1.
    fn fit_at(&self, v: [i32; 3]) -> Fit;

    /// Returns the least and the greatest relevant density, HU. The wall's ramp is between them.
    fn densities(&self) -> [f32; 2];
}

/// Range of a scanner's 16-bit voxels, HU. Values beyond are clamped.
const SCANNER_HU: [f32; 2] = [-1024.0, 3071.0];

/// Returns the density range of the 16-bit voxels of `volume`.
fn densities(volume: &PreparedVolume) -> [f32; 2] {
    [SCANNER_HU[0].min(volume.transfer().lo()), SCANNER_HU[1].max(volume.transfer().hi())]
}

/// Returns true if the voxel nearest to `q` is flagged as homogeneous.
#[inline(always)]
pub(super) fn is_homogeneous(volume: &PreparedVolume, q: Vec3) -> bool {
    let dims = volume.voxels().grid().dims();
    let [i, j, k] = nearest(q).map(|c| c.wrapping_sub(1) as usize);
    i < dims[0] && j < dims[1] && k < dims[2] && volume.flags().homogeneous(volume.voxels(), i, j, k)
}

/// Returns true if the voxel nearest to `q` is flagged as homogeneous, and is not empty.
///
/// The flag alone is not sufficient. A filtered density depends on voxels beyond the flag's neighbourhood, so it may be
/// visible where the nearest voxel is flagged as empty.
#[inline(always)]
pub(super) fn is_within_tissue(volume: &PreparedVolume, q: Vec3) -> bool {
    let voxels = volume.voxels();
    let dims = voxels.grid().dims();
    let [i, j, k] = nearest(q).map(|c| c.wrapping_sub(1) as usize);
    i < dims[0]
        && j < dims[1]
        && k < dims[2]
        && voxels.data()[voxels.grid().index(i, j, k)] > volume.flags().empty_up_to()
        && volume.flags().homogeneous(voxels, i, j, k)
}

/// High detail: trilinear values, and interpolated regressions of the eight nearest voxels.
pub struct Trilinear<'a> {
    volume: &'a PreparedVolume,
    regression: Regression,
}

/// Low detail: everything comes from the nearest voxel.
pub struct Nearest<'a> {
    volume: &'a PreparedVolume,
    regression: Regression,
}

impl<'a> Trilinear<'a> {
    /// Creates a sampler of `volume`.
    pub fn new(volume: &'a PreparedVolume) -> Self {
        Self { volume, regression: regression(volume) }
    }
}

impl<'a> Nearest<'a> {
    /// Creates a sampler of `volume`.
    pub fn new(volume: &'a PreparedVolume) -> Self {
        Self { volume, regression: regression(volume) }
    }
}

pub(super) fn regression(volume: &PreparedVolume) -> Regression {
    let spacing: DVec3 = volume.voxels().grid().spacing();
    Regression::new(spacing, Weighting::InverseSquare)
}

/// Returns a cell that contains `q`, counted from cell −1, and the position within it, 0 to 1. On the plane between two
/// cells, either is valid.
#[inline(always)]
pub(crate) fn split(q: Vec3) -> ([i32; 3], Vec3) {
    let cell = round(q + 0.5).map(|c| c - 1);
    (cell, q - Vec3::from_array(cell.map(|c| c as f32)))
}

/// Returns the voxel nearest to `q`, counted from voxel −1; ties go to the even one.
#[inline(always)]
pub(crate) fn nearest(q: Vec3) -> [i32; 3] {
    round(q)
}

/// Returns the trilinear value of `volume` at `q`, in grown voxel coordinates, with air outside.
#[inline(always)]
pub(crate) fn trilinear(volume: &Volume, q: Vec3) -> f32 {
    let (cell, t) = split(q);
    let [a, b, c, d, e, f, g, h] = Voxels::of(volume).corners(cell);
    let mix = |a: i16, b: i16, t: f32| {
        let a = f32::from(a);
        a + (f32::from(b) - a) * t
    };
    let (ab, cd, ef, gh) = (mix(a, b, t.x), mix(c, d, t.x), mix(e, f, t.x), mix(g, h, t.x));
    let (near, far) = (ab + (cd - ab) * t.y, ef + (gh - ef) * t.y);
    near + (far - near) * t.z
}

impl Sampler for Trilinear<'_> {
    #[inline(always)]
    fn value(&self, q: Vec3) -> f32 {
        trilinear(self.volume.voxels(), q)
    }

    #[inline(always)]
    fn fit(&self, q: Vec3) -> Fit {
        let (cell, t) = split(q);
        self.regression.fit(&block(self.volume.voxels(), cell.map(|c| c - 2)), t)
    }

    #[inline(always)]
    fn is_within_tissue(&self, q: Vec3) -> bool {
        is_within_tissue(self.volume, q)
    }
}

impl VoxelSampler for Trilinear<'_> {
    const INTERPOLATES: bool = true;

    // A separate function: inside a ray's loop the optimiser gives up on it.
    #[inline(never)]
    fn fit_at(&self, v: [i32; 3]) -> Fit {
        self.regression.fit(&block(self.volume.voxels(), v.map(|c| c - 2)), Vec3::ZERO)
    }

    fn densities(&self) -> [f32; 2] {
        densities(self.volume)
    }
}

impl Sampler for Nearest<'_> {
    #[inline(always)]
    fn value(&self, q: Vec3) -> f32 {
        f32::from(Voxels::of(self.volume.voxels()).get(nearest(q)))
    }

    #[inline(always)]
    fn fit(&self, q: Vec3) -> Fit {
        self.regression.fit(&block(self.volume.voxels(), nearest(q).map(|c| c - 2)), Vec3::ZERO)
    }

    #[inline(always)]
    fn is_within_tissue(&self, q: Vec3) -> bool {
        is_within_tissue(self.volume, q)
    }
}

impl VoxelSampler for Nearest<'_> {
    const INTERPOLATES: bool = false;

    // A separate function: inside a ray's loop the optimiser gives up on it.
    #[inline(never)]
    fn fit_at(&self, v: [i32; 3]) -> Fit {
        self.regression.fit(&block(self.volume.voxels(), v.map(|c| c - 2)), Vec3::ZERO)
    }

    fn densities(&self) -> [f32; 2] {
        densities(self.volume)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DMat3;

    use super::*;
    use crate::math::hash;
    use crate::space::TransferFunction;
    use crate::space::ray;
    use crate::volume::{Grid, Volume};

    #[test]
    fn samples_are_those_of_the_exact_ray() {
        let grid = Grid::new([5, 4, 6], DVec3::new(0.5, 0.7, 1.0), DVec3::ONE, DMat3::IDENTITY).unwrap();
        let data = (0..grid.len() as u64).map(|n| (2000.0 * hash::uniform(1, n)) as i16 - 1000).collect();
        let volume = PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default());
        for n in 0..3000 {
            let u = |k| hash::uniform(n, k);
            let q = Vec3::new(6.0 * u(0) as f32, 5.0 * u(1) as f32, 7.0 * u(2) as f32);
            let exact = ray::trilinear(volume.voxels(), q.as_dvec3() - 1.0);
            assert!((f64::from(Trilinear::new(&volume).value(q)) - exact).abs() < 0.02, "{q}");
            let voxel = (q - 0.5).floor();
            let near = volume.voxels().get(voxel.x as i64, voxel.y as i64, voxel.z as i64);
            assert_eq!(Nearest::new(&volume).value(q), f32::from(near), "{q}");
            let (low, high) = (Nearest::new(&volume).fit(q), Trilinear::new(&volume).fit(voxel + 1.0));
            assert!((low.gradient - high.gradient).length() < 1e-3);
        }
    }
}
