//! Estimators of the gradient between voxels.

use glam::{DVec3, Vec3, Vec4};

use crate::render::regression::{Block, Regression, Weighting, block, central_differences};
use crate::volume::Volume;

/// Estimates the gradient at voxel coordinates, in HU/mm along the index axes.
pub(crate) trait Estimate: Sync {
    /// Estimates at one point.
    fn at(&self, volume: &Volume, voxel: DVec3) -> Vec3;
    /// Estimates at many points, with one virtual call for all of them.
    fn all(&self, volume: &Volume, voxels: &[DVec3], out: &mut dyn FnMut(Vec3));
}

/// An estimator.
pub(crate) struct Estimator {
    /// Its name.
    pub name: &'static str,
    /// True if gradients are precomputed.
    pub stored: bool,
    /// Memory per voxel, bytes.
    pub bytes: usize,
    /// Prepares it for a volume.
    pub make: fn(&Volume) -> Box<dyn Estimate>,
}

/// All estimators.
pub(crate) const ESTIMATORS: [Estimator; 6] = [
    Estimator {
        name: "4D regression 1/d²",
        stored: false,
        bytes: 0,
        make: |v| regression(v, Weighting::InverseSquare),
    },
    Estimator { name: "4D regression 1/d", stored: false, bytes: 0, make: |v| regression(v, Weighting::Inverse) },
    Estimator {
        name: "central differences",
        stored: false,
        bytes: 0,
        make: |v| {
            let spacing = v.grid().spacing().as_vec3();
            Box::new(Around(move |b: &Block, t| central_differences(b, t, spacing)))
        },
    },
    Estimator {
        name: "Sobel",
        stored: false,
        bytes: 0,
        make: |v| {
            let spacing = v.grid().spacing().as_vec3();
            Box::new(Around(move |b: &Block, t| sobel(b, t, spacing)))
        },
    },
    Estimator { name: "stored, 8 bits", stored: true, bytes: 3, make: |v| Box::new(Stored::<i8>::new(v)) },
    Estimator { name: "stored, 16 bits", stored: true, bytes: 6, make: |v| Box::new(Stored::<i16>::new(v)) },
];

/// An estimator from the 4×4×4 voxels around a point.
struct Around<F>(F);

impl<F: Fn(&Block, Vec3) -> Vec3 + Sync> Around<F> {
    #[inline(always)]
    fn one(&self, volume: &Volume, voxel: DVec3) -> Vec3 {
        let base = voxel.floor();
        let first = base.to_array().map(|c| c as i32 - 1);
        (self.0)(&block(volume, first), (voxel - base).as_vec3())
    }
}

impl<F: Fn(&Block, Vec3) -> Vec3 + Sync> Estimate for Around<F> {
    fn at(&self, volume: &Volume, voxel: DVec3) -> Vec3 {
        self.one(volume, voxel)
    }

    fn all(&self, volume: &Volume, voxels: &[DVec3], out: &mut dyn FnMut(Vec3)) {
        for &v in voxels {
            out(self.one(volume, v));
        }
    }
}

fn regression(volume: &Volume, weighting: Weighting) -> Box<dyn Estimate> {
    let regression = Regression::new(volume.grid().spacing(), weighting);
    Box::new(Around(move |b: &Block, t| regression.fit(b, t).gradient))
}

/// Sobel's operator in three dimensions (differences along one axis, 1-2-1 along the others) at the eight voxels around a point,
/// interpolated.
fn sobel(block: &Block, t: Vec3, spacing: Vec3) -> Vec3 {
    let smooth = |t: f32| 0.25 * Vec4::new(1.0 - t, 2.0 - t, 1.0 + t, t);
    let slope = |t: f32, h: f32| Vec4::new(t - 1.0, -t, 1.0 - t, t) / (2.0 * h);
    let (sx, sy, sz) = (smooth(t.x), smooth(t.y), smooth(t.z));
    let (dx, dy, dz) = (slope(t.x, spacing.x), slope(t.y, spacing.y), slope(t.z, spacing.z));
    let mut g = Vec3::ZERO;
    for (z, plane) in block.iter().enumerate() {
        for (y, row) in plane.iter().enumerate() {
            let (s, d) = (row.dot(sx), row.dot(dx));
            g += Vec3::new(d * sy[y] * sz[z], s * dy[y] * sz[z], s * sy[y] * dz[z]);
        }
    }
    g
}

/// A signed integer of few bits.
trait Bits: Copy + Send + Sync + 'static {
    const MOST: f32;
    fn new(v: f32) -> Self;
    fn get(self) -> f32;
}

impl Bits for i8 {
    const MOST: f32 = 127.0;
    fn new(v: f32) -> Self {
        v.round() as Self
    }
    fn get(self) -> f32 {
        f32::from(self)
    }
}

impl Bits for i16 {
    const MOST: f32 = 32767.0;
    fn new(v: f32) -> Self {
        v.round() as Self
    }
    fn get(self) -> f32 {
        f32::from(self)
    }
}

/// The regression (1/d²) at every voxel, interpolated. Each component is stored in few bits, relative to the steepest gradient of
/// the volume.
struct Stored<B> {
    scale: f32,
    gradients: Vec<[B; 3]>,
}

impl<B: Bits> Stored<B> {
    fn new(volume: &Volume) -> Self {
        let regression = Regression::new(volume.grid().spacing(), Weighting::InverseSquare);
        let [nx, ny, nz] = volume.grid().dims().map(|n| n as i32);
        let places = (0..nz).flat_map(|k| (0..ny).flat_map(move |j| (0..nx).map(move |i| [i, j, k])));
        let all: Vec<Vec3> =
            places.map(|p| regression.fit(&block(volume, p.map(|c| c - 1)), Vec3::ZERO).gradient).collect();
        let steepest = all.iter().map(|g| g.abs().max_element()).fold(f32::MIN_POSITIVE, f32::max);
        let scale = steepest / B::MOST;
        Self { scale, gradients: all.iter().map(|g| (*g / scale).to_array().map(B::new)).collect() }
    }

    #[inline(always)]
    fn one(&self, volume: &Volume, voxel: DVec3) -> Vec3 {
        let dims = volume.grid().dims();
        let base: [usize; 3] = std::array::from_fn(|a| (voxel[a].max(0.0) as usize).min(dims[a].saturating_sub(2)));
        let t: [f32; 3] = std::array::from_fn(|a| (voxel[a] - base[a] as f64).clamp(0.0, 1.0) as f32);
        let mut sum = Vec3::ZERO;
        for c in 0..8 {
            let corner = [c & 1, c >> 1 & 1, c >> 2];
            let share: f32 = (0..3).map(|a| if corner[a] == 1 { t[a] } else { 1.0 - t[a] }).product();
            let at: [usize; 3] = std::array::from_fn(|a| (base[a] + corner[a]).min(dims[a] - 1));
            let g = self.gradients[volume.grid().index(at[0], at[1], at[2])];
            sum += Vec3::from_array(g.map(B::get)) * share;
        }
        sum * self.scale
    }
}

impl<B: Bits> Estimate for Stored<B> {
    fn at(&self, volume: &Volume, voxel: DVec3) -> Vec3 {
        self.one(volume, voxel)
    }

    fn all(&self, volume: &Volume, voxels: &[DVec3], out: &mut dyn FnMut(Vec3)) {
        for &v in voxels {
            out(self.one(volume, v));
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::volume::Grid;

    #[test]
    fn a_slope_is_estimated_by_all() {
        let g = DVec3::new(60.0, -40.0, 25.0);
        for spacing in [DVec3::ONE, DVec3::new(0.7, 0.7, 2.1)] {
            let grid = Grid::new([9; 3], spacing, DVec3::ZERO, DMat3::IDENTITY).unwrap();
            let at = |n: usize| DVec3::new((n % 9) as f64, (n / 9 % 9) as f64, (n / 81) as f64) * spacing;
            let data = (0..729).map(|n| g.dot(at(n)).round() as i16).collect();
            let volume = Volume::new(grid, data);
            for e in &ESTIMATORS {
                let estimate = (e.make)(&volume);
                let got = estimate.at(&volume, DVec3::new(4.3, 3.8, 4.5)).as_dvec3();
                // Stored values share one scale, which air at the border makes coarse.
                let within = if e.bytes == 3 { 9.0 } else { 1.5 };
                assert!((got - g).length() < within, "{}: {got}", e.name);
                let mut all = Vec::new();
                estimate.all(&volume, &[DVec3::new(4.3, 3.8, 4.5)], &mut |g| all.push(g.as_dvec3()));
                assert_eq!(all, [got]);
                // Finite outside, at the corner, and in a flat volume.
                assert!(estimate.at(&volume, DVec3::splat(-3.5)).is_finite());
                assert!(estimate.at(&volume, DVec3::splat(8.0)).is_finite());
            }
        }
        let flat = Volume::new(Grid::new([1; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap(), vec![-1024]);
        for e in &ESTIMATORS {
            assert_eq!((e.make)(&flat).at(&flat, DVec3::ZERO), Vec3::ZERO, "{}", e.name);
        }
    }
}
