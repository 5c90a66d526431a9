//! Where a ray meets the wall, exactly: no step size, so that no wall is too thin and no answer depends on a setting.
//!
//! Between eight neighbouring voxels (a *cell*) the trilinear value along a ray is a cubic polynomial of the distance.
//! The ray walks from cell to cell (Amanatides and Woo 1987, the distance to each plane computed anew from the plane's
//! index, so that nothing accumulates), leaps over empty bricks, passes cells whose corners are all below the wall, and
//! in the others finds the cubic's first root between its critical points.

use std::array::from_fn;

use glam::DVec3;

use crate::volume::{AIR_HU, Volume};

use super::flags::BRICK_SHIFT;
use super::space::Space;

/// How far below the wall a value may lie and count as touching it, HU: above the rounding of the cubics, and far below
/// anything that can be seen.
const TOUCH: f64 = 1e-9;

/// Trilinear HU at a `world` point (mm, LPS). Outside the volume is air, mixed with the border voxels within one voxel.
pub fn value(space: &Space, world: DVec3) -> f32 {
    trilinear(space.volume(), space.volume().grid().voxel(world)) as f32
}

/// Trilinear HU at voxel coordinates `p`; air where they are not finite.
pub(crate) fn trilinear(volume: &Volume, p: DVec3) -> f64 {
    let dims = volume.grid().dims();
    let inside = |a: usize| p[a] > -1.0 && p[a] < dims[a] as f64;
    if !(inside(0) && inside(1) && inside(2)) {
        return f64::from(AIR_HU);
    }
    let base = p.floor();
    Cell::load(volume, base.to_array().map(|c| c as i64)).at(p - base)
}

/// Distance in mm from `origin` along `direction` (world; normalised here) to where the trilinear volume first crosses
/// from below to at least the wall ([`Wall::iso`](super::Wall::iso)), touching included.
///
/// 0 if `origin` is already there. `None` if there is no crossing within `max_mm` (which may be infinite), or if an
/// argument is not finite or `direction` is zero. From outside, the ray walks in through air.
pub fn first_crossing(space: &Space, origin: DVec3, direction: DVec3, max_mm: f64) -> Option<f64> {
    first_crossing_counted(space, origin, direction, max_mm, &mut 0)
}

/// [`first_crossing`], adding to `cells` the number of cells and bricks that the ray visited.
pub fn first_crossing_counted(
    space: &Space,
    origin: DVec3,
    direction: DVec3,
    max_mm: f64,
    cells: &mut u64,
) -> Option<f64> {
    let grid = space.volume().grid();
    // Twice, so that neither denormal nor huge components lose the direction.
    let direction = (direction / direction.abs().max_element()).normalize_or_zero();
    if !origin.is_finite() || direction == DVec3::ZERO || max_mm.is_nan() || max_mm < 0.0 {
        return None;
    }
    let from = grid.voxel(origin);
    *cells += 1;
    if trilinear(space.volume(), from) >= space.wall().iso() - TOUCH {
        return Some(0.0);
    }
    let (enter, exit) = clip(grid.dims(), from, grid.to_voxel().transform_vector3(direction))?;
    let end = exit.min(max_mm);
    if enter > end {
        return None;
    }
    // From the box's border on, so that a camera far away costs no precision inside.
    let start = grid.voxel(origin + direction * enter);
    let walk = Walk::new(space, start, grid.to_voxel().transform_vector3(direction));
    walk.run(end - enter, cells).map(|t| enter + t)
}

/// Slower components than this (voxels/mm) are none: even 10⁹ mm of path would move by less than a voxel's millionth.
const STILL: f64 = 1e-15;

/// Distances at which the ray `from + t · along` (voxel coordinates) enters and leaves the volume grown by one voxel;
/// `None` if it misses it or leaves it behind. The first is never negative.
pub(crate) fn clip(dims: [usize; 3], from: DVec3, along: DVec3) -> Option<(f64, f64)> {
    let (mut enter, mut exit) = (0.0f64, f64::INFINITY);
    for a in 0..3 {
        let (lo, hi) = (-1.0 - from[a], dims[a] as f64 - from[a]);
        if along[a].abs() < STILL {
            if lo > 0.0 || hi < 0.0 {
                return None;
            }
            continue;
        }
        let (near, far) = (lo / along[a], hi / along[a]);
        enter = enter.max(near.min(far));
        exit = exit.min(near.max(far));
    }
    (enter <= exit && exit.is_finite()).then_some((enter, exit))
}

/// A ray on its way through the cells −1 … n − 1 of each axis.
struct Walk<'a> {
    space: &'a Space,
    iso: f64,
    from: DVec3,
    along: DVec3,
    last: [i64; 3],
    step: [i64; 3],
}

impl<'a> Walk<'a> {
    fn new(space: &'a Space, from: DVec3, along: DVec3) -> Self {
        let last = space.volume().grid().dims().map(|n| n as i64 - 1);
        let step = from_fn(|a| if along[a].abs() < STILL { 0 } else { along[a].signum() as i64 });
        Self { space, iso: space.wall().iso(), from, along, last, step }
    }

    /// Distance to the first crossing within `end`. Each turn moves on by at least one cell and none ever moves back,
    /// so there are at most as many turns as the three axes have cells.
    fn run(&self, end: f64, cells: &mut u64) -> Option<f64> {
        let mut cell: [i64; 3] = from_fn(|a| (self.from[a].floor() as i64).clamp(-1, self.last[a]));
        let mut t = 0.0;
        loop {
            *cells += 1;
            let brick = cell.map(|c| (c + 1) >> BRICK_SHIFT);
            let [bx, by, bz] = brick.map(|b| b as usize);
            let (axis, next);
            if self.space.flags().empty_brick(bx, by, bz) {
                let first = brick.map(|b| (b << BRICK_SHIFT) - 1);
                let last = first.map(|c| c + (1 << BRICK_SHIFT) - 1);
                (axis, next) = self.leave(&first, &last);
                for a in 0..3 {
                    if self.step[a] == 0 {
                        continue;
                    }
                    let here = ((self.from[a] + self.along[a] * next).floor() as i64).clamp(first[a], last[a]);
                    // Rounding must not turn the walk back.
                    cell[a] = if self.step[a] > 0 { here.max(cell[a]) } else { here.min(cell[a]) };
                }
                cell[axis] = if self.step[axis] > 0 { last[axis] + 1 } else { first[axis] - 1 };
            } else {
                (axis, next) = self.leave(&cell, &cell);
                if let Some(hit) = self.cross(cell, t, next.min(end)) {
                    return Some(hit.min(end));
                }
                cell[axis] += self.step[axis];
            }
            t = t.max(next);
            if t >= end || cell[axis] < -1 || cell[axis] > self.last[axis] {
                return None;
            }
        }
    }

    /// The axis along which the ray leaves the cells `first` to `last`, and the distance at which it does.
    #[inline(always)]
    fn leave(&self, first: &[i64; 3], last: &[i64; 3]) -> (usize, f64) {
        let mut best = (0, f64::INFINITY);
        for a in 0..3 {
            let plane = if self.step[a] > 0 { last[a] + 1 } else { first[a] };
            let t = (plane as f64 - self.from[a]) / self.along[a];
            if self.step[a] != 0 && t < best.1 {
                best = (a, t);
            }
        }
        best
    }

    /// First crossing within a cell, between the distances `t` and `until` of its entry and exit.
    #[inline(always)]
    fn cross(&self, base: [i64; 3], t: f64, until: f64) -> Option<f64> {
        let corners = corners(self.space.volume(), base);
        // The walk stays in air before the wall, so nearly all cells end here.
        if corners.iter().all(|&c| f64::from(c) < self.iso) {
            return None;
        }
        let length = (until - t).max(0.0);
        let enter = self.from + self.along * t - DVec3::new(base[0] as f64, base[1] as f64, base[2] as f64);
        let [d, c, b, a] = Cell::new(corners).along(enter, self.along * length);
        first_root([d - self.iso, c, b, a]).map(|s| t + s * length)
    }
}

/// The eight corners of the cell at `base`: x fastest, then y, then z.
#[inline(always)]
fn corners(volume: &Volume, base: [i64; 3]) -> [i16; 8] {
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

/// A cell's value as k₀ + k₁u + k₂v + k₃w + k₄uv + k₅uw + k₆vw + k₇uvw of the coordinates within it.
struct Cell([f64; 8]);

impl Cell {
    fn load(volume: &Volume, base: [i64; 3]) -> Self {
        Self::new(corners(volume, base))
    }

    fn new(corners: [i16; 8]) -> Self {
        let [a, b, c, d, e, f, g, h] = corners.map(f64::from);
        Self([a, b - a, c - a, e - a, d - c - b + a, f - e - b + a, g - e - c + a, h - g - f + e - d + c + b - a])
    }

    fn at(&self, p: DVec3) -> f64 {
        let [k0, k1, k2, k3, k4, k5, k6, k7] = self.0;
        let (u, v, w) = (p.x, p.y, p.z);
        k0 + k1 * u + k2 * v + k3 * w + k4 * u * v + k5 * u * w + k6 * v * w + k7 * u * v * w
    }

    /// Coefficients, lowest power first, of the value at `p + s·d` as a cubic of s.
    fn along(&self, p: DVec3, d: DVec3) -> [f64; 4] {
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

/// The first s in [0, 1] at which the cubic (lowest power first, HU) is at least 0, up to [`TOUCH`].
fn first_root(c: [f64; 4]) -> Option<f64> {
    let g = |s: f64| c[0] + s * (c[1] + s * (c[2] + s * c[3]));
    if c[0] >= -TOUCH {
        return Some(0.0);
    }
    let mut from = (0.0, c[0]);
    for to in critical_points(c).into_iter().chain([1.0]) {
        if !(to > from.0 && to <= 1.0) {
            continue;
        }
        let at = g(to);
        if at >= 0.0 {
            return Some(root_between(c, from, (to, at)));
        }
        if at >= -TOUCH {
            return Some(to);
        }
        from = (to, at);
    }
    None
}

/// The two zeros of the cubic's derivative, in order; NaN where there are none.
fn critical_points([_, b, c, d]: [f64; 4]) -> [f64; 2] {
    // 3d s² + 2c s + b = 0, by the form that does not cancel.
    let disc = c * c - 3.0 * d * b;
    if disc < 0.0 {
        return [f64::NAN; 2];
    }
    let q = -(c + disc.sqrt().copysign(c));
    let (x, y) = (q / (3.0 * d), b / q);
    if x > y { [y, x] } else { [x, y] }
}

/// The root of a cubic that rises from below 0 at `lo` to at least 0 at `hi` without turning: Newton's method, kept
/// within its bracket by bisection.
fn root_between(c: [f64; 4], lo: (f64, f64), hi: (f64, f64)) -> f64 {
    let (mut a, mut b) = (lo.0, hi.0);
    let mut s = a - lo.1 * (b - a) / (hi.1 - lo.1);
    for _ in 0..64 {
        let value = c[0] + s * (c[1] + s * (c[2] + s * c[3]));
        let slope = c[1] + s * (2.0 * c[2] + s * 3.0 * c[3]);
        if value >= 0.0 {
            b = s;
        } else {
            a = s;
        }
        let newton = s - value / slope;
        let next = if newton > a && newton < b { newton } else { 0.5 * (a + b) };
        if (next - s).abs() < 1e-14 || b - a < 1e-14 {
            return next;
        }
        s = next;
    }
    s
}

#[cfg(test)]
#[path = "ray_tests.rs"]
mod tests;
