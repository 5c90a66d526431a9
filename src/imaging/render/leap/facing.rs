//! The normals where sixteen rays cross the wall.

use fearless_simd::{Simd, f32x16, f64x8, i32x16, mask32x16, prelude::*};
use glam::{DVec3, Vec3};

use super::crossings::RaysFrom;
use super::sixteen::{Directions, apart};
use crate::render::camera::CameraRay;
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
    pub fn facing(&self, directions: &Directions, mm: &[f64; 16]) -> Facing {
        let quick = self.voxels.as_ref().and_then(
            |voxels| fearless_simd::dispatch!(self.crossings.level, simd => self.turn(simd, voxels, directions, mm)),
        );
        quick.unwrap_or_else(|| self.turn_alone(directions, mm))
    }

    /// Does it ray by ray: near the volume's border, or where the volume is too large.
    #[cold]
    fn turn_alone(&self, directions: &Directions, mm: &[f64; 16]) -> Facing {
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
    fn turn<S: Simd>(&self, simd: S, voxels: &Voxels<'_>, directions: &Directions, mm: &[f64; 16]) -> Option<Facing> {
        let grid = self.crossings.volume.voxels().grid();
        let to_voxel = grid.to_voxel().matrix3.to_cols_array_2d();
        let from = self.from.to_array();
        // Places in double precision, by halves: cells, and positions within them. A crossing on a face belongs to the cell before it.
        let (mut cell, mut inside) = ([[0; 16]; 3], [[0.0; 16]; 3]);
        let (mut base, mut share, mut wanted) = ([[0; 16]; 3], [[0.0; 16]; 3], [0; 16]);
        for k in 0..16 {
            let is_hit = mm[k].is_finite() && mm[k] > 0.0;
            let t = if is_hit { mm[k] } else { 0.0 };
            wanted[k] = i32::from(is_hit);
            let mut along = [0.0; 3];
            for a in 0..3 {
                along[a] = to_voxel[0][a] * directions[0][k]
                    + to_voxel[1][a] * directions[1][k]
                    + to_voxel[2][a] * directions[2][k];
            }
            let back = BEFORE / along[0].abs().max(along[1].abs()).max(along[2].abs()).max(1e-300);
            for a in 0..3 {
                let at = from[a] + along[a] * t;
                let (before, floor) = ((at - along[a] * back).floor(), at.floor());
                (cell[a][k], inside[a][k]) = (before as i32 + 1, at - before);
                (base[a][k], share[a][k]) = (floor as i32 + 1, (at - floor) as f32);
            }
        }
        let wanted = i32x16::load_array_ref(simd, &wanted).simd_eq(1);
        let load = |g: &[[i32; 16]; 3]| {
            [
                i32x16::load_array_ref(simd, &g[0]),
                i32x16::load_array_ref(simd, &g[1]),
                i32x16::load_array_ref(simd, &g[2]),
            ]
        };
        // Where the block is within the volume, so is the cell, which is the block's middle one or beside it.
        let blocks = voxels.blocks(simd, load(&base), wanted)?;
        let corners = apart(voxels.corners(simd, load(&cell), wanted)).map(|c| c.widen());
        let mut normal = [[f32::NAN; 16]; 3];
        for half in 0..2 {
            let corners = corners.map(|(low, high)| if half == 0 { low } else { high });
            let at = 8 * half;
            let inside = [
                f64x8::from_slice(simd, &inside[0][at..at + 8]),
                f64x8::from_slice(simd, &inside[1][at..at + 8]),
                f64x8::from_slice(simd, &inside[2][at..at + 8]),
            ];
            let turned = world(simd, gradient(corners, inside), &to_voxel);
            for a in 0..3 {
                let numbers = turned[a].to_array();
                for k in 0..8 {
                    normal[a][at + k] = numbers[k] as f32;
                }
            }
        }
        let exact = [
            f32x16::load_array_ref(simd, &normal[0]),
            f32x16::load_array_ref(simd, &normal[1]),
            f32x16::load_array_ref(simd, &normal[2]),
        ];
        let share = [
            f32x16::load_array_ref(simd, &share[0]),
            f32x16::load_array_ref(simd, &share[1]),
            f32x16::load_array_ref(simd, &share[2]),
        ];
        let smooth = towards(simd, differences(simd, &blocks, share), &to_voxel);
        let single = |a: usize| f32x16::from_fn(simd, |k| directions[a][k] as f32);
        let facing = smooth[0] * single(0) + smooth[1] * single(1) + smooth[2] * single(2);
        // A wall without a gradient, touched at a single point, has no normal.
        let none = f32x16::splat(simd, f32::NAN);
        let is_known = wanted & finite(exact[0]);
        let is_smooth = facing.simd_lt(f32x16::splat(simd, 0.0));
        let pick = |a: usize| is_known.select(is_smooth.select(smooth[a], exact[a]), none).to_array();
        let known = |a: usize| is_known.select(exact[a], none).to_array();
        Some(Facing { normal: [known(0), known(1), known(2)], smooth: [pick(0), pick(1), pick(2)] })
    }
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
