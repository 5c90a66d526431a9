//! A cubic B-spline over voxels, with its first and second derivatives in the world.

use glam::{DMat3, DVec3};

use crate::fields::Sample;
use crate::volume::Grid;

/// Returns the uniform cubic B-spline's weights of the four voxels around a position at fraction `t` after the second
/// one, with their first and second derivatives (per voxel).
fn weights(t: f64) -> [[f64; 4]; 3] {
    let u = 1.0 - t;
    [
        [u * u * u / 6.0, 2.0 / 3.0 - t * t * (1.0 - 0.5 * t), 2.0 / 3.0 - u * u * (1.0 - 0.5 * u), t * t * t / 6.0],
        [-0.5 * u * u, t * (1.5 * t - 2.0), u * (2.0 - 1.5 * u), 0.5 * t * t],
        [u, 3.0 * t - 2.0, 1.0 - 3.0 * t, t],
    ]
}

/// Derivative orders (x, y, z) that are computed: value, gradient, Hessian.
const ORDERS: [[usize; 3]; 10] =
    [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [2, 0, 0], [0, 2, 0], [0, 0, 2], [1, 1, 0], [1, 0, 1], [0, 1, 1]];

/// A spline's value with its derivatives per voxel.
#[derive(Clone, Copy, Debug, Default)]
struct Local {
    value: f64,
    gradient: DVec3,
    hessian: DMat3,
}

impl Local {
    fn of([value, x, y, z, xx, yy, zz, xy, xz, yz]: [f64; 10]) -> Self {
        let hessian = DMat3::from_cols(DVec3::new(xx, xy, xz), DVec3::new(xy, yy, yz), DVec3::new(xz, yz, zz));
        Self { value, gradient: DVec3::new(x, y, z), hessian }
    }

    fn in_world(self, grid: &Grid) -> Sample {
        let inverse = grid.to_voxel().matrix3;
        Sample {
            mm: self.value,
            gradient: inverse.transpose() * self.gradient,
            hessian: inverse.transpose() * self.hessian * inverse,
        }
    }
}

/// Calls `visit` for each of the 64 voxels around a world point with its weight and the weight's derivatives, until it
/// returns false. Returns `None` outside the grid, for a point that is not finite, and after a false. Beyond the grid's
/// border the outermost voxels are repeated.
fn each(grid: &Grid, at: DVec3, mut visit: impl FnMut([i64; 3], &[f64; 10]) -> bool) -> Option<()> {
    let u = grid.voxel(at);
    let last = DVec3::from_array(grid.dims().map(|n| n as f64 - 1.0));
    if !(u.cmpge(DVec3::splat(-0.5)).all() && u.cmple(last + 0.5).all()) {
        return None;
    }
    let base = u.floor();
    let t = u - base;
    let w = [weights(t.x), weights(t.y), weights(t.z)];
    let top = grid.dims().map(|n| n as i64 - 1);
    let index = |a: usize, n: usize| (base[a] as i64 + n as i64 - 1).clamp(0, top[a]);
    for c in 0..4 {
        for b in 0..4 {
            for a in 0..4 {
                let weight = ORDERS.map(|o| w[0][o[0]][a] * w[1][o[1]][b] * w[2][o[2]][c]);
                if !visit([index(0, a), index(1, b), index(2, c)], &weight) {
                    return None;
                }
            }
        }
    }
    Some(())
}

fn add(sums: &mut [f64; 10], weight: &[f64; 10], value: f64) {
    sums.iter_mut().zip(weight).for_each(|(s, w)| *s += w * value);
}

/// Evaluates the spline at a world point, with `value` (mm) at each voxel as its coefficients; `None` if one is missing.
pub(in crate::fields) fn sample(grid: &Grid, at: DVec3, value: impl Fn([i64; 3]) -> Option<f32>) -> Option<Sample> {
    let mut sums = [0.0; 10];
    each(grid, at, |v, weight| value(v).map(|x| add(&mut sums, weight, f64::from(x))).is_some())?;
    Some(Local::of(sums).in_world(grid))
}

/// Same as [`sample`], using only the voxels that have a value, with weights scaled to a sum of 1; `None` if there are none.
pub(in crate::fields) fn sample_some(
    grid: &Grid,
    at: DVec3,
    value: impl Fn([i64; 3]) -> Option<f32>,
) -> Option<Sample> {
    let (mut sums, mut shares) = ([0.0; 10], [0.0; 10]);
    each(grid, at, |v, weight| {
        if let Some(x) = value(v) {
            add(&mut sums, weight, f64::from(x));
            add(&mut shares, weight, 1.0);
        }
        true
    })?;
    let (n, w) = (Local::of(sums), Local::of(shares));
    if w.value < 1e-6 {
        return None;
    }
    // The quotient rule, twice.
    let value = n.value / w.value;
    let gradient = (n.gradient - w.gradient * value) / w.value;
    let outer = |a: DVec3, b: DVec3| DMat3::from_cols(a * b.x, a * b.y, a * b.z);
    let mixed = outer(gradient, w.gradient) + outer(w.gradient, gradient);
    let hessian = (n.hessian - mixed - w.hessian * value) * (1.0 / w.value);
    Some(Local { value, gradient, hessian }.in_world(grid))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn oblique() -> Grid {
        let d = DMat3::from_cols(DVec3::NEG_X, DVec3::new(0.0, 0.8, 0.6), DVec3::new(0.0, -0.6, 0.8));
        Grid::new([9, 10, 11], DVec3::new(0.5, 0.7, 1.2), DVec3::new(3.0, -2.0, 5.0), d).unwrap()
    }

    #[test]
    fn a_linear_field_is_reproduced() {
        let grid = oblique();
        let slope = DVec3::new(0.3, -0.7, 0.2);
        let value = |v: [i64; 3]| Some(slope.dot(grid.world(DVec3::new(v[0] as f64, v[1] as f64, v[2] as f64))) as f32);
        let at = grid.world(DVec3::new(4.3, 5.1, 6.7));
        let s = sample(&grid, at, value).unwrap();
        assert!((s.mm - slope.dot(at)).abs() < 1e-5);
        assert!((s.gradient - slope).length() < 1e-5);
        assert!(s.hessian.to_cols_array().iter().all(|h| h.abs() < 1e-4));
    }

    /// Compares derivatives with differences of the spline itself. It has two continuous ones, across voxels too.
    #[test]
    fn derivatives_are_those_of_the_spline() {
        let grid = oblique();
        let value = |v: [i64; 3]| Some(crate::math::hash::normal(5, (v[0] + 20 * v[1] + 400 * v[2]) as u64) as f32);
        for u in [DVec3::new(4.0, 5.0, 6.0), DVec3::new(3.25, 4.999_999, 5.5)] {
            let at = grid.world(u);
            let s = sample(&grid, at, value).unwrap();
            let e = 1e-5;
            for a in 0..3 {
                let step = DVec3::AXES[a] * e;
                let (p, m) = (sample(&grid, at + step, value).unwrap(), sample(&grid, at - step, value).unwrap());
                assert!((s.gradient[a] - (p.mm - m.mm) / (2.0 * e)).abs() < 1e-6);
                let column = (p.gradient - m.gradient) / (2.0 * e);
                assert!((s.hessian.col(a) - column).length() < 1e-3 * (1.0 + column.length()), "{column}");
            }
        }
    }

    /// Same for the scaled spline, with holes.
    #[test]
    fn derivatives_of_the_scaled_spline() {
        let grid = oblique();
        let hash = |v: [i64; 3]| crate::math::hash::normal(6, (v[0] + 20 * v[1] + 400 * v[2]) as u64);
        let value = |v: [i64; 3]| Some(hash(v) as f32).filter(|_| v[0] > 3);
        let at = grid.world(DVec3::new(4.2, 5.4, 6.1));
        let s = sample_some(&grid, at, value).unwrap();
        let e = 1e-5;
        for a in 0..3 {
            let step = DVec3::AXES[a] * e;
            let (p, m) = (sample_some(&grid, at + step, value).unwrap(), sample_some(&grid, at - step, value).unwrap());
            assert!((s.gradient[a] - (p.mm - m.mm) / (2.0 * e)).abs() < 1e-6);
            let column = (p.gradient - m.gradient) / (2.0 * e);
            assert!((s.hessian.col(a) - column).length() < 1e-3 * (1.0 + column.length()), "{column}");
        }
        assert_eq!(sample_some(&grid, at, |_| None), None);
    }

    #[test]
    fn nonsense_is_nowhere() {
        let grid = oblique();
        for at in [DVec3::NAN, DVec3::splat(1e300), DVec3::INFINITY, grid.world(DVec3::splat(-2.0))] {
            assert_eq!(sample(&grid, at, |_| Some(1.0)), None);
        }
        assert_eq!(sample(&grid, grid.world(DVec3::splat(4.0)), |_| None), None);
    }

    /// A voxel reaches half its size beyond its centre, on every side of the grid.
    #[test]
    fn the_spline_ends_at_the_edges_of_the_outermost_voxels() {
        let grid = oblique();
        let last = DVec3::from_array(grid.dims().map(|n| n as f64 - 1.0));
        for a in 0..3 {
            for (inside, u) in [(true, -0.49), (false, -0.51), (true, last[a] + 0.49), (false, last[a] + 0.51)] {
                let mut at = DVec3::splat(4.0);
                at[a] = u;
                let found = sample(&grid, grid.world(at), |_| Some(1.0));
                assert_eq!(found.is_some(), inside, "{at}");
                assert!(found.is_none_or(|s| (s.mm - 1.0).abs() < 1e-9), "{at}");
            }
        }
    }
}
