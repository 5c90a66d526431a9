//! What lies behind the wall, for sixteen of its cells at once.
//!
//! From the middle of a cell that the wall crosses, one step of Newton's method along the gradient of the trilinear value leads onto
//! the wall. That gradient g is the wall's normal there. With M the matrix from world to voxel
//! coordinates, the world's gradient is Mᵀg, and 1 mm along it moves by M Mᵀ g / |Mᵀ g| voxels: the same on sheared grids.
//!
//! From there the path is the midpoint rule in steps of at most [`STEP_MM`]: of second order, exact where values change linearly. Front
//! to back, with T = 1 at first, a step of value v adds T·s(v) to the weight and T·s(v)·c(v) to the light, and leaves T·(1 − s(v)); s and c
//! are the table's opacity and colour ([`Ramps`]). The first mm counts less, rising from 0: in it the scan's blur mixes
//! gas with what is behind it. Light over weight is the colour.

use fearless_simd::{Level, Simd, f32x16, mask32x16, prelude::*};
use glam::{DVec3, Vec3};

use super::tissues::{Ramps, TranslucencySettings};
use crate::render::light::BORDER;
use crate::render::packets::directions::split;
use crate::render::packets::lanes::{Corners, Voxels, interpolate};
use crate::render::packets::picture::on_level;
use crate::render::wall_paint::{AT_ONCE, CellInks};
use crate::space::PreparedVolume;
use crate::volume::Volume;

/// The longest step of the path, mm.
pub(super) const STEP_MM: f64 = 0.5;
/// Over this length the weight of the path rises from 0 to 1, mm.
const SKIN_MM: f32 = 1.0;
/// The least slope of a wall, HU/mm. Less than this is none.
const LEAST_SLOPE: f32 = 1.0;
/// The most by which a place is moved onto the wall, mm.
const MOST_OFF_MM: f32 = 1.5;
/// Less than this of what is behind a wall says nothing.
const LEAST_WEIGHT: f32 = 0.02;
/// A layer in front of a cleansed wall that is thinner than this belongs to the path, mm.
const COAT_MM: f32 = 3.0;
/// Distance between two looks for it, mm.
const LOOK_MM: f32 = 0.75;

impl CellInks for Behind<'_> {
    fn inks(&self, cells: &[[usize; 3]], inks: &mut [[u8; 4]]) {
        let mut q = [[0.0f32; AT_ONCE]; 3];
        for (lane, cell) in cells.iter().enumerate() {
            for (q, c) in q.iter_mut().zip(cell) {
                // Its middle.
                q[lane] = *c as f32 + 1.5;
            }
        }
        on_level!(self.level, simd => simd.vectorize(
            #[inline(always)]
            || {
                let load = f32x16::load_array_ref;
                let q = [load(simd, &q[0]), load(simd, &q[1]), load(simd, &q[2])];
                let all = self.colours(simd, q, q[0].simd_gt(0.5));
                let [r, g, b, weight] = all.map(|v| v.to_array());
                for (n, ink) in inks.iter_mut().enumerate() {
                    let whole = if weight[n] > LEAST_WEIGHT { 255 } else { 0 };
                    *ink = [(r[n] + 0.5) as u8, (g[n] + 0.5) as u8, (b[n] + 0.5) as u8, whole];
                }
            },
        ));
    }
}

/// Finds what lies behind the wall of one volume in the values of another, or of the same.
pub(super) struct Behind<'a> {
    shown: Voxels<'a>,
    scanned: Voxels<'a>,
    /// Moves voxel coordinates of the shown volume to those of the scanned one.
    offset: Vec3,
    /// True if the scanned values are others.
    is_other: bool,
    /// M Mᵀ of the docs of this module, by rows.
    metric: [Vec3; 3],
    iso: f32,
    steps: usize,
    step_mm: f32,
    ramps: Ramps,
    level: Level,
}

impl<'a> Behind<'a> {
    /// Prepares to look behind the wall of `shown`, in the values of `scanned` if that is another volume of the same lattice.
    ///
    /// Returns `None` for a volume with a single voxel along an axis, or with more voxels than an `i32` can count.
    pub(super) fn new(
        shown: &'a PreparedVolume,
        scanned: Option<&'a Volume>,
        settings: &TranslucencySettings,
        level: Level,
    ) -> Option<Self> {
        let grid = shown.voxels().grid();
        let to_voxel = grid.to_voxel().matrix3;
        let offset = |other: &Volume| {
            let offset = other.grid().voxel(grid.world(DVec3::ZERO));
            let same = (other.grid().to_voxel().matrix3 - to_voxel).to_cols_array().iter().all(|c| c.abs() < 1e-9);
            same.then(|| offset.as_vec3())
        };
        let other = scanned.filter(|s| !std::ptr::eq(*s, shown.voxels())).and_then(|s| Some((s, offset(s)?)));
        let (scanned, offset, is_other) = match other {
            Some((scanned, offset)) => (scanned, offset, true),
            None => (shown.voxels(), Vec3::ZERO, false),
        };
        let steps = (settings.depth_mm / STEP_MM).ceil().max(1.0);
        let step_mm = settings.depth_mm / steps;
        let metric = to_voxel * to_voxel.transpose();
        Some(Self {
            shown: Voxels::new(shown.voxels())?,
            scanned: Voxels::new(scanned)?,
            offset,
            is_other,
            metric: [0, 1, 2].map(|n| metric.row(n).as_vec3()),
            iso: shown.transfer().iso() as f32,
            steps: steps as usize,
            step_mm: step_mm as f32,
            ramps: Ramps::new(settings, step_mm),
            level,
        })
    }

    /// Returns the colours (red, green and blue, 0 to 255) behind the wall near the places `q` (voxel coordinates of the shown volume,
    /// counted from voxel −1), and the weight of each, 0 to 1. Lanes that are not wanted, and those without a wall, get 0.
    #[inline(always)]
    pub(super) fn colours<S: Simd>(&self, simd: S, q: [f32x16<S>; 3], wanted: mask32x16<S>) -> [f32x16<S>; 4] {
        let zero = f32x16::splat(simd, 0.0);
        let (q, inward, met) = self.wall(simd, q, wanted);
        let from = [q[0] + self.offset.x, q[1] + self.offset.y, q[2] + self.offset.z];
        let start = if self.is_other { self.front(simd, from, inward, met) } else { zero };
        let (mut left, mut weight) = (f32x16::splat(simd, 1.0), zero);
        let mut light = [zero; 3];
        for step in 0..self.steps {
            let mm = (step as f32 + 0.5) * self.step_mm;
            let skin = (mm / SKIN_MM).min(1.0);
            let value = self.value(simd, from, inward, start + mm, met);
            let mut stops = f32x16::splat(simd, self.ramps.stops);
            let mut own = self.ramps.light.map(|c| f32x16::splat(simd, c));
            for ramp in self.ramps.all() {
                let share = ((value - ramp.from) * ramp.scale).max(zero).min(f32x16::splat(simd, 1.0));
                stops += share * ramp.stops;
                own[0] += share * ramp.light[0];
                own[1] += share * ramp.light[1];
                own[2] += share * ramp.light[2];
            }
            let reaches = left * skin;
            weight += reaches * stops;
            light[0] += reaches * own[0];
            light[1] += reaches * own[1];
            light[2] += reaches * own[2];
            left -= reaches * stops;
        }
        let whole = f32x16::splat(simd, 1.0) / weight.max(f32x16::splat(simd, 1e-6));
        let [r, g, b] = [light[0] * whole, light[1] * whole, light[2] * whole];
        [met.select(r, zero), met.select(g, zero), met.select(b, zero), met.select(weight, zero)]
    }

    /// Returns the wall's places near `q`, the movement of 1 mm behind it, and the lanes that have a wall.
    #[inline(always)]
    fn wall<S: Simd>(
        &self,
        simd: S,
        q: [f32x16<S>; 3],
        wanted: mask32x16<S>,
    ) -> ([f32x16<S>; 3], [f32x16<S>; 3], mask32x16<S>) {
        let (cell, t) = split(within(simd, q, self.shown.last()));
        let (value, g) = gradient(simd, self.shown.corners(simd, cell, wanted), t);
        let [x, y, z] = self.metric;
        let inward = [
            g[0] * x.x + g[1] * x.y + g[2] * x.z,
            g[0] * y.x + g[1] * y.y + g[2] * y.z,
            g[0] * z.x + g[1] * z.y + g[2] * z.z,
        ];
        let slope = (g[0] * inward[0] + g[1] * inward[1] + g[2] * inward[2]).sqrt();
        let met = wanted & slope.simd_gt(LEAST_SLOPE);
        let whole = f32x16::splat(simd, 1.0) / slope.max(f32x16::splat(simd, LEAST_SLOPE));
        let inward = [inward[0] * whole, inward[1] * whole, inward[2] * whole];
        let most = f32x16::splat(simd, MOST_OFF_MM);
        let off = ((f32x16::splat(simd, self.iso) - value) * whole).min(most).max(-most);
        (moved(q, inward, off), inward, met)
    }

    /// Returns where the paths begin, mm behind the wall: before it, if the scan has a thin layer there that cleansing took out.
    #[inline(always)]
    fn front<S: Simd>(&self, simd: S, from: [f32x16<S>; 3], inward: [f32x16<S>; 3], met: mask32x16<S>) -> f32x16<S> {
        let zero = f32x16::splat(simd, 0.0);
        let iso = f32x16::splat(simd, self.iso);
        let first = self.value(simd, from, inward, zero - LOOK_MM, met);
        let mut start = zero;
        let covered = met & first.simd_ge(iso);
        if !covered.any_true() {
            return start;
        }
        start = covered.select(zero - LOOK_MM, start);
        let mut mm = 2.0 * LOOK_MM;
        while mm < COAT_MM {
            let value = self.value(simd, from, inward, zero - mm, covered);
            start = (covered & value.simd_ge(iso)).select(zero - mm, start);
            mm += LOOK_MM;
        }
        // Deeper fluid is a pool: the wall below it is what the picture shows.
        let last = self.value(simd, from, inward, zero - COAT_MM, covered);
        last.simd_lt(iso).select(start, zero)
    }

    /// Returns the scan's values `mm` behind the places `from`. Beyond its border is what is at the border.
    #[inline(always)]
    fn value<S: Simd>(
        &self,
        simd: S,
        from: [f32x16<S>; 3],
        inward: [f32x16<S>; 3],
        mm: f32x16<S>,
        wanted: mask32x16<S>,
    ) -> f32x16<S> {
        let (cell, t) = split(within(simd, moved(from, inward, mm), self.scanned.last()));
        interpolate(simd, self.scanned.corners(simd, cell, wanted), t)
    }
}

/// Returns the places `by` mm farther on, if a mm is a movement of `along`.
#[inline(always)]
fn moved<S: Simd>(from: [f32x16<S>; 3], along: [f32x16<S>; 3], by: f32x16<S>) -> [f32x16<S>; 3] {
    [from[0] + along[0] * by, from[1] + along[1] * by, from[2] + along[2] * by]
}

/// Returns the places (counted from voxel −1), or the nearest within the volume.
#[inline(always)]
fn within<S: Simd>(simd: S, q: [f32x16<S>; 3], last: [i32; 3]) -> [f32x16<S>; 3] {
    let one = f32x16::splat(simd, 1.0);
    let high = |n: usize| last[n] as f32 + (1.0 - BORDER);
    [q[0].max(one).min(high(0)), q[1].max(one).min(high(1)), q[2].max(one).min(high(2))]
}

/// Returns the trilinear value at the positions `t` (0 to 1 along each axis) in cells, HU, and its gradient, HU/voxel.
#[inline(always)]
fn gradient<S: Simd>(simd: S, corners: Corners<S>, t: [f32x16<S>; 3]) -> (f32x16<S>, [f32x16<S>; 3]) {
    let [tx, ty, tz] = t;
    let (mut values, mut slopes) = ([f32x16::splat(simd, 0.0); 4], [f32x16::splat(simd, 0.0); 4]);
    for n in 0..4 {
        let pair = corners[n];
        let (low, high): (f32x16<S>, f32x16<S>) = ((pair << 16 >> 16).to_float(), (pair >> 16).to_float());
        slopes[n] = high - low;
        values[n] = low + slopes[n] * tx;
    }
    let [a, b, c, d] = values;
    let (near, far) = (a + (b - a) * ty, c + (d - c) * ty);
    let (near_x, far_x) = (slopes[0] + (slopes[1] - slopes[0]) * ty, slopes[2] + (slopes[3] - slopes[2]) * ty);
    let y = (b - a) + ((d - c) - (b - a)) * tz;
    (near + (far - near) * tz, [near_x + (far_x - near_x) * tz, y, far - near])
}
