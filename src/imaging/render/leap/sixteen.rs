//! Sixteen exact crossings at once, for rays from one point that lie close together.
//!
//! All rays leap together in single precision until they come to a cell in which the value along them comes near the wall's. What they
//! pass over is free of wall for certain: the value changes by less than [`MARGIN`] over what positions are wrong by. In the cell that is left the crossing is that of [`first_crossing`](crate::space::first_crossing): the first root of
//! the cubic between the planes where the ray enters and leaves the cell, in double precision. Where the value rises throughout the cell,
//! eight roots are found at once by Newton's method from the chord; the few other rays go on one by one.
//!
//! There are no fused multiplications, so every SIMD level gives the same bits.

use std::array::from_fn;

use fearless_simd::{Simd, f32x16, f64x8, i32x16, mask32x16, prelude::*};
use glam::DVec3;

use super::crossings::{Crossings, RaysFrom};
use crate::render::camera::Sixteen;
use crate::render::packets::lanes::{Corners, Padded, Voxels};
use crate::space::ray::{BESIDE, STILL, Segment, TOUCH};

/// How far a leap goes beyond the plane that it ends at, voxels. It is above the rounding of distances, so that all rays move on.
const BEYOND: f64 = 3e-4;
/// A ray may meet the wall in a cell if the value along it comes this near for each voxel of the longest axis, HU: over what positions are
/// wrong by, no value changes more, unless two neighbouring voxels differ by more than 4000 HU. Where they do, a ray that crosses the wall
/// is found to be in it where it enters the next cell, and goes on by itself from a little before that one; only what a ray touches for
/// less than a thousandth of a voxel may be missed.
const MARGIN: f32 = 1.0 / 512.0;
/// Axes along which single precision moves slower than this count as at rest, voxels/mm.
const STILL_32: f32 = 1e-12;
/// The most steps of Newton's method. More are needed only where the cubic is steep, by rays one by one.
const STEPS: usize = 8;

/// Sixteen numbers in double precision.
pub(super) type Doubles<S> = [f64x8<S>; 2];

/// Sixteen rays on their way, in voxels/mm.
struct Rays<S: Simd> {
    along: [Doubles<S>; 3],
    inverse: [Doubles<S>; 3],
    /// Distances at which they end, mm: at most where they leave the volume.
    ends: Doubles<S>,
}

/// The same in single precision.
pub(super) struct Way<S: Simd> {
    pub along: [f32x16<S>; 3],
    pub inverse: [f32x16<S>; 3],
}

impl<S: Simd> Way<S> {
    /// An axis at rest becomes one along which the ray moves by nothing that matters.
    #[inline(always)]
    pub(super) fn new(simd: S, along: [Doubles<S>; 3]) -> Self {
        let least = f32x16::splat(simd, STILL_32);
        let moving = |[low, high]: Doubles<S>| {
            let along = simd.narrow_f64x8(low, high);
            along.abs().simd_lt(STILL_32).select(least, along)
        };
        let along = [moving(along[0]), moving(along[1]), moving(along[2])];
        let one = f32x16::splat(simd, 1.0);
        Self { along, inverse: [one / along[0], one / along[1], one / along[2]] }
    }
}

impl RaysFrom<'_> {
    /// Returns the distance in mm along each of sixteen directions (world; of unit length) to the wall, as [`RaysFrom::first`]; infinite
    /// where there is none within `ends`, mm. An end of 0 or less tells that a ray is not asked for. Before `begins`, mm, there must be no
    /// wall: see [`RaysFrom::clear`].
    pub fn sixteen(&self, directions: &Sixteen, begins: &[f64; 16], ends: &[f64; 16]) -> [f64; 16] {
        let one = |k: usize| DVec3::new(directions[0][k], directions[1][k], directions[2][k]);
        let alone = |k: usize| self.first(one(k)).filter(|mm| *mm <= ends[k]).unwrap_or(f64::INFINITY);
        let is_asked = |k: usize| ends[k] > 0.0;
        let Some((voxels, free)) = &self.lanes else {
            return from_fn(|k| if is_asked(k) { alone(k) } else { f64::INFINITY });
        };
        fearless_simd::dispatch!(self.crossings.level, simd => self.leap(simd, (voxels, free), directions, [begins, ends]))
    }

    /// Returns the directions in voxels/mm.
    #[inline(always)]
    pub(super) fn along<S: Simd>(&self, simd: S, directions: &Sixteen) -> [Doubles<S>; 3] {
        let m = self.crossings.volume.voxels().grid().to_voxel().matrix3.to_cols_array_2d();
        let load = |a: usize, half: usize| f64x8::from_slice(simd, &directions[a][8 * half..8 * half + 8]);
        let along = |a: usize, half: usize| load(0, half) * m[0][a] + load(1, half) * m[1][a] + load(2, half) * m[2][a];
        [[along(0, 0), along(0, 1)], [along(1, 0), along(1, 1)], [along(2, 0), along(2, 1)]]
    }

    /// Returns the rays, and those of them that are asked for.
    #[inline(always)]
    fn rays<S: Simd>(&self, simd: S, directions: &Sixteen, ends: &[f64; 16]) -> (Rays<S>, mask32x16<S>) {
        let from = self.from.to_array();
        let dims = self.crossings.volume.voxels().grid().dims().map(|n| n as f64);
        let splat = |x: f64| f64x8::splat(simd, x);
        let (zero, one, far) = (splat(0.0), splat(1.0), splat(f64::INFINITY));
        let mut rays = Rays { along: self.along(simd, directions), inverse: [[zero; 2]; 3], ends: [zero; 2] };
        let mut wanted = [zero; 2];
        for half in 0..2 {
            let size = rays.along[0][half].abs() + rays.along[1][half].abs() + rays.along[2][half].abs();
            let is_finite = size.simd_lt(f64::MAX);
            let mut exit = far;
            for a in 0..3 {
                // What is no direction does not move.
                let along = is_finite.select(rays.along[a][half], zero);
                let inverse = one / along;
                let plane = along.simd_gt(zero).select(splat(dims[a]), splat(-1.0));
                exit = exit.min(along.abs().simd_lt(STILL).select(far, (plane - from[a]) * inverse));
                (rays.along[a][half], rays.inverse[a][half]) = (along, inverse);
            }
            let end = f64x8::from_slice(simd, &ends[8 * half..8 * half + 8]);
            wanted[half] = (end.simd_gt(zero) & exit.simd_lt(far)).select(one, zero);
            rays.ends[half] = wanted[half].simd_gt(zero).select(exit.min(end), zero);
        }
        (rays, simd.narrow_f64x8(wanted[0], wanted[1]).simd_gt(f32x16::splat(simd, 0.5)))
    }

    #[inline(always)]
    fn leap<S: Simd>(
        &self,
        simd: S,
        (voxels, free): (&Voxels<'_>, &Padded<'_>),
        directions: &Sixteen,
        [begins, ends]: [&[f64; 16]; 2],
    ) -> [f64; 16] {
        let (rays, mut active) = self.rays(simd, directions, ends);
        let mut out = [f64::INFINITY; 16];
        let way = Way::new(simd, rays.along);
        let beyond =
            f32x16::splat(simd, BEYOND as f32) / way.along[0].abs().max(way.along[1].abs()).max(way.along[2].abs());
        let ends = simd.narrow_f64x8(rays.ends[0], rays.ends[1]);
        let end = ends * 1.000_001 + beyond;
        let begin = f64x8::from_slice(simd, &begins[..8]);
        let begin = simd.narrow_f64x8(begin, f64x8::from_slice(simd, &begins[8..]));
        let mut t = (begin - beyond * 2.0).max(0.0);
        loop {
            let found = self.next_cells(simd, (voxels, free), &way, (&mut t, &mut active), (beyond, ends));
            if !found.any_true() {
                return out;
            }
            let (cell, _) = self.place(simd, &way, t);
            let done = self.exact(simd, voxels, (&rays, cell, found), &mut out);
            // Where there is no crossing in the cell, the walk goes on behind it.
            active = found & !done;
            if !active.any_true() {
                return out;
            }
            let next = self.reach(&way, cell, f32x16::splat(simd, 0.0));
            t = active.select(next.max(t) + beyond, t);
            active &= t.simd_lt(end);
        }
    }

    /// Returns the cells that the rays are in at `t`, and their positions, voxels.
    #[inline(always)]
    pub(super) fn place<S: Simd>(&self, simd: S, way: &Way<S>, t: f32x16<S>) -> ([f32x16<S>; 3], [f32x16<S>; 3]) {
        let from = self.from.as_vec3().to_array();
        let at = [way.along[0] * t + from[0], way.along[1] * t + from[1], way.along[2] * t + from[2]];
        let last = self.crossings.dims.map(|n| n as f32 - 2.0);
        let least = f32x16::splat(simd, -1.0);
        (
            [
                at[0].floor().max(least).min(last[0]),
                at[1].floor().max(least).min(last[1]),
                at[2].floor().max(least).min(last[2]),
            ],
            at,
        )
    }

    /// Returns where the rays leave the cells around theirs, `reach` king's moves in every direction, mm.
    #[inline(always)]
    pub(super) fn reach<S: Simd>(&self, way: &Way<S>, cell: [f32x16<S>; 3], reach: f32x16<S>) -> f32x16<S> {
        let from = self.from.as_vec3().to_array();
        let half = reach + 0.5;
        let leave = |a: usize| (cell[a] - (from[a] - 0.5)) * way.inverse[a] + half * way.inverse[a].abs();
        leave(0).min(leave(1)).min(leave(2))
    }

    /// Leaps on from `t` until each ray that is active is in a cell where it may meet the wall, or at its end. Returns those in a cell;
    /// none is active any more.
    #[inline(always)]
    fn next_cells<S: Simd>(
        &self,
        simd: S,
        (voxels, free): (&Voxels<'_>, &Padded<'_>),
        way: &Way<S>,
        (t, active): (&mut f32x16<S>, &mut mask32x16<S>),
        (beyond, ends): (f32x16<S>, f32x16<S>),
    ) -> mask32x16<S> {
        let [nx, ny, _] = self.crossings.dims.map(|n| n as i32);
        // Ends as they may be after rounding.
        let (near_end, end) = (ends * 1.000_000_2, ends * 1.000_001 + beyond);
        let mut found = *active & !*active;
        while active.any_true() {
            let (cell, at) = self.place(simd, way, *t);
            let [x, y, z] = [
                cell[0].to_int::<i32x16<S>>() + 1,
                cell[1].to_int::<i32x16<S>>() + 1,
                cell[2].to_int::<i32x16<S>>() + 1,
            ];
            let moves = free.at(simd, x + (y + z * ny) * nx);
            let reach = (moves.max(1) - 1).to_float::<f32x16<S>>();
            let next = self.reach(way, cell, reach);
            let next = next.max(*t);
            let beside = *active & moves.simd_eq(0);
            if beside.any_true() {
                let length = next.min(near_end).max(*t) - *t;
                let inside = [at[0] - cell[0], at[1] - cell[1], at[2] - cell[2]];
                let step = way.along.map(|s| s * length);
                let near = beside & self.comes_near(simd, voxels, ([x, y, z], beside), inside, step);
                found |= near;
                *active &= !near;
            }
            *t = active.select(next + beyond, *t);
            *active &= t.simd_lt(end);
        }
        found
    }

    /// Returns the lanes on whose way through their cells the value may come near the wall's, and those whose cells leave the volume.
    #[inline(always)]
    fn comes_near<S: Simd>(
        &self,
        simd: S,
        voxels: &Voxels<'_>,
        (g, wanted): ([i32x16<S>; 3], mask32x16<S>),
        at: [f32x16<S>; 3],
        step: [f32x16<S>; 3],
    ) -> mask32x16<S> {
        let last = voxels.last();
        let one = i32x16::splat(simd, 1);
        let inner = |a: usize| g[a].simd_ge(one) & g[a].simd_le(last[a]);
        let within = inner(0) & inner(1) & inner(2);
        let [a, b, c, d, e, f, g, h] = apart(voxels.corners(simd, g, wanted & within));
        let iso = self.crossings.volume.transfer().iso() as f32;
        let (k1, k2, k3) = (b - a, c - a, e - a);
        let (k4, k5, k6) = (d - c - k1, f - e - k1, g - e - k2);
        let k7 = (h - g) - (f - e) - (d - c) + k1;
        let ([u, v, w], [du, dv, dw]) = (at, step);
        let (uv1, uv2) = (u * dv + v * du, du * dv);
        let (uw1, uw2) = (u * dw + w * du, du * dw);
        let (vw1, vw2) = (v * dw + w * dv, dv * dw);
        let c0 = a + k1 * u + k2 * v + k3 * w + k4 * u * v + k5 * u * w + k6 * v * w + k7 * u * v * w;
        let c1 = k1 * du + k2 * dv + k3 * dw + k4 * uv1 + k5 * uw1 + k6 * vw1 + k7 * (u * v * dw + uv1 * w);
        let c2 = k4 * uv2 + k5 * uw2 + k6 * vw2 + k7 * (uv1 * dw + uv2 * w);
        let c3 = k7 * uv2 * dw;
        // The cubic stays within the hull of its Bernstein coefficients.
        let (low, high) = (c0 + c1 * (1.0 / 3.0), c0 + (c1 * 2.0 + c2) * (1.0 / 3.0));
        let most = c0.max(low).max(high).max(c0 + c1 + c2 + c3);
        most.simd_ge(iso - self.crossings.margin()) | !within
    }

    /// Finds the crossings of the rays `found` within their cells. Returns the rays that are done.
    #[inline(always)]
    fn exact<S: Simd>(
        &self,
        simd: S,
        voxels: &Voxels<'_>,
        (rays, cell, found): (&Rays<S>, [f32x16<S>; 3], mask32x16<S>),
        out: &mut [f64; 16],
    ) -> mask32x16<S> {
        let g =
            [cell[0].to_int::<i32x16<S>>() + 1, cell[1].to_int::<i32x16<S>>() + 1, cell[2].to_int::<i32x16<S>>() + 1];
        let corners = apart(voxels.corners(simd, g, found)).map(|c| c.widen());
        let cells = cell.map(|c| c.widen());
        let (found, last) = (found.select(i32x16::splat(simd, 1), i32x16::splat(simd, 0)).to_array(), voxels.last());
        let g = g.map(|g| g.to_array());
        let mut done = [0; 16];
        for half in 0..2 {
            let pick = |(low, high): (f64x8<S>, f64x8<S>)| if half == 0 { low } else { high };
            let at = 8 * half;
            let cell = [pick(cells[0]), pick(cells[1]), pick(cells[2])];
            let root = self.roots(simd, corners.map(pick), cell, (rays, half));
            for k in 0..8 {
                let n = at + k;
                if found[n] == 0 {
                    continue;
                }
                let is_inner = (0..3).all(|a| g[a][n] >= 1 && g[a][n] <= last[a]);
                if is_inner && root.is_found[k] != 0.0 {
                    (out[n], done[n]) = (root.at[k], 1);
                } else if !(is_inner && root.is_passed[k] != 0.0) {
                    let cell = [0, 1, 2].map(|a| i64::from(g[a][n]) - 1);
                    let is_below = is_inner && root.is_below[k] != 0.0;
                    if let Some(at) = self.alone(rays, (half, k), cell, (root.enter[k], root.exit[k]), is_below) {
                        (out[n], done[n]) = (at, 1);
                    }
                }
            }
        }
        i32x16::load_array_ref(simd, &done).simd_eq(1)
    }

    /// Returns the crossing of a ray in a cell between the distances at which it enters and leaves it, if it is below the wall's value where
    /// it enters; `None` if there is none. Otherwise the ray goes on by itself from a little before the cell to its end.
    #[inline(never)]
    fn alone<S: Simd>(
        &self,
        rays: &Rays<S>,
        (half, k): (usize, usize),
        cell: [i64; 3],
        (enter, exit): (f64, f64),
        is_below: bool,
    ) -> Option<f64> {
        let along = DVec3::from_array([0, 1, 2].map(|a| rays.along[a][half].as_array()[k]));
        let end = rays.ends[half].as_array()[k];
        if is_below {
            let segment = Segment::new(&self.crossings.volume, self.from, along);
            return segment.cross(cell, enter, exit).map(|at| at.min(end));
        }
        let back = 4.0 * BEYOND / along.abs().max_element();
        let begin = (enter - back).clamp(0.0, end);
        Some(self.crossings.walk(self.from, along, (begin, end)).unwrap_or(f64::INFINITY))
    }

    /// Finds the first root in eight cells.
    #[inline(always)]
    fn roots<S: Simd>(
        &self,
        simd: S,
        [a, b, c, d, e, f, g, h]: [f64x8<S>; 8],
        cell: [f64x8<S>; 3],
        (rays, half): (&Rays<S>, usize),
    ) -> Roots {
        let from = self.from.to_array();
        let splat = |x: f64| f64x8::splat(simd, x);
        let (zero, one, far) = (splat(0.0), splat(1.0), splat(f64::INFINITY));
        let along = [rays.along[0][half], rays.along[1][half], rays.along[2][half]];
        let (mut enter, mut exit) = (zero, rays.ends[half]);
        for n in 0..3 {
            let low = (cell[n] - from[n]) * rays.inverse[n][half];
            let high = (cell[n] + 1.0 - from[n]) * rays.inverse[n][half];
            let is_still = along[n].abs().simd_lt(STILL);
            let (near, away) = (low.min(high), low.max(high));
            enter = enter.max(is_still.select(-far, near));
            exit = exit.min(is_still.select(far, away));
        }
        let length = exit - enter;
        let [u, v, w] = [0, 1, 2].map(|n| along[n] * enter + from[n] - cell[n]);
        let [du, dv, dw] = along.map(|s| s * length);
        let (k1, k2, k3) = (b - a, c - a, e - a);
        let (k4, k5, k6) = (d - c - b + a, f - e - b + a, g - e - c + a);
        let k7 = h - g - f + e - d + c + b - a;
        let (uv1, uv2) = (u * dv + v * du, du * dv);
        let (uw1, uw2) = (u * dw + w * du, du * dw);
        let (vw1, vw2) = (v * dw + w * dv, dv * dw);
        let c0 = a + k1 * u + k2 * v + k3 * w + k4 * u * v + k5 * u * w + k6 * v * w + k7 * u * v * w
            - self.crossings.volume.transfer().iso();
        let c1 = k1 * du + k2 * dv + k3 * dw + k4 * uv1 + k5 * uw1 + k6 * vw1 + k7 * (u * v * dw + uv1 * w);
        let c2 = k4 * uv2 + k5 * uw2 + k6 * vw2 + k7 * (uv1 * dw + uv2 * w);
        let c3 = k7 * uv2 * dw;
        let end = c0 + c1 + c2 + c3;
        let (low, high) = (c0 + c1 * (1.0 / 3.0), c0 + (c1 * 2.0 + c2) * (1.0 / 3.0));
        let is_below = c0.simd_lt(-BESIDE);
        let is_beside = c0.max(low).max(high).max(end).simd_lt(-BESIDE);
        let rises = c1.simd_gt(zero) & (c1 + c2).simd_gt(zero) & (c1 + c2 * 2.0 + c3 * 3.0).simd_gt(zero);
        let is_missed = length.simd_lt(zero);
        let is_passed = is_missed | is_beside | (rises & is_below & end.simd_lt(-TOUCH));
        let mut wanted = rises & is_below & end.simd_ge(zero) & length.simd_ge(zero);
        let (mut s, mut found) = (c0 / (c0 - end), wanted & !wanted);
        for _ in 0..STEPS {
            let value = c0 + s * (c1 + s * (c2 + s * c3));
            let slope = c1 + s * (c2 * 2.0 + s * c3 * 3.0);
            let next = s - value / slope;
            let is_in = next.simd_ge(zero) & next.simd_le(one);
            let near = (next - s).abs().simd_lt(1e-10);
            s = wanted.select(next, s);
            found |= wanted & is_in & near;
            wanted &= is_in & !near;
            if !wanted.any_true() {
                break;
            }
        }
        let at = (enter + s * length).min(exit);
        Roots {
            enter: enter.to_array(),
            exit: exit.to_array(),
            is_below: is_below.select(one, zero).to_array(),
            at: at.to_array(),
            is_found: found.select(one, zero).to_array(),
            is_passed: is_passed.select(one, zero).to_array(),
        }
    }
}

/// Where eight rays cross the wall in a cell.
struct Roots {
    /// Distances at which the cell is entered and left, mm.
    enter: [f64; 8],
    exit: [f64; 8],
    /// 1 where the value is below the wall's where the cell is entered.
    is_below: [f64; 8],
    /// Distance of the crossing, mm, where it is found.
    at: [f64; 8],
    /// 1 where it is.
    is_found: [f64; 8],
    /// 1 where there is none for certain. The others are not known.
    is_passed: [f64; 8],
}

/// Returns the eight corners of each cell, HU, x fastest.
#[inline(always)]
pub(super) fn apart<S: Simd>(corners: Corners<S>) -> [f32x16<S>; 8] {
    let low = |pair: i32x16<S>| (pair << 16 >> 16).to_float();
    let high = |pair: i32x16<S>| (pair >> 16).to_float();
    let [p, q, r, s] = corners;
    [low(p), high(p), low(q), high(q), low(r), high(r), low(s), high(s)]
}

impl Crossings {
    /// Returns how near the value must come to the wall's for a ray to meet it, HU.
    #[inline(always)]
    fn margin(&self) -> f32 {
        MARGIN * self.dims.into_iter().fold(128, usize::max) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::Stream;
    use crate::phantom::Phantom;
    use crate::progress::Progress;
    use crate::render::normal_at;
    use crate::render::packets::levels;
    use crate::space::{PreparedVolume, TransferFunction};

    fn colon() -> (PreparedVolume, Crossings) {
        let volume = Phantom::embedded(&Progress::new()).unwrap();
        let volume = PreparedVolume::new(volume.into(), TransferFunction::default());
        let crossings = Crossings::new(&volume, &Progress::new()).unwrap();
        (volume, crossings)
    }

    /// Sixteen directions about one, along an axis for some.
    fn about(draw: &mut Stream, wide: f64, n: usize) -> Sixteen {
        let middle: [f64; 3] = from_fn(|_| draw.within(-1.0, 1.0));
        let mut one = |k: usize| {
            let mut d: [f64; 3] = from_fn(|a| middle[a] + draw.within(-wide, wide));
            (0..3).filter(|a| n % 7 == a + 1 || (n % 11 == a + 1 && k == 3)).for_each(|a| d[a] = 0.0);
            DVec3::from_array(d).try_normalize().unwrap_or(DVec3::X)
        };
        let all: [DVec3; 16] = from_fn(&mut one);
        from_fn(|a| all.map(|d| d[a]))
    }

    #[test]
    fn sixteen_end_where_one_does() {
        let (volume, crossings) = colon();
        let grid = volume.voxels().grid();
        let middle = DVec3::from_array(grid.dims().map(|n| 0.5 * n as f64));
        let mut draw = Stream::new(6, 0);
        let (mut hits, mut aside) = (0, 0);
        for n in 0..4000 {
            let place = DVec3::from_array(from_fn(|_| draw.within(-1.05, 1.05)));
            let rays = crossings.from(grid.world(middle + place * middle));
            let directions = about(&mut draw, [0.0, 0.01, 0.1, 1.0][n % 4], n);
            let ends = from_fn(|k| if n % 5 == 0 { draw.within(-10.0, 90.0) } else { [f64::INFINITY, 30.0][k % 2] });
            let found = rays.sixteen(&directions, &[0.0; 16], &ends);
            for k in 0..16 {
                let one = DVec3::new(directions[0][k], directions[1][k], directions[2][k]);
                let alone = rays.first(one).filter(|mm| *mm <= ends[k] && ends[k] > 0.0);
                let (a, b) = (alone.unwrap_or(f64::INFINITY), found[k]);
                // At the end itself rounding decides.
                let is_end = alone.is_none() && (b - ends[k]).abs() < 1e-6;
                assert!(a == b || (a - b).abs() < 1e-9 || is_end, "{n} {k}: {a} {b} {one} {}", ends[k]);
                hits += usize::from(alone.is_some_and(|mm| mm > 0.0));
                aside += usize::from(alone.is_none());
            }
        }
        assert!(hits > 5000 && aside > 5000, "{hits} {aside}");
    }

    /// Voxels that have nothing to do with each other, up to what 16 bits hold, on a sheared grid with thin axes.
    #[test]
    fn noise_is_no_fault() {
        use glam::DMat3;

        use crate::volume::{Grid, Volume};

        let shear = DMat3::from_cols(DVec3::X, DVec3::new(0.6, 0.8, 0.0), DVec3::new(0.2, -0.3, 0.9));
        let (mut rays_all, mut wrong) = (0, 0);
        for (dims, most) in [([40, 3, 70], 2000.0), ([2, 2, 2], 32_000.0), ([64, 64, 64], 32_000.0)] {
            let grid = Grid::new(dims, DVec3::new(0.5, 0.8, 2.0), DVec3::splat(-7.0), shear).unwrap();
            let mut draw = Stream::new(9, dims[0] as u64);
            let data = (0..grid.len())
                .map(|_| if draw.within(0.0, 1.0) < 0.03 { draw.within(-700.0, most) as i16 } else { -1000 });
            let volume = Volume::new(grid.clone(), data.collect());
            let volume = PreparedVolume::new(volume.into(), TransferFunction::default());
            let crossings = Crossings::new(&volume, &Progress::new()).unwrap();
            for n in 0..2000 {
                let place = DVec3::from_array(from_fn(|a| draw.within(-1.5, dims[a] as f64 + 0.5)));
                let rays = crossings.from(grid.world(place));
                let directions = about(&mut draw, [0.0, 0.02, 1.0][n % 3], n);
                let found = rays.sixteen(&directions, &[0.0; 16], &[f64::INFINITY; 16]);
                let facing = rays.facing(&directions, &found);
                for k in 0..16 {
                    let one = DVec3::new(directions[0][k], directions[1][k], directions[2][k]);
                    let alone = rays.first(one).unwrap_or(f64::INFINITY);
                    rays_all += 1;
                    wrong += usize::from(!(alone == found[k] || (alone - found[k]).abs() < 1e-9));
                    assert!(facing.normal[0][k].is_nan() || found[k] > 0.0 && found[k].is_finite());
                }
            }
        }
        // Touches of less than a thousandth of a voxel.
        assert!(wrong * 10_000 < rays_all, "{wrong} of {rays_all}");
        let (_, crossings) = colon();
        for nowhere in [DVec3::NAN, DVec3::splat(1e30)] {
            assert_eq!(
                crossings.from(nowhere).sixteen(&[[0.6; 16]; 3], &[0.0; 16], &[f64::INFINITY; 16]),
                [f64::INFINITY; 16]
            );
        }
        let rays = crossings.from(DVec3::ZERO);
        for odd in [f64::NAN, f64::INFINITY, 0.0, 1e-300] {
            let directions = [[odd; 16]; 3];
            let found = rays.sixteen(&directions, &[0.0; 16], &[f64::INFINITY; 16]);
            let one = rays.first(DVec3::splat(odd)).unwrap_or(f64::INFINITY);
            assert!(found.iter().all(|mm| *mm == one), "{odd}: {found:?} {one}");
        }
    }

    #[test]
    fn every_level_gives_the_same_bits() {
        let (volume, mut crossings) = colon();
        let grid = volume.voxels().grid();
        let middle = DVec3::from_array(grid.dims().map(|n| 0.5 * n as f64));
        for n in 0..300 {
            let mut first = None;
            for (name, level) in levels() {
                crossings.level = level;
                let mut draw = Stream::new(7, n);
                let place = DVec3::from_array(from_fn(|_| draw.within(-0.9, 0.9)));
                let rays = crossings.from(grid.world(middle + place * middle));
                let directions = about(&mut draw, 0.05, n as usize);
                let found = rays.sixteen(&directions, &[0.0; 16], &[f64::INFINITY; 16]).map(f64::to_bits);
                let facing = rays.facing(&directions, &found.map(f64::from_bits));
                let bits = (found, format!("{facing:?}"));
                assert!(*first.get_or_insert_with(|| bits.clone()) == bits, "{name} {n}");
            }
        }
    }

    #[test]
    fn walls_face_their_rays() {
        let (volume, crossings) = colon();
        let grid = volume.voxels().grid();
        let middle = DVec3::from_array(grid.dims().map(|n| 0.5 * n as f64));
        let mut draw = Stream::new(8, 0);
        let mut count = 0;
        for n in 0..2000 {
            let place = DVec3::from_array(from_fn(|_| draw.within(-1.0, 1.0)));
            let origin = grid.world(middle + place * middle);
            let rays = crossings.from(origin);
            let directions = about(&mut draw, 0.1, n);
            let mm = rays.sixteen(&directions, &[0.0; 16], &[f64::INFINITY; 16]);
            let facing = rays.facing(&directions, &mm);
            for k in 0..16 {
                let direction = DVec3::new(directions[0][k], directions[1][k], directions[2][k]);
                let ray = crate::render::camera::CameraRay { origin, direction };
                let normal = if mm[k].is_finite() { normal_at(&volume, ray, mm[k]) } else { None };
                let of = |all: &[[f32; 16]; 3]| DVec3::from_array(from_fn(|a| all[a][k].into()));
                let (own, smooth) = (of(&facing.normal), of(&facing.smooth));
                assert_eq!(normal.is_some(), own.is_finite());
                let Some(normal) = normal else { continue };
                assert!((normal - own).length() < 1e-6, "{normal} {own}");
                assert!((smooth.length() - 1.0).abs() < 1e-5 && smooth.dot(direction) <= 1e-6);
                let change = rays.difference(grid.voxel(origin + direction * mm[k])).as_dvec3();
                let slow = -(grid.to_voxel().matrix3.transpose() * change);
                if let Some(slow) = slow.try_normalize().filter(|s| s.dot(direction) < -1e-3) {
                    assert!((slow - smooth).length() < 1e-3, "{slow} {smooth}");
                    count += 1;
                }
            }
        }
        assert!(count > 5000, "{count}");
    }
}
