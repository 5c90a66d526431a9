//! Exact intersections of rays with the wall. There is no step size, so no wall is too thin and no result depends on a setting.
//!
//! Between eight neighbouring voxels (a *cell*) the trilinear value along a ray is a cubic polynomial of the distance.
//! The ray walks from cell to cell (Amanatides and Woo 1987), computing the distance to each plane from the plane's
//! index so that no error accumulates. It leaps over empty bricks and passes cells whose corners are all below the
//! wall. In the other cells it finds the cubic's first root between its critical points.

use std::array::from_fn;

use glam::DVec3;

use crate::math::cubic::{self, critical_points};
use crate::volume::cell::{Cell, corners};
use crate::volume::{AIR_HU, Volume};

use super::flags::BRICK_SHIFT;
use super::prepared_volume::PreparedVolume;

/// How far below the wall a value may be and still count as touching it, HU. This is above the rounding of the cubics
/// and far below anything visible.
pub(crate) const TOUCH: f64 = 1e-9;

/// Returns the trilinear HU at a `world` point (mm, LPS). Outside the volume is air, mixed with the border voxels within one voxel.
pub fn value(volume: &PreparedVolume, world: DVec3) -> f32 {
    trilinear(volume.voxels(), volume.voxels().grid().voxel(world)) as f32
}

/// Returns the trilinear HU at voxel coordinates `p`, or air if they are not finite.
#[doc(hidden)]
pub fn trilinear(volume: &Volume, p: DVec3) -> f64 {
    let dims = volume.grid().dims();
    let inside = |a: usize| p[a] > -1.0 && p[a] < dims[a] as f64;
    if !(inside(0) && inside(1) && inside(2)) {
        return f64::from(AIR_HU);
    }
    let base = p.floor();
    Cell::load(volume, base.to_array().map(|c| c as i64)).at(p - base)
}

/// Returns the distance in mm from `origin` along `direction` (world; normalised here) to the wall.
///
/// The wall is where the trilinear volume first crosses from below to at least
/// [`TransferFunction::iso`](super::TransferFunction::iso), touching included. The distance is 0 if `origin` is already
/// there. It is `None` if there is no crossing within `max_mm` (which may be infinite), or if an argument is not finite
/// or `direction` is zero. From outside, the ray enters through air.
pub fn first_crossing(volume: &PreparedVolume, origin: DVec3, direction: DVec3, max_mm: f64) -> Option<f64> {
    first_crossing_counted(volume, origin, direction, max_mm, &mut 0)
}

/// Works like [`first_crossing`] and adds the number of cells and bricks that the ray visited to `cells`.
pub fn first_crossing_counted(
    volume: &PreparedVolume,
    origin: DVec3,
    direction: DVec3,
    max_mm: f64,
    cells: &mut u64,
) -> Option<f64> {
    let grid = volume.voxels().grid();
    let direction = unit(direction);
    if !origin.is_finite() || direction == DVec3::ZERO || max_mm.is_nan() || max_mm < 0.0 {
        return None;
    }
    let from = grid.voxel(origin);
    *cells += 1;
    if trilinear(volume.voxels(), from) >= volume.transfer().iso() - TOUCH {
        return Some(0.0);
    }
    let (enter, exit) = clip(grid.dims(), from, grid.to_voxel().transform_vector3(direction))?;
    let end = exit.min(max_mm);
    if enter > end {
        return None;
    }
    // Start at the box's border, so that a distant camera costs no precision inside.
    let start = grid.voxel(origin + direction * enter);
    let walk = Walk::new(volume, start, grid.to_voxel().transform_vector3(direction));
    walk.run(0.0, end - enter, cells).map(|t| enter + t)
}

/// Rays from one point that lie close together, such as those of neighbouring pixels.
///
/// How far none of them meets the wall is found once for all, by the box around them, step by step. From there on each
/// ray walks by itself. So its distance is exactly that of [`first_crossing`].
#[doc(hidden)]
pub struct Bundle<'a> {
    volume: &'a PreparedVolume,
    /// Voxel coordinates of the point.
    from: DVec3,
    /// Up to this distance no ray meets the wall, mm; 0 if that is not known.
    free: f64,
}

/// Steps that a bundle leaps at once where all bricks are empty.
const LEAP: f64 = 8.0;
/// The most voxels in the box around one step of a bundle. In a larger box some ray is likely to be in the wall.
const MOST_VOXELS: i64 = 512;
/// How much larger than the rays' own a bundle's box is, voxels. This is far above their rounding.
const AROUND: f64 = 1e-6;

impl<'a> Bundle<'a> {
    /// Creates the bundle of some rays, each an origin (world mm) and a unit direction.
    pub fn new(volume: &'a PreparedVolume, rays: impl Iterator<Item = (DVec3, DVec3)>) -> Self {
        let grid = volume.voxels().grid();
        let mut rays = rays.peekable();
        let origin = rays.peek().map_or(DVec3::NAN, |r| r.0);
        let mut bundle = Self { volume, from: grid.voxel(origin), free: 0.0 };
        let (mut least, mut most) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for (from, direction) in rays {
            if from != origin {
                return bundle;
            }
            let along = grid.to_voxel().transform_vector3(direction);
            (least, most) = (least.min(along), most.max(along));
        }
        let end = DVec3::from_array(grid.dims().map(|n| n as f64));
        let inside = bundle.from.cmpge(DVec3::NEG_ONE).all() && bundle.from.cmple(end).all();
        if inside && least.is_finite() && most.is_finite() {
            bundle.free = bundle.free(least, most);
        }
        bundle
    }

    /// Returns the distance along one of the rays to the wall: [`first_crossing`] without a limit.
    pub fn first_crossing(&self, (origin, direction): (DVec3, DVec3)) -> Option<f64> {
        if self.free == 0.0 {
            return first_crossing(self.volume, origin, direction, f64::INFINITY);
        }
        let grid = self.volume.voxels().grid();
        let along = grid.to_voxel().transform_vector3(unit(direction));
        let (_, exit) = clip(grid.dims(), self.from, along)?;
        if self.free >= exit { None } else { Walk::new(self.volume, self.from, along).run(self.free, exit, &mut 0) }
    }

    /// Returns how far no ray meets the wall, mm, if all move by `least` to `most`, voxels/mm.
    fn free(&self, least: DVec3, most: DVec3) -> f64 {
        let wall = self.volume.transfer().iso().ceil() as i16;
        let step = 1.0 / least.abs().max(most.abs()).max_element();
        // The first and last cells of all rays between two distances.
        let cells = |t: f64, until: f64| {
            let first = self.from + (least * t).min(least * until) - AROUND;
            let last = self.from + (most * t).max(most * until) + AROUND;
            (first.floor().as_i64vec3().to_array(), last.floor().as_i64vec3().to_array())
        };
        let ends = self.volume.voxels().grid().dims().map(|n| n as i64 - 1);
        let left = |first: [i64; 3], last: [i64; 3]| (0..3).any(|a| last[a] < -1 || first[a] > ends[a]);
        let mut t = 0.0;
        if wall <= AIR_HU {
            return t;
        }
        loop {
            let (first, last) = cells(t, t + LEAP * step);
            if left(first, last) {
                return t;
            }
            if self.empty_bricks(first, last) {
                t += LEAP * step;
                continue;
            }
            let (first, last) = cells(t, t + step);
            if left(first, last) || !self.is_below(wall, first, last) {
                return t;
            }
            t += step;
        }
    }

    /// True if the bricks of the cells `first` to `last` are few, and empty.
    fn empty_bricks(&self, first: [i64; 3], last: [i64; 3]) -> bool {
        let flags = self.volume.flags();
        let bricks = flags.bricks().map(|n| n as i64);
        let range = |a: usize| {
            let brick = |cell: i64| ((cell + 1) >> BRICK_SHIFT).clamp(0, bricks[a] - 1);
            brick(first[a])..=brick(last[a])
        };
        let few = (0..3).all(|a| last[a] - first[a] <= 4 << BRICK_SHIFT);
        few && range(2).all(|z| {
            range(1).all(|y| range(0).all(|x| flags.empty_brick((x + bricks[0] * (y + bricks[1] * z)) as isize)))
        })
    }

    /// True if the corners of the cells `first` to `last` are few, and below the wall. Those outside the volume are air.
    fn is_below(&self, wall: i16, first: [i64; 3], last: [i64; 3]) -> bool {
        let grid = self.volume.voxels().grid();
        let (data, dims) = (self.volume.voxels().data(), grid.dims());
        let [x, y, z] = from_fn(|a| first[a].max(0) as usize..((last[a] + 2).max(0) as usize).min(dims[a]));
        let few = (0..3).map(|a| last[a] - first[a] + 2).product::<i64>() <= MOST_VOXELS;
        few && z.into_iter().all(|z| {
            y.clone().all(|y| {
                let row = grid.index(0, y, z);
                x.is_empty() || data[row + x.start..row + x.end].iter().all(|&v| v < wall)
            })
        })
    }
}

/// Returns a direction of unit length, or zero if it has none.
#[inline(always)]
fn unit(direction: DVec3) -> DVec3 {
    // Normalise twice, so that neither denormal nor huge components lose the direction.
    (direction / direction.abs().max_element()).normalize_or_zero()
}

/// Components slower than this (voxels/mm) count as zero: even 10⁹ mm of path would move by less than a millionth of a voxel.
pub(crate) const STILL: f64 = 1e-15;

/// Returns the distances at which the ray `from + t · along` (voxel coordinates) enters and leaves the volume grown by
/// one voxel, or `None` if it misses the volume or the volume is behind it. The first is never negative.
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

/// A ray walking through the cells −1 … n − 1 of each axis.
#[derive(Clone, Copy)]
struct Walk<'a> {
    volume: &'a PreparedVolume,
    iso: f64,
    /// The least whole HU that is at or above the wall.
    wall: i16,
    from: DVec3,
    along: DVec3,
    inverse: DVec3,
    last: [i64; 3],
    step: [i64; 3],
}

impl<'a> Walk<'a> {
    fn new(volume: &'a PreparedVolume, from: DVec3, along: DVec3) -> Self {
        let last = volume.voxels().grid().dims().map(|n| n as i64 - 1);
        let step = from_fn(|a| if along[a].abs() < STILL { 0 } else { along[a].signum() as i64 });
        let iso = volume.transfer().iso();
        Self { volume, iso, wall: iso.ceil() as i16, from, along, inverse: along.recip(), last, step }
    }

    /// Returns the distance to the first crossing between `begin` and `end`; none is before.
    ///
    /// Each iteration advances by at least one cell and none moves back, so there are at most as many iterations as the
    /// three axes have cells.
    fn run(&self, begin: f64, end: f64, cells: &mut u64) -> Option<f64> {
        let first = (self.from + self.along * begin).floor();
        let mut cell: [i64; 3] = from_fn(|a| (first[a] as i64).clamp(-1, self.last[a]));
        let mut t = begin;
        let mut planes = self.planes(&cell, &cell);
        let bricks = self.volume.flags().bricks().map(|n| n as i64);
        loop {
            *cells += 1;
            let brick = cell.map(|c| (c + 1) >> BRICK_SHIFT);
            let (axis, next);
            let index = brick[0] + bricks[0] * (brick[1] + bricks[1] * brick[2]);
            if self.volume.flags().empty_brick(index as isize) {
                let first = brick.map(|b| (b << BRICK_SHIFT) - 1);
                let last = first.map(|c| c + (1 << BRICK_SHIFT) - 1);
                (axis, next) = nearest(&self.planes(&first, &last));
                for a in 0..3 {
                    if self.step[a] == 0 {
                        continue;
                    }
                    let here = ((self.from[a] + self.along[a] * next).floor() as i64).clamp(first[a], last[a]);
                    // Rounding must not move the walk back.
                    cell[a] = if self.step[a] > 0 { here.max(cell[a]) } else { here.min(cell[a]) };
                }
                cell[axis] = if self.step[axis] > 0 { last[axis] + 1 } else { first[axis] - 1 };
                planes = self.planes(&cell, &cell);
            } else {
                (axis, next) = nearest(&planes);
                if let Some(hit) = self.cross(cell, t, next.min(end)) {
                    return Some(hit.min(end));
                }
                cell[axis] += self.step[axis];
                planes[axis] = self.plane(axis, cell[axis], cell[axis]);
            }
            t = t.max(next);
            if t >= end || cell[axis] < -1 || cell[axis] > self.last[axis] {
                return None;
            }
        }
    }

    /// Returns the distance at which the ray leaves the cells `first` to `last` along an axis.
    #[inline(always)]
    fn plane(&self, axis: usize, first: i64, last: i64) -> f64 {
        match self.step[axis] {
            0 => f64::INFINITY,
            s => ((if s > 0 { last + 1 } else { first }) as f64 - self.from[axis]) * self.inverse[axis],
        }
    }

    #[inline(always)]
    fn planes(&self, first: &[i64; 3], last: &[i64; 3]) -> [f64; 3] {
        from_fn(|a| self.plane(a, first[a], last[a]))
    }

    /// Returns the value beside the wall's along a cell as a cubic, lowest power first, from 0 at the distance `t` of its entry to 1 at
    /// `until`, that of its exit, and the length between them; `None` if the ray does not reach the wall there.
    #[inline(always)]
    fn cubic(&self, base: [i64; 3], t: f64, until: f64) -> Option<([f64; 4], f64)> {
        let corners = corners(self.volume.voxels(), base);
        // The walk stays in air before the wall, so nearly all cells end here.
        if corners.iter().all(|&c| c < self.wall) {
            return None;
        }
        let length = (until - t).max(0.0);
        let enter = self.from + self.along * t - DVec3::new(base[0] as f64, base[1] as f64, base[2] as f64);
        let [d, c, b, a] = Cell::new(corners).along(enter, self.along * length);
        let d = d - self.iso;
        // The cubic stays within the hull of its Bernstein coefficients: most cells that hold wall are passed beside it.
        let (low, high) = (d + c * (1.0 / 3.0), d + (2.0 * c + b) * (1.0 / 3.0));
        let is_beside = d.max(low).max(high).max(d + c + b + a) < -BESIDE;
        (!is_beside).then_some(([d, c, b, a], length))
    }

    /// Returns the first crossing within a cell, between the distances `t` and `until` of its entry and exit.
    #[inline(always)]
    fn cross(&self, base: [i64; 3], t: f64, until: f64) -> Option<f64> {
        let (cubic, length) = self.cubic(base, t, until)?;
        first_root(cubic).map(|s| t + s * length)
    }

    /// Does the same as [`Walk::cross`] to within a billionth of a cell, and faster where the value rises throughout the cell.
    #[inline(always)]
    fn cross_soon(&self, base: [i64; 3], t: f64, until: f64) -> Option<f64> {
        let ([d, c, b, a], length) = self.cubic(base, t, until)?;
        let end = d + c + b + a;
        // The slope's Bernstein coefficients.
        let rises = c > 0.0 && c + b > 0.0 && c + 2.0 * b + 3.0 * a > 0.0;
        if !(rises && d < -BESIDE) {
            return first_root([d, c, b, a]).map(|s| t + s * length);
        }
        if end < 0.0 {
            return (end >= -TOUCH).then_some(t + length);
        }
        rising_root([d, c, b, a], end).map_or_else(|| first_root([d, c, b, a]), Some).map(|s| t + s * length)
    }
}

/// A ray that stays this far below the wall's value throughout a cell does not touch it there, HU: far above rounding.
pub(crate) const BESIDE: f64 = 1e-6;

/// A ray for those who know which cells to look into.
#[derive(Clone, Copy)]
pub(crate) struct Segment<'a>(Walk<'a>);

impl<'a> Segment<'a> {
    /// Creates the ray `from + t · along` (voxel coordinates).
    pub(crate) fn new(volume: &'a PreparedVolume, from: DVec3, along: DVec3) -> Self {
        Self(Walk::new(volume, from, along))
    }

    /// Returns −1, 0 or 1: the direction in which it passes cells along an axis.
    #[inline(always)]
    pub(crate) fn step(&self, axis: usize) -> i64 {
        self.0.step[axis]
    }

    /// Returns the first crossing within a cell, between the distances `t` and `until` of its entry and exit, mm.
    #[inline(always)]
    pub(crate) fn cross(&self, cell: [i64; 3], t: f64, until: f64) -> Option<f64> {
        self.0.cross_soon(cell, t, until)
    }
}

/// Returns the axis whose plane is met first, and its distance.
#[inline(always)]
fn nearest(planes: &[f64; 3]) -> (usize, f64) {
    let xy = if planes[1] < planes[0] { 1 } else { 0 };
    let axis = if planes[2] < planes[xy] { 2 } else { xy };
    (axis, planes[axis])
}

/// Returns the first s in [0, 1] at which the cubic (lowest power first, HU) is at least 0, up to [`TOUCH`].
fn first_root(c: [f64; 4]) -> Option<f64> {
    if c[0] >= -TOUCH {
        return Some(0.0);
    }
    let mut from = (0.0, c[0]);
    for to in critical_points(c).into_iter().chain([1.0]) {
        if !(to > from.0 && to <= 1.0) {
            continue;
        }
        let at = cubic::value(c, to);
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

/// Returns the root of a cubic that rises from below 0 at 0 to `end` at 1, by Newton's method from the chord; `None` if that leaves 0 to 1 or
/// does not settle, which takes a steep cubic.
#[inline(always)]
fn rising_root(c: [f64; 4], end: f64) -> Option<f64> {
    let mut s = -c[0] / (end - c[0]);
    for _ in 0..8 {
        let slope = c[1] + s * (2.0 * c[2] + s * 3.0 * c[3]);
        let next = s - cubic::value(c, s) / slope;
        if (next - s).abs() < 1e-10 {
            return (0.0..=1.0).contains(&next).then_some(next);
        }
        s = next;
        if !(0.0..=1.0).contains(&s) {
            return None;
        }
    }
    None
}

/// Finds the root of a cubic that rises monotonically from below 0 at `lo` to at least 0 at `hi`. It uses Newton's
/// method, kept within its bracket by bisection.
fn root_between(c: [f64; 4], lo: (f64, f64), hi: (f64, f64)) -> f64 {
    let (mut a, mut b) = (lo.0, hi.0);
    let mut s = a - lo.1 * (b - a) / (hi.1 - lo.1);
    for _ in 0..64 {
        let value = cubic::value(c, s);
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
