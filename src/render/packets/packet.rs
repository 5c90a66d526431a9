//! Sixteen rays at once, from their first sample to their light.
//!
//! The recurrence is that of [`caster`](crate::render::caster): L ← L + (1 − A)·C, (1 − A) ← (1 − A)(1 − a). Three things are
//! different.
//!
//! **Steps.** The volume is sampled at t = k·Δs, and between two samples the value is taken as linear (pre-integration,
//! Engel, Kraus and Ertl 2001), or, where the ray was in the wall before, as the parabola through the sample before, too: a
//! ray that grazes a rim is deepest between two samples. Each step is composed of four quarter steps at their middles, so that
//! the ramp is met where it is in a step that rises over all of it. Values are
//! smooth on the scale of a voxel, so that this is as good as quarter steps with samples of their own. Where the scan is smooth on
//! the scale of two ([`blur`](super::blur)) steps are twice as long. So that no wall is passed over that shorter ones would meet,
//! a step with both ends before the wall and its middle in a cell that holds something is sampled there, too.
//!
//! **Light.** A ray's light from one layer of the wall is that of the layer's mean place and mean value
//! ([`layer`](super::layer)). A layer ends where a step adds nothing, where values begin to fall, as behind the middle of a thin
//! fold, or when it is long ([`layer::steps`]): that matters where a ray runs along the wall, which turns beneath it. Close to
//! the camera rays run along the wall in whole parts of the picture, and steps are half as long.
//!
//! **Empty space.** Where a bundle of rays meets something first may be known before it is cast
//! ([`Beam`](super::beam::Beam)). From there on a step at whose beginning no ray sees anything, and of which all places to sample
//! lie in empty cells, is taken without looking at the volume; after some of these in a row ([`PATIENCE`]) the rays leap, all of
//! them equally far. Samples lie on the same places whatever is left out, so that this changes no bit of the picture.

use std::array::from_fn;

use fearless_simd::{Simd, f32x16, mask32x16, prelude::*};
use glam::{DVec3, IVec3, Vec3};

use super::blur;
use super::cells::{Cells, Colours, Source};
use super::directions::{DirectionSource, Directions, split};
use super::lanes::{OccupancyLanes, Voxels, interpolate};
use super::layer::{self, Layer, Medium, Sums};
use super::occupancy::{BRICK_SHIFT, Occupancy};
use super::sampling::SIDE;
use crate::render::camera::{Origins, View};
use crate::render::light::Light;
use crate::render::march::Step;
use crate::render::prepared_volume::PreparedVolume;
use crate::render::quality::Settings;
use crate::render::regression::{Regression, Weighting, to_world};
use crate::render::sampler::{Sampler, Trilinear};
use crate::render::shaders::Shader;
use crate::render::transfer::{FOOT, PALETTE_HU};

/// A ray runs along the wall where its value changes by less than this over a path of h, the smallest spacing, HU. One that
/// goes straight through it has one layer: its brightness hardly depends on how the wall turns.
const STEEP: f32 = 200.0;
/// A camera is close to the wall where something of it is within about so many voxels of the smallest spacing.
const NEAR: f64 = 2.0;
/// After so many empty steps in a row the distances of the rays' bricks are looked up: near a wall they are not worth it. After
/// a leap, and where nothing was known before, they are looked up at once.
const PATIENCE: f32 = 8.0;
/// What rounding may add to a leap, voxels: for a leap over all the bricks that a distance can tell of, and for each voxel
/// from the first one to the ray's place.
const ROUNDING: [f32; 2] = [2e-3, 4e-7];
/// A camera farther away than this is left to double precision, voxels.
const FAR: f64 = 1e4;
/// An axis along which a step moves less than this is not moved along, voxels: a million steps make a thousandth.
const STILL: f32 = 1e-9;

/// What all rays of a picture have in common.
pub struct Rays<'a> {
    pub(super) volume: &'a PreparedVolume,
    pub(super) voxels: Voxels<'a>,
    occupancy: &'a Occupancy,
    lookup: OccupancyLanes<'a>,
    pub(super) source: Source<'a>,
    scalar: Trilinear<'a>,
    /// The camera, grown voxel coordinates.
    pub(super) origin: Vec3,
    /// Where rays go.
    pub(super) directions: DirectionSource,
    /// What a step moves along an axis of the volume at the most, voxels.
    longest: f32,
    /// By how much less is leapt than a distance tells, voxels.
    rounding: f32,
    /// Border of the grown volume.
    border: Vec3,
    foot: f32,
    pub(super) lo: f32,
    iso: f32,
    pub(super) scale: f32,
    /// A step is h · 2^`power`: halvings of the opacity follow from it.
    power: i32,
    sensitivity: f32,
    /// A layer is shaded, and another begins, when the steps that its mean place lies back times its share of the light are
    /// more than the first number and the ray runs along the wall, and when it lies farther back than the second number.
    layer: [f32; 2],
    /// What a value changes by over a step at the most where a ray runs along the wall, HU: see [`STEEP`].
    steep: f32,
    /// Whether steps are twice as long as was asked for.
    smooth: bool,
    limit: f32,
    /// The camera, world, mm.
    pub(super) camera: DVec3,
    /// A step, mm.
    pub(super) step_mm: f32,
    /// What the light at the camera adds to the headlight.
    pub(super) lighting: Option<PacketLighting>,
    /// The shader that takes the headlight's place.
    pub(super) shader: Option<&'a dyn Shader>,
}

/// Another light than the headlight, for packets.
pub struct PacketLighting {
    pub light: Light,
    /// The rows of what turns world directions into voxels.
    pub to_voxel: [Vec3; 3],
}

/// What came of sixteen rays.
#[derive(Clone, Copy, Default)]
pub struct PacketResult {
    /// Brightness, weighted by what came through, 0 to 1.
    pub bright: [f32; 16],
    /// Brightness × HU above the palette's first.
    pub tone: [f32; 16],
    /// Share of light that would still come from beyond; NaN where the camera shows nothing.
    pub through: [f32; 16],
    /// Mean place of what is seen, steps from the camera, weighted as the light is (not divided by it).
    pub depth: [f32; 16],
    /// Number of layers that ended before another began.
    pub layers: [f32; 16],
    /// Of the first of several layers: its share of the light, and that times its place; 0 where there is one alone.
    pub front: [[f32; 16]; 2],
    /// Samples taken.
    pub samples: u32,
}

/// Whether something of the wall is about as near as [`NEAR`] to the camera, which is in `cell`. The voxels themselves are asked, so that
/// pictures do not depend on what is known to be empty.
fn is_near(volume: &PreparedVolume, cell: IVec3) -> bool {
    let (voxels, foot) = (volume.voxels(), volume.transfer().lo() + FOOT);
    let grid = voxels.grid();
    let reach = (NEAR * grid.min_spacing() / grid.spacing()).ceil().as_ivec3();
    // Cell g lies between the voxels g − 1 and g.
    let (first, last) = (cell - 1 - reach, cell + reach);
    let range = |a: usize| first[a].max(0)..=last[a].min(grid.dims()[a] as i32 - 1);
    range(2).any(|z| {
        range(1)
            .any(|y| range(0).any(|x| f32::from(voxels.data()[grid.index(x as usize, y as usize, z as usize)]) > foot))
    })
}

impl<'a> Rays<'a> {
    /// Prepares the rays of `view` in a scan with these [`waves`](super::blur::waves); `None` where they need what this caster
    /// does not have: two voxels along each axis, no more voxels, and pieces of their bits, than an `i32` counts, a camera within
    /// ten thousand voxels, rays that all begin there.
    pub fn new(
        volume: &'a PreparedVolume,
        occupancy: &'a Occupancy,
        waves: f32,
        view: &View,
        settings: &Settings,
        shader: Option<&'a dyn Shader>,
    ) -> Option<Self> {
        let samples = volume.voxels();
        let grid = samples.grid();
        let voxels = Voxels::new(samples)?;
        let origin = grid.voxel(view.position()) + DVec3::ONE;
        if origin.abs().max_element() > FAR || view.camera().origins() != Origins::One {
            return None;
        }
        let smooth = waves >= blur::LONGEST;
        // Half as many samples: values between them are known well enough, but where rays run along a wall that is close.
        // Who asks for shorter steps has them already.
        let near = settings.step_power >= -1 && is_near(volume, origin.floor().as_ivec3());
        let power = settings.step_power + 1 - i32::from(near);
        let step = Step::new(volume, power + i32::from(smooth));
        let per_step = [view.forward(), view.right(), view.up()]
            .map(|d| (grid.to_voxel().transform_vector3(d) * step.mm).as_vec3());
        let wall = volume.transfer();
        let border = Vec3::from_array(grid.dims().map(|n| (n + 1) as f32));
        // All directions are of unit length in the orthonormal frame of the camera, so that this holds where the volume's axes
        // are not at right angles, too.
        let longest = per_step.iter().map(|&s| s * s).sum::<Vec3>().max_element().sqrt();
        Some(Self {
            volume,
            voxels,
            occupancy,
            lookup: OccupancyLanes::new(occupancy)?,
            source: Source::new(samples, Regression::new(grid.spacing(), Weighting::InverseSquare), to_world(samples)),
            scalar: Trilinear::new(volume),
            origin: origin.as_vec3(),
            directions: DirectionSource::new(view, grid.to_voxel().matrix3 * step.mm, per_step),
            longest: longest.max(STILL),
            rounding: ROUNDING[0] + ROUNDING[1] * border.max_element().max(FAR as f32),
            border,
            foot: wall.lo() + FOOT,
            lo: wall.lo(),
            iso: wall.iso() as f32,
            scale: 1.0 / (wall.hi() - wall.lo()),
            power: step.power,
            sensitivity: settings.sensitivity,
            layer: layer::steps(if smooth { waves * 0.5 } else { waves }, power),
            steep: STEEP * 2f32.powi(step.power),
            smooth,
            limit: (1 << 22) as f32,
            camera: view.position(),
            step_mm: step.mm as f32,
            lighting: (settings.light != Light::HEADLIGHT).then(|| PacketLighting {
                light: settings.light,
                to_voxel: [0, 1, 2].map(|n| grid.to_voxel().matrix3.row(n).as_vec3()),
            }),
            shader,
        })
    }

    /// The colours of the packet that was cast last, where a shader of its own has given them.
    #[inline(always)]
    pub fn colours<'c>(&self, cells: &'c Cells) -> Option<&'c Colours> {
        self.shader.map(|_| &cells.colours)
    }

    /// By how much unit directions of neighbouring pixels differ at the most, where that is known.
    pub fn pixel_turn(&self) -> Option<f32> {
        self.directions.pixel_turn()
    }

    /// A step, voxels of the smallest spacing.
    pub fn step(&self) -> f32 {
        2f32.powi(self.power)
    }

    /// Casts a packet of rays `apart` pixels from each other, row by row, the first through the centre of pixel (`x`, `y`);
    /// nothing may be met before `from` steps.
    #[inline(always)]
    pub fn packet<S: Simd>(
        &self,
        simd: S,
        [x, y]: [usize; 2],
        apart: usize,
        from: f32,
        cells: &mut Cells,
    ) -> PacketResult {
        self.cast(simd, |n| [x + n % SIDE * apart, y + n / SIDE * apart], from, cells)
    }

    /// Casts the rays through the centres of pixels, each lane's as `pixel` says; nothing may be met before `from` steps.
    #[inline(always)]
    pub fn cast<S: Simd>(
        &self,
        simd: S,
        pixel: impl Fn(usize) -> [usize; 2],
        from: f32,
        cells: &mut Cells,
    ) -> PacketResult {
        let centre = |axis: usize| from_fn(|n| pixel(n)[axis] as f32 + 0.5);
        let mut light = PacketResult::default();
        self.cast_lanes(simd, [&centre(0), &centre(1)], from, cells, &mut light);
        light
    }

    /// A function of its own on each level, not inlined where it is called: it is large.
    #[inline(never)]
    fn cast_lanes<S: Simd>(
        &self,
        simd: S,
        [x, y]: [&[f32; 16]; 2],
        from: f32,
        cells: &mut Cells,
        light: &mut PacketResult,
    ) {
        if self.shader.is_some() {
            cells.colours = Colours::default();
        }
        simd.vectorize(
            #[inline(always)]
            || *light = self.trace(simd, f32x16::load_array_ref(simd, x), f32x16::load_array_ref(simd, y), from, cells),
        );
    }

    /// Casts the rays through the points (`x`, `y`) of the picture, in pixels from its top left corner.
    ///
    /// The loop is one long function on purpose: its dozen vectors live in registers from step to step, and what is handed
    /// to another function and back would not.
    #[inline(always)]
    fn trace<S: Simd>(&self, simd: S, x: f32x16<S>, y: f32x16<S>, from: f32, cells: &mut Cells) -> PacketResult {
        let one = f32x16::splat(simd, 1.0);
        let zero = f32x16::splat(simd, 0.0);
        let ray = self.directions.lanes(simd, x, y);

        let [enter, exit] = self.span(simd, &ray);
        let last = exit.floor();
        let mut active = exit.simd_ge(enter) & ray.shown;
        let mut light = Sums::new(simd);
        let mut samples = 0;
        if active.any_true() {
            let end = active.select(last, zero).reduce_max();
            let first = active.select(enter, f32x16::splat(simd, self.limit)).reduce_min().max(from);
            let mut k = first.min(end + 1.0).floor();
            let (foot, never) = (f32x16::splat(simd, self.foot), zero.simd_gt(one));
            // Who knows where to begin knows that nothing is seen there, and has leapt.
            let begun = from > 0.0 && first == from;
            let (mut v_before, mut v0) = (foot, foot);
            if !begun {
                // All of them: at 0 they are in one place, which tells whether the camera is in the wall.
                v0 = self.value(simd, &ray, k, !never);
                samples += 16;
            }
            let camera = if k == 0.0 && v0[0] > self.foot { Medium::Wall } else { Medium::Air };
            // Whether v0 was looked at, or is only known to be nothing.
            let mut sampled = !begun;
            let mut ask = if begun { k + PATIENCE } else { k };
            let mut open = never;
            while k < end + 1.0 {
                // Rays before the wall whose place in the middle of the step is in a cell that holds something.
                let mut thin = never;
                if self.smooth {
                    let before = active & v0.simd_le(self.iso);
                    if before.any_true() {
                        let (cell, _) = split(ray.at(self.origin, k + 0.5));
                        thin = before & self.lookup.set(simd, cell);
                    }
                }
                if !(active & v0.simd_gt(foot)).any_true() {
                    let (cell, _) = split(ray.at(self.origin, k + 1.0));
                    if !thin.any_true() && !self.lookup.any(simd, cell, active) {
                        k += 1.0;
                        if k >= ask {
                            let leap = self.leap(self.lookup.nearest(simd, cell, active));
                            k += leap;
                            ask = if leap > 0.0 { k } else { k + PATIENCE };
                        }
                        (v0, sampled, open) = (foot, false, never);
                        active &= (zero + k).simd_le(last);
                        if !active.any_true() {
                            break;
                        }
                        continue;
                    }
                    ask = k + PATIENCE;
                }
                let v1 = self.value(simd, &ray, k + 1.0, active);
                samples += 16;
                let mut shows = active & v1.simd_gt(foot);
                thin &= v1.simd_le(self.iso);
                let mut middle = foot;
                if thin.any_true() {
                    middle = self.value(simd, &ray, k + 0.5, thin);
                    samples += 16;
                    // Where nothing is, the cell may as well be known to be empty.
                    thin &= middle.simd_gt(foot);
                    shows |= thin;
                }
                // How far below the foot it was matters where something shows after it.
                if !sampled && shows.any_true() {
                    v0 = self.value(simd, &ray, k, active);
                    samples += 16;
                }
                sampled = true;
                // A parabola through three samples for the rays that were in the wall before this step, too, a line for others.
                let rise = v1 - v0;
                let curve = (open & v0.simd_gt(foot)).select(rise - (v0 - v_before), zero);
                let [outer, inner] = [curve * (7.0 / 128.0), curve * (15.0 / 128.0)];
                let [mut a, mut b] = [v0 + rise * 0.125 - outer, v0 + rise * 0.375 - inner];
                let [mut c, mut d] = [v0 + rise * 0.625 - inner, v0 + rise * 0.875 - outer];
                let mut v_behind = v0;
                if thin.any_true() {
                    // The next step's parabola goes on from what is known of this one's second half.
                    v_behind = thin.select(middle * 2.0 - v1, v0);
                    let [near, far] = [middle - v0, v1 - middle];
                    [a, b] = [thin.select(v0 + near * 0.25, a), thin.select(v0 + near * 0.75, b)];
                    [c, d] = [thin.select(middle + far * 0.25, c), thin.select(middle + far * 0.75, d)];
                }
                let seen = active & a.max(b).max(c.max(d)).simd_gt(foot);
                if seen.any_true() {
                    let Layer { weight, place, .. } = light.layer;
                    let fresh = light.layer.any();
                    let behind = zero + k - place / fresh.select(weight, one);
                    let [long, far] = self.layer;
                    let long = (behind * weight).simd_gt(long) & rise.abs().simd_lt(self.steep) | behind.simd_gt(far);
                    let turned = rise.simd_lt(zero) & v0.simd_ge(v_before);
                    let ended = seen & fresh & (!open | long | turned);
                    if ended.any_true() {
                        self.end(simd, &ray, ended, &mut light, cells, camera);
                        light.count(simd, ended & !open);
                    }
                    let layer = &mut light.layer;
                    let mut left = light.through;
                    for (value, place) in [(a, 0.125), (b, 0.375), (c, 0.625), (d, 0.875)] {
                        let next = left * self.through(simd, value);
                        let w = seen.select(left - next, zero);
                        layer.weight += w;
                        layer.place += w * (k + place);
                        layer.value += w * self.tone(simd, value);
                        left = next;
                    }
                    light.through = seen.select(left, light.through);
                }
                open = seen;
                k += 1.0;
                (v_before, v0) = (v_behind, v1);
                active = active & light.through.simd_ge(self.sensitivity) & (zero + k).simd_le(last);
                if !active.any_true() {
                    break;
                }
            }
            // First those that wait and those of the rays for which none does, then what is left.
            for _ in 0..2 {
                let free = light.layer.any() & !light.waiting.any();
                light.end(simd, free);
                if light.waiting.any().any_true() {
                    self.shade(simd, &ray, &mut light, cells, camera);
                }
            }
            if let Some(lighting) = self.lighting.as_ref().filter(|l| l.light.contact && self.shader.is_none()) {
                self.darken(simd, &ray, &mut light, lighting);
            }
        }
        PacketResult {
            bright: light.bright.to_array(),
            tone: light.tone.to_array(),
            through: ray.shown.select(light.through, f32x16::splat(simd, f32::NAN)).to_array(),
            depth: light.depth.to_array(),
            layers: light.layers.to_array(),
            front: [light.front[0].to_array(), light.front[1].to_array()],
            samples,
        }
    }

    /// Where the rays enter and leave the grown volume, steps.
    #[inline(always)]
    fn span<S: Simd>(&self, simd: S, ray: &Directions<S>) -> [f32x16<S>; 2] {
        let (zero, one) = (f32x16::splat(simd, 0.0), f32x16::splat(simd, 1.0));
        let (mut enter, mut exit) = (zero, f32x16::splat(simd, self.limit));
        for a in 0..3 {
            let along = ray.along[a];
            let moves = along.abs().simd_gt(STILL);
            let inverse = one / moves.select(along, one);
            let (near, far) = (inverse * -self.origin[a], inverse * (self.border[a] - self.origin[a]));
            let within = self.origin[a] >= 0.0 && self.origin[a] <= self.border[a];
            let still = if within { self.limit } else { -1.0 };
            enter = enter.max(moves.select(near.min(far), zero));
            exit = exit.min(moves.select(near.max(far), f32x16::splat(simd, still)));
        }
        [enter, exit]
    }

    /// How many steps a ray may leap from a brick that is `distance` bricks from the next one with anything.
    #[inline(always)]
    fn leap(&self, distance: i32) -> f32 {
        let voxels = ((distance - 1).max(0) << BRICK_SHIFT) as f32;
        ((voxels - self.rounding).max(0.0) / self.longest).floor()
    }

    /// How many steps no ray through the rectangle of `size` pixels with the top left corner (`x`, `y`) meets anything, if it
    /// is known that they meet nothing before `from` steps.
    #[inline(never)]
    pub fn start<S: Simd>(&self, simd: S, [x, y]: [f32; 2], size: [f32; 2], from: f32) -> f32 {
        simd.vectorize(
            #[inline(always)]
            || {
                let apart = size.map(|s| s / 3.0);
                let n: [f32; 16] = from_fn(|n| n as f32);
                let n = f32x16::load_array_ref(simd, &n);
                let row = (n * 0.25).floor();
                let ray = self.directions.lanes(simd, (n - row * 4.0) * apart[0] + x, row * apart[1] + y);
                let Some(margin) = self.directions.margin(&ray, apart) else { return from };
                ray.beam(self.origin, margin * self.longest).next(self.occupancy, from, self.limit)
            },
        )
    }

    /// Trilinear HU of the rays in `wanted` at `k`; of the others anything.
    #[inline(always)]
    fn value<S: Simd>(&self, simd: S, ray: &Directions<S>, k: f32, wanted: mask32x16<S>) -> f32x16<S> {
        self.value_at(simd, ray.at(self.origin, k), wanted)
    }

    /// Trilinear HU at the places `q` of the lanes in `wanted`; of the others anything.
    #[inline(always)]
    pub(super) fn value_at<S: Simd>(&self, simd: S, q: [f32x16<S>; 3], wanted: mask32x16<S>) -> f32x16<S> {
        let (cell, t) = split(q);
        let value = interpolate(simd, self.voxels.corners(simd, cell, wanted), t);
        let last = self.voxels.last();
        let low = cell[0].min(cell[1]).min(cell[2]).simd_lt(1);
        let beyond = cell[0].simd_gt(last[0]) | cell[1].simd_gt(last[1]) | cell[2].simd_gt(last[2]);
        let outside = wanted & (low | beyond);
        if outside.any_true() {
            return self.at_border(simd, value, q, outside.to_bitmask());
        }
        value
    }

    /// Values at and beyond the volume's border, one by one.
    #[inline(never)]
    fn at_border<S: Simd>(&self, simd: S, value: f32x16<S>, q: [f32x16<S>; 3], mut lanes: u64) -> f32x16<S> {
        let mut all = value.to_array();
        while lanes != 0 {
            let n = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            let q = Vec3::new(q[0][n], q[1][n], q[2][n]);
            all[n] = self.scalar.value(q.clamp(Vec3::ZERO, self.border));
        }
        all.simd_into(simd)
    }

    /// What a quarter of a step at the value `hu` lets through.
    #[inline(always)]
    fn through<S: Simd>(&self, simd: S, hu: f32x16<S>) -> f32x16<S> {
        let one = f32x16::splat(simd, 1.0);
        let a = ((hu - self.lo) * self.scale).min(one);
        let mut t = hu.simd_gt(self.foot).select(one - a, one);
        for _ in self.power..2 {
            t = t.sqrt();
        }
        for _ in 2..self.power {
            t = t * t;
        }
        t
    }

    /// HU above the palette's first.
    #[inline(always)]
    fn tone<S: Simd>(&self, simd: S, hu: f32x16<S>) -> f32x16<S> {
        let [low, high] = PALETTE_HU;
        let zero = f32x16::splat(simd, 0.0);
        (hu - low).max(zero).min(f32x16::splat(simd, high - low))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DMat3;

    use super::super::levels;
    use super::*;
    use crate::render::{Quality, TransferFunction};
    use crate::volume::{Grid, Volume};

    /// Steps of two voxels meet walls of one voxel and more wherever the steps' ends lie. Without a look at the middle they pass
    /// over some of them.
    #[test]
    fn long_steps_miss_no_thin_wall() {
        let grid = Grid::new([64, 48, 48], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let value = |n: usize, behind: i16| match n % 64 {
            30 => 0,
            31 => behind,
            _ => -1000,
        };
        for behind in [-1000, -900, -800, -700, -600, -300, 0] {
            let data = (0..grid.len()).map(|n| value(n, behind)).collect();
            let volume = PreparedVolume::new(Arc::new(Volume::new(grid.clone(), data)), TransferFunction::default());
            let occupancy = Occupancy::new(volume.voxels(), volume.transfer());
            for shift in 0..40 {
                let from = DVec3::new(4.0 + 0.05 * f64::from(shift), 24.3, 23.6);
                let view = View::new(from, DVec3::X, DVec3::Z, 12.0, 16, 16).unwrap();
                let settings = Settings::new(Quality::High);
                let [short, long] = [1.0, blur::LONGEST].map(|waves| {
                    let rays = Rays::new(&volume, &occupancy, waves, &view, &settings, None).unwrap();
                    assert_eq!(rays.step(), waves);
                    let mut cells = Cells::default();
                    fearless_simd::dispatch!(levels()[0].1, simd => rays.packet(simd, [0, 0], 4, 0.0, &mut cells))
                });
                for n in 0..16 {
                    let through = [short.through[n], long.through[n]];
                    let [a, b] = [short.depth[n], 2.0 * long.depth[n]];
                    let depth = [a / (1.0 - through[0]), b / (1.0 - through[1])];
                    // One voxel is seen, two let nothing through.
                    let most = if behind == 0 { 0.01 } else { 0.65 };
                    assert!(through[0] < 0.01 && through[1] < most, "{behind} {shift} {n}: {through:?}");
                    // Less than a long step apart.
                    assert!((depth[0] - depth[1]).abs() < 1.6, "{behind} {shift} {n}: {depth:?}");
                }
            }
        }
    }
}
