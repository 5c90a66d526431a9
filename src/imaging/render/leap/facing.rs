//! The normals where sixteen rays cross the wall.

use fearless_simd::{Simd, f32x16, f64x8, i32x16, mask32x16, prelude::*};
use glam::{DVec3, Vec3};

use super::crossings::RaysFrom;
use super::sixteen::{Doubles, apart};
use crate::render::camera::{CameraRay, Sixteen};
use crate::render::normals::{BEFORE, normal_at};
use crate::render::packets::lanes::{Blocks, Voxels};
use crate::space::ray::trilinear;

/// x, y and z of sixteen directions of unit length, world.
type Normals = [[f32; 16]; 3];

/// How the wall faces sixteen rays that cross it.
#[derive(Clone, Debug, PartialEq)]
pub struct Facing {
    /// The wall's normals, towards the gas: [`normal_at`]. NaN where there is no crossing or no normal.
    pub normal: Normals,
    /// The same of the values around them, so that they do not change abruptly from voxel to voxel: from the differences over two voxels,
    /// as pictures are shaded. They never point away from the rays' origin.
    pub smooth: Normals,
}

impl RaysFrom<'_> {
    /// Returns how the wall faces the rays along sixteen directions (world; of unit length) that cross it after so many mm; infinite where
    /// none does.
    pub fn facing(&self, directions: &Sixteen, mm: &[f64; 16]) -> Facing {
        let quick = self.lanes.as_ref().and_then(
            |(voxels, _)| fearless_simd::dispatch!(self.crossings.level, simd => self.turn(simd, voxels, directions, mm)),
        );
        quick.unwrap_or_else(|| self.turn_alone(directions, mm))
    }

    /// Does it ray by ray: near the volume's border, or where the volume is too large.
    #[cold]
    fn turn_alone(&self, directions: &Sixteen, mm: &[f64; 16]) -> Facing {
        let volume = &self.crossings.volume;
        let mut out = Facing { normal: [[f32::NAN; 16]; 3], smooth: [[f32::NAN; 16]; 3] };
        for k in (0..16).filter(|k| mm[*k].is_finite()) {
            let direction = DVec3::new(directions[0][k], directions[1][k], directions[2][k]);
            let ray = CameraRay { origin: self.origin, direction };
            let Some(normal) = normal_at(volume, ray, mm[k]) else { continue };
            let grid = volume.voxels().grid();
            let change = self.difference(grid.voxel(self.origin + direction * mm[k])).as_dvec3();
            let smooth = (-(grid.to_voxel().matrix3.transpose() * change)).try_normalize();
            let smooth = smooth.filter(|n| n.dot(direction) < 0.0).unwrap_or(normal);
            for a in 0..3 {
                (out.normal[a][k], out.smooth[a][k]) = (normal[a] as f32, smooth[a] as f32);
            }
        }
        out
    }

    /// Returns the central difference over two voxels along each axis of the interpolated value, HU/voxel.
    pub(super) fn difference(&self, at: DVec3) -> Vec3 {
        let value = |by: DVec3| trilinear(self.crossings.volume.voxels(), at + by);
        let along = |axis: DVec3| 0.5 * (value(axis) - value(-axis));
        DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z)).as_vec3()
    }

    /// Does it for all rays at once; `None` if the voxels that this needs leave the volume.
    #[inline(always)]
    fn turn<S: Simd>(&self, simd: S, voxels: &Voxels<'_>, directions: &Sixteen, mm: &[f64; 16]) -> Option<Facing> {
        let grid = self.crossings.volume.voxels().grid();
        let to_voxel = grid.to_voxel().matrix3.to_cols_array_2d();
        let from = self.from.to_array();
        let along = self.along(simd, directions);
        let splat = |x: f64| f64x8::splat(simd, x);
        let zero = splat(0.0);
        // Places in double precision: cells, and positions within them. A crossing on a face belongs to the cell before it.
        let (mut cell, mut inside) = ([[zero; 2]; 3], [[zero; 2]; 3]);
        let (mut base, mut share, mut wanted) = ([[zero; 2]; 3], [[zero; 2]; 3], [zero; 2]);
        for half in 0..2 {
            let mm = f64x8::from_slice(simd, &mm[8 * half..8 * half + 8]);
            let is_hit = mm.simd_gt(zero) & mm.simd_lt(f64::INFINITY);
            let t = is_hit.select(mm, zero);
            wanted[half] = is_hit.select(splat(1.0), zero);
            let most = along[0][half].abs().max(along[1][half].abs()).max(along[2][half].abs());
            let back = splat(BEFORE) / most.max(1e-300);
            for a in 0..3 {
                let along = is_hit.select(along[a][half], zero);
                let at = along * t + from[a];
                let (before, floor) = ((at - along * back).floor(), at.floor());
                (cell[a][half], inside[a][half]) = (before + 1.0, at - before);
                (base[a][half], share[a][half]) = (floor + 1.0, at - floor);
            }
        }
        let wanted = narrow(simd, wanted).simd_gt(f32x16::splat(simd, 0.5));
        // Where the block is within the volume, so is the cell, which is the block's middle one or beside it.
        let blocks = voxels.blocks(simd, whole(simd, base), wanted)?;
        let corners = apart(voxels.corners(simd, whole(simd, cell), wanted)).map(|c| c.widen());
        let low = gradient(corners.map(|c| c.0), [inside[0][0], inside[1][0], inside[2][0]]);
        let high = gradient(corners.map(|c| c.1), [inside[0][1], inside[1][1], inside[2][1]]);
        let (low, high) = (world(simd, low, &to_voxel), world(simd, high, &to_voxel));
        let exact = [narrow(simd, [low[0], high[0]]), narrow(simd, [low[1], high[1]]), narrow(simd, [low[2], high[2]])];
        let share = [narrow(simd, share[0]), narrow(simd, share[1]), narrow(simd, share[2])];
        let smooth = towards(simd, differences(simd, &blocks, share), &to_voxel);
        let facing = smooth[0] * single(simd, &directions[0])
            + smooth[1] * single(simd, &directions[1])
            + smooth[2] * single(simd, &directions[2]);
        // A wall without a gradient, touched at a single point, has no normal.
        let none = f32x16::splat(simd, f32::NAN);
        let is_known = wanted & finite(exact[0]);
        let is_smooth = facing.simd_lt(f32x16::splat(simd, 0.0));
        let pick = |a: usize| is_known.select(is_smooth.select(smooth[a], exact[a]), none).to_array();
        let known = |a: usize| is_known.select(exact[a], none).to_array();
        Some(Facing { normal: [known(0), known(1), known(2)], smooth: [pick(0), pick(1), pick(2)] })
    }
}

/// Returns sixteen numbers in single precision.
#[inline(always)]
fn narrow<S: Simd>(simd: S, [low, high]: Doubles<S>) -> f32x16<S> {
    simd.narrow_f64x8(low, high)
}

#[inline(always)]
fn single<S: Simd>(simd: S, all: &[f64; 16]) -> f32x16<S> {
    narrow(simd, [f64x8::from_slice(simd, &all[..8]), f64x8::from_slice(simd, &all[8..])])
}

/// Returns whole numbers that single precision holds exactly.
#[inline(always)]
fn whole<S: Simd>(simd: S, [x, y, z]: [Doubles<S>; 3]) -> [i32x16<S>; 3] {
    [narrow(simd, x).to_int(), narrow(simd, y).to_int(), narrow(simd, z).to_int()]
}

/// Returns the lanes that are numbers.
#[inline(always)]
fn finite<S: Simd>(x: f32x16<S>) -> mask32x16<S> {
    x.abs().simd_lt(f32::INFINITY)
}

/// Returns the change of HU per voxel along each axis in eight cells, at positions within them.
#[inline(always)]
fn gradient<S: Simd>([a, b, c, d, e, f, g, h]: [f64x8<S>; 8], [u, v, w]: [f64x8<S>; 3]) -> [f64x8<S>; 3] {
    let (k1, k2, k3) = (b - a, c - a, e - a);
    let (k4, k5, k6) = (d - c - b + a, f - e - b + a, g - e - c + a);
    let k7 = h - g - f + e - d + c + b - a;
    [k1 + k4 * v + k5 * w + k7 * v * w, k2 + k4 * u + k6 * w + k7 * u * w, k3 + k5 * u + k6 * v + k7 * u * v]
}

/// Returns the unit directions, world, against a change along the voxels' axes; NaN where there is none.
#[inline(always)]
fn world<S: Simd>(simd: S, change: [f64x8<S>; 3], to_voxel: &[[f64; 3]; 3]) -> [f64x8<S>; 3] {
    let [p, q, r] = change;
    let [x, y, z] = [
        p * -to_voxel[0][0] + q * -to_voxel[0][1] + r * -to_voxel[0][2],
        p * -to_voxel[1][0] + q * -to_voxel[1][1] + r * -to_voxel[1][2],
        p * -to_voxel[2][0] + q * -to_voxel[2][1] + r * -to_voxel[2][2],
    ];
    let short = f64x8::splat(simd, 1.0) / (x * x + y * y + z * z).sqrt();
    [x * short, y * short, z * short]
}

/// Does the same as [`world`] in single precision.
#[inline(always)]
fn towards<S: Simd>(simd: S, change: [f32x16<S>; 3], to_voxel: &[[f64; 3]; 3]) -> [f32x16<S>; 3] {
    let [p, q, r] = change;
    let m = to_voxel.map(|row| row.map(|x| -x as f32));
    let [x, y, z] = [
        p * m[0][0] + q * m[0][1] + r * m[0][2],
        p * m[1][0] + q * m[1][1] + r * m[1][2],
        p * m[2][0] + q * m[2][1] + r * m[2][2],
    ];
    let short = f32x16::splat(simd, 1.0) / (x * x + y * y + z * z).sqrt();
    [x * short, y * short, z * short]
}

/// Returns the differences over two voxels along each axis at positions within the blocks' middle cells, HU.
#[inline(always)]
fn differences<S: Simd>(simd: S, blocks: &Blocks<'_, S>, [u, v, w]: [f32x16<S>; 3]) -> [f32x16<S>; 3] {
    let low = plane(simd, blocks, 1, [u, v]);
    let high = plane(simd, blocks, 2, [u, v]);
    let below = blend(value(blocks.row(simd, [1, 0]), u), value(blocks.row(simd, [2, 0]), u), v);
    let above = blend(value(blocks.row(simd, [1, 3]), u), value(blocks.row(simd, [2, 3]), u), v);
    [blend(low[0], high[0], w), blend(low[1], high[1], w), blend(high[2] - below, above - low[2], w)]
}

/// Returns the differences along x and y, and the value, in the block's slice `z`.
#[inline(always)]
fn plane<S: Simd>(simd: S, blocks: &Blocks<'_, S>, z: usize, [u, v]: [f32x16<S>; 2]) -> [f32x16<S>; 3] {
    let [a, b, c, d] =
        [blocks.row(simd, [0, z]), blocks.row(simd, [1, z]), blocks.row(simd, [2, z]), blocks.row(simd, [3, z])];
    let (p, q, r, s) = (value(a, u), value(b, u), value(c, u), value(d, u));
    [blend(change(b, u), change(c, u), v), blend(r - p, s - q, v), blend(q, r, v)]
}

/// Returns the value in a row of four voxels.
#[inline(always)]
fn value<S: Simd>([_, b, c, _]: [f32x16<S>; 4], u: f32x16<S>) -> f32x16<S> {
    blend(b, c, u)
}

/// Returns the difference over two voxels in a row.
#[inline(always)]
fn change<S: Simd>([a, b, c, d]: [f32x16<S>; 4], u: f32x16<S>) -> f32x16<S> {
    blend(c - a, d - b, u)
}

#[inline(always)]
fn blend<S: Simd>(a: f32x16<S>, b: f32x16<S>, t: f32x16<S>) -> f32x16<S> {
    a + (b - a) * t
}
