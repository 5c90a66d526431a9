//! Traces sixteen rays at once, from their first sample to their light.
//!
//! The recurrence is that of [`caster`](crate::render::caster): L ← L + (1 − A)·C, (1 − A) ← (1 − A)(1 − a). Three things differ.
//!
//! **Steps.** The volume is sampled at t = k·Δs. Between two samples the value is taken as linear (pre-integration,
//! Engel, Kraus and Ertl 2001). Where the ray was in the wall before, it is taken as the parabola that also passes
//! through the previous sample, because a ray that grazes a rim is deepest between two samples. Each step is composed
//! of four quarter steps evaluated at their middles, so that a step that rises over the whole ramp still meets the ramp
//! in the right place. Values are smooth on the scale of a voxel, so this is as good as quarter steps that are each
//! sampled. Where the scan is smooth on the scale of two voxels ([`blur`](super::blur)), steps are twice as long. So
//! that these miss no wall that shorter steps would meet, a step is also sampled in its middle if both its ends are
//! before the wall and its middle is in an occupied cell.
//!
//! **Light.** A ray's light from one layer of the wall is computed at the layer's mean position and mean value
//! ([`layer`](super::layer)). A layer ends where a step adds nothing, where values begin to fall, as behind the middle
//! of a thin fold, or when it gets long ([`Rays::layer`]). Length matters where a ray runs along the wall and the wall
//! turns beneath it. Close to the camera, rays run along the wall in whole regions of the picture, and steps are half
//! as long.
//!
//! **Empty space.** The distance at which a bundle of rays first meets something may be known before it is cast
//! ([`Beam`](super::beam::Beam)). From there on, a step is taken without reading the volume if no ray sees anything at
//! its start and all positions to sample are in empty cells. After several such steps in a row ([`PATIENCE`]) the rays
//! leap, all of them equally far. Samples stay at the same positions whatever is left out, so this changes no bit of
//! the picture.

use std::array::from_fn;

use fearless_simd::{Simd, f32x16, mask32x16, prelude::*};

use super::cells::{Cells, Colours};
use super::directions::{Directions, split};
use super::layer::{Layer, Medium, Sums};
use super::occupancy::BRICK_SHIFT;
use super::rays::{PacketResult, Rays, SIDE, STILL};
use crate::render::transfer::PALETTE_HU;

/// After this many empty steps in a row, the distances of the rays' bricks are looked up; near a wall this is not
/// worthwhile. After a leap, and where nothing was known before, they are looked up at once.
const PATIENCE: f32 = 8.0;

impl Rays<'_> {
    /// Casts a packet of rays `apart` pixels from each other, row by row, the first through the centre of pixel (`x`, `y`).
    ///
    /// The rays must meet nothing before `from` steps.
    #[inline(always)]
    pub(crate) fn packet<S: Simd>(
        &self,
        simd: S,
        [x, y]: [usize; 2],
        apart: usize,
        from: f32,
        cells: &mut Cells,
    ) -> PacketResult {
        self.cast(simd, |n| [x + n % SIDE * apart, y + n / SIDE * apart], from, cells)
    }

    /// Casts rays through the centres of pixels; `pixel` returns the pixel of each lane. The rays must meet nothing
    /// before `from` steps.
    #[inline(always)]
    pub(crate) fn cast<S: Simd>(
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

    /// A separate function for each level, not inlined into its callers: it is large.
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
    /// The loop is one long function on purpose: its dozen vectors stay in registers from step to step, which they
    /// would not if they were passed to another function and back.
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
            // If the start is known, the rays have already leapt there, and nothing is visible at it.
            let begun = from > 0.0 && first == from;
            let (mut v_before, mut v0) = (foot, foot);
            if !begun {
                // All of them: at 0 they are in one place, which shows whether the camera is in the wall.
                v0 = self.value(simd, &ray, k, !never);
                samples += 16;
            }
            let camera = if k == 0.0 && v0[0] > self.foot { Medium::Wall } else { Medium::Air };
            // True if v0 was sampled, false if it is only known to be empty.
            let mut sampled = !begun;
            let mut ask = if begun { k + PATIENCE } else { k };
            let mut open = never;
            while k < end + 1.0 {
                // Rays before the wall whose position in the middle of the step is in an occupied cell.
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
                    // A middle that shows nothing is treated like a cell that is known to be empty.
                    thin &= middle.simd_gt(foot);
                    shows |= thin;
                }
                // How far v0 was below the foot matters if something shows after it.
                if !sampled && shows.any_true() {
                    v0 = self.value(simd, &ray, k, active);
                    samples += 16;
                }
                sampled = true;
                // A parabola through three samples for rays that were in the wall before this step, too, and a line for the others.
                let rise = v1 - v0;
                let curve = (open & v0.simd_gt(foot)).select(rise - (v0 - v_before), zero);
                let [outer, inner] = [curve * (7.0 / 128.0), curve * (15.0 / 128.0)];
                let [mut a, mut b] = [v0 + rise * 0.125 - outer, v0 + rise * 0.375 - inner];
                let [mut c, mut d] = [v0 + rise * 0.625 - inner, v0 + rise * 0.875 - outer];
                let mut v_behind = v0;
                if thin.any_true() {
                    // The next step's parabola continues from the second half of this one.
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
            // First the waiting layers, and those of the rays without a waiting layer; then the rest.
            for _ in 0..2 {
                let free = light.layer.any() & !light.waiting.any();
                light.end(simd, free);
                if light.waiting.any().any_true() {
                    self.shade(simd, &ray, &mut light, cells, camera);
                }
            }
            if let Some((lighting, surround)) = self.lighting.as_ref().and_then(|l| Some((l, l.surround.as_ref()?)))
                && self.shader.is_none()
            {
                self.darken(simd, &ray, &mut light, lighting.to_voxel, surround);
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

    /// Returns where the rays enter and leave the grown volume, steps.
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

    /// Returns how many steps a ray may leap from a brick that is `distance` bricks from the next occupied one.
    #[inline(always)]
    fn leap(&self, distance: i32) -> f32 {
        let voxels = ((distance - 1).max(0) << BRICK_SHIFT) as f32;
        ((voxels - self.rounding).max(0.0) / self.longest).floor()
    }

    /// Returns the number of steps for which no ray through a rectangle of the picture meets anything.
    ///
    /// The rectangle has `size` pixels and its top left corner at (`x`, `y`). Its rays must be known to meet nothing
    /// before `from` steps.
    #[inline(never)]
    pub(crate) fn start<S: Simd>(&self, simd: S, [x, y]: [f32; 2], size: [f32; 2], from: f32) -> f32 {
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

    /// Returns the trilinear HU of the rays in `wanted` at `k`; other lanes are arbitrary.
    #[inline(always)]
    fn value<S: Simd>(&self, simd: S, ray: &Directions<S>, k: f32, wanted: mask32x16<S>) -> f32x16<S> {
        self.value_at(simd, ray.at(self.origin, k), wanted)
    }

    /// Returns the share of light that a quarter of a step at the value `hu` lets through.
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

    /// Returns HU above the palette's first.
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

    use glam::{DMat3, DVec3};

    use super::super::{blur, levels};
    use super::*;
    use crate::render::packets::occupancy::Occupancy;
    use crate::render::{Quality, Settings, View};
    use crate::space::{PreparedVolume, TransferFunction};
    use crate::volume::{Grid, Volume};

    /// Steps of two voxels meet walls of one voxel or more wherever the steps end. Without a sample in the middle they
    /// would pass over some of them.
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

    /// Within the wall, values between two samples lie on the parabola through them and the sample before. With one
    /// sample per voxel, a scan that is a parabola along the rays gives exactly its own values.
    #[test]
    fn values_between_samples_are_those_of_a_parabola() {
        let parabola = |x: f64| -700.0 - 20.0 * (x - 30.0) * (x - 31.0);
        let grid = Grid::new([64, 48, 48], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let value = |n: usize| match n % 64 {
            x @ 28..=33 => parabola(x as f64) as i16,
            _ => -1000,
        };
        let data = (0..grid.len()).map(value).collect();
        let volume = PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default());
        let occupancy = Occupancy::new(volume.voxels(), volume.transfer());
        // So narrow that all rays run along x.
        let view = View::new(DVec3::new(4.0, 24.0, 23.0), DVec3::X, DVec3::Z, 0.1, 16, 16).unwrap();
        let rays = Rays::new(&volume, &occupancy, 1.0, &view, &Settings::new(Quality::High), None).unwrap();
        assert_eq!(rays.step(), 1.0);
        let mut cells = Cells::default();
        let found = fearless_simd::dispatch!(levels()[0].1, simd => rays.packet(simd, [0, 0], 4, 0.0, &mut cells));
        // The quarter steps from the last sample before the wall on. In the first step, values are linear.
        let mut expected = 1.0;
        for quarter in 0..20 {
            let x = 28.125 + 0.25 * f64::from(quarter);
            let hu =
                if x < 29.0 { parabola(28.0) + (parabola(29.0) - parabola(28.0)) * (x - 28.0) } else { parabola(x) };
            let opacity = ((hu + 800.0) / 300.0).clamp(0.0, 1.0);
            expected *= (1.0 - opacity).powf(0.25);
        }
        assert!((0.2..0.4).contains(&expected), "the wall is seen, and is no mere edge: {expected}");
        for (n, through) in found.through.into_iter().enumerate() {
            assert!((f64::from(through) - expected).abs() < 1e-3, "ray {n}: {through}, not {expected}");
        }
    }
}
