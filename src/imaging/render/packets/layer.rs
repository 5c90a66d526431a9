//! Layers: a layer is a surface hit that a ray passes through or ends in.
//!
//! A layer's light is computed at its mean position and mean value, both weighted by what each quarter of a step adds.
//! The gradient is therefore evaluated once per layer and not at each sample.
//!
//! Brightness is not a linear function of position: along a ray that grazes a rim, the wall turns from facing the ray
//! to facing away, where brightness stays at its minimum. So a layer ends where its values begin to fall, and one
//! position does not stand for a long stretch.
//!
//! A layer that has ended waits until another layer of the same ray ends, or until all rays have ended. The more layers
//! are shaded at once, the less time each takes.

use fearless_simd::{Simd, f32x16, i32x16, mask32x16, prelude::*};
use glam::Vec3;

use super::cells::{Cells, Colours};
use super::directions::{Directions, split};
use super::fit::gradients;
use super::rays::{PacketLighting, Rays, SurroundLanes};
use crate::render::light::{CONTACT, CONTACT_LEAST, EXPOSURE, FLAT, GLOSS, GLOSS_DOUBLINGS, GLOSS_FROM, Light};
use crate::render::sampler::is_homogeneous;
use crate::render::shaders::headlight::{AMBIENT, DIFFUSE};
use crate::render::shaders::{Shader, SurfacePoint, shown};
use crate::render::transfer::PALETTE_HU;
use crate::space::surround::LEVELS;

/// If sixteen rays are in more cells than this, the regression is computed for each ray. On AVX-512 that pays off from
/// four cells on, on AVX2 from eight; a single number is used so that every SIMD level gives the same bits.
const MANY: usize = 8;
/// The medium that a camera is in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Medium {
    /// Air: rays see nothing of it.
    Air,
    /// Visible matter: the camera is within the wall.
    Wall,
}

/// The part of the wall that sixteen rays meet: its weight, and the weight times position (steps) and times value (HU
/// above the palette's first).
#[derive(Clone, Copy)]
pub(crate) struct Layer<S: Simd> {
    pub weight: f32x16<S>,
    pub place: f32x16<S>,
    pub value: f32x16<S>,
}

impl<S: Simd> Layer<S> {
    /// Returns an empty layer.
    #[inline(always)]
    pub(crate) fn none(simd: S) -> Self {
        let zero = f32x16::splat(simd, 0.0);
        Self { weight: zero, place: zero, value: zero }
    }

    /// Returns the rays that have something.
    #[inline(always)]
    pub(crate) fn any(&self) -> mask32x16<S> {
        self.weight.simd_gt(0.0)
    }

    /// Takes the layer of the rays in `mask` and leaves them an empty one.
    #[inline(always)]
    fn take(&mut self, simd: S, mask: mask32x16<S>) -> Self {
        let all = *self;
        let zero = f32x16::splat(simd, 0.0);
        self.weight = mask.select(zero, all.weight);
        self.place = mask.select(zero, all.place);
        self.value = mask.select(zero, all.value);
        Self {
            weight: mask.select(all.weight, zero),
            place: mask.select(all.place, zero),
            value: mask.select(all.value, zero),
        }
    }
}

/// Sums accumulated by sixteen rays. Weights are shares of the light that reaches the camera.
pub(crate) struct Sums<S: Simd> {
    pub bright: f32x16<S>,
    pub tone: f32x16<S>,
    pub depth: f32x16<S>,
    /// 1 − A.
    pub through: f32x16<S>,
    /// The current layer.
    pub layer: Layer<S>,
    /// A layer that has ended and is not yet shaded.
    pub waiting: Layer<S>,
    /// Number of layers that ended before another began.
    pub layers: f32x16<S>,
    /// The weight of the first of them, and its weight times position, if another layer came after it.
    pub front: [f32x16<S>; 2],
    /// Normals into the gas (world) times weights, for lights other than the headlight.
    pub normal: [f32x16<S>; 3],
}

impl<S: Simd> Sums<S> {
    /// Creates empty sums.
    #[inline(always)]
    pub(crate) fn new(simd: S) -> Self {
        let (zero, one) = (f32x16::splat(simd, 0.0), f32x16::splat(simd, 1.0));
        let none = Layer::none(simd);
        Self {
            bright: zero,
            tone: zero,
            depth: zero,
            through: one,
            layer: none,
            waiting: none,
            layers: zero,
            front: [zero; 2],
            normal: [zero; 3],
        }
    }

    /// Makes the layers of the rays in `mask` wait to be shaded. None of these rays may have a waiting layer.
    #[inline(always)]
    pub(crate) fn end(&mut self, simd: S, mask: mask32x16<S>) {
        let ended = self.layer.take(simd, mask);
        self.depth += ended.place;
        self.waiting.weight += ended.weight;
        self.waiting.place += ended.place;
        self.waiting.value += ended.value;
    }

    /// Counts the layers of the rays in `mask`, which have ended: others begin.
    #[inline(always)]
    pub(crate) fn count(&mut self, simd: S, mask: mask32x16<S>) {
        let (zero, one) = (f32x16::splat(simd, 0.0), f32x16::splat(simd, 1.0));
        let first = mask & self.layers.simd_lt(0.5);
        self.front = [first.select(one - self.through, self.front[0]), first.select(self.depth, self.front[1])];
        self.layers += mask.select(one, zero);
    }
}

/// The layers of sixteen rays, in the form in which a custom shader is called for them.
struct OwnLayers {
    weight: [f32; 16],
    place: [f32; 16],
    value: [f32; 16],
    /// World, HU/mm.
    gradient: [[f32; 16]; 3],
    /// World, of unit length.
    direction: [[f32; 16]; 3],
}

impl Rays<'_> {
    /// Ends the layers of the rays in `mask`. If one of these rays already has a waiting layer, the waiting layers are
    /// shaded first.
    #[inline(always)]
    pub(crate) fn end<S: Simd>(
        &self,
        simd: S,
        ray: &Directions<S>,
        mask: mask32x16<S>,
        light: &mut Sums<S>,
        cells: &mut Cells,
        camera: Medium,
    ) {
        if (mask & light.waiting.any()).any_true() {
            self.shade(simd, ray, light, cells, camera);
        }
        light.end(simd, mask);
    }

    /// Shades the waiting layers.
    #[inline(never)]
    pub(crate) fn shade<S: Simd>(
        &self,
        simd: S,
        ray: &Directions<S>,
        light: &mut Sums<S>,
        cells: &mut Cells,
        camera: Medium,
    ) {
        simd.vectorize(
            #[inline(always)]
            || {
                let zero = f32x16::splat(simd, 0.0);
                let one = f32x16::splat(simd, 1.0);
                let Layer { weight, place, value } = light.waiting;
                let mask = light.waiting.any();
                let q = ray.at_each(self.origin, place / mask.select(weight, one));
                let (cell, t) = split(q);
                let g = self.gradient(simd, mask, cell, t, cells);
                let dot = g[0] * ray.world[0] + g[1] * ray.world[1] + g[2] * ray.world[2];
                let square = g[0] * g[0] + g[1] * g[1] + g[2] * g[2];
                // A thousandth of an HU per mm is the rounding of a flat region.
                let steep = square.simd_gt(1e-6);
                let mut facing = steep.select((dot / steep.select(square, one).sqrt()).max(zero), one);
                if camera == Medium::Wall {
                    self.face_camera(&mut facing, q, mask.to_bitmask());
                }
                match self.shader {
                    None => {
                        let shade = match &self.lighting {
                            None => facing * DIFFUSE + AMBIENT,
                            Some(lighting) => {
                                if lighting.surround.is_some() {
                                    // Into the gas: against the gradient.
                                    let length = steep.select(square, one).sqrt();
                                    let share = (mask & steep).select(weight / length, zero);
                                    for (sum, g) in light.normal.iter_mut().zip(g) {
                                        *sum -= g * share;
                                    }
                                }
                                let distance = place / mask.select(weight, one) * self.step_mm;
                                self.lit(simd, lighting, facing, distance)
                            }
                        };
                        light.bright += mask.select(weight * shade, zero);
                        light.tone += mask.select(value * shade, zero);
                    }
                    Some(shader) => {
                        // What adaptive sampling judges the wall's shape by.
                        light.bright += mask.select(weight * (facing * DIFFUSE + AMBIENT), zero);
                        // A gradient of 0 marks a homogeneous region.
                        let flat = (steep & facing.simd_lt(one)).select(one, zero);
                        let layers = OwnLayers {
                            weight: weight.to_array(),
                            place: place.to_array(),
                            value: value.to_array(),
                            gradient: g.map(|g| (g * flat).to_array()),
                            direction: ray.world.map(|d| d.to_array()),
                        };
                        self.shade_by(shader, &layers, mask.to_bitmask(), &mut cells.colours);
                    }
                }
                light.waiting = Layer::none(simd);
            },
        );
    }

    /// Returns the brightness of sixteen points in a light other than the headlight, without contact shadow. `distance`
    /// is the distance from the camera, mm.
    ///
    /// [`light`](crate::render::light) has the formula.
    #[inline(always)]
    fn lit<S: Simd>(
        &self,
        simd: S,
        lighting: &PacketLighting<'_>,
        facing: f32x16<S>,
        distance: f32x16<S>,
    ) -> f32x16<S> {
        let one = f32x16::splat(simd, 1.0);
        let Light { falloff, gloss, .. } = lighting.light;
        let mut bright = facing * DIFFUSE + AMBIENT;
        let mut arriving = one;
        if falloff {
            let d = distance * (1.0 / lighting.half_mm);
            arriving = one / (d * d + 1.0);
            bright *= arriving * EXPOSURE;
        }
        if gloss {
            let mut shine = facing.max(GLOSS_FROM);
            for _ in 0..GLOSS_DOUBLINGS {
                shine *= shine;
            }
            bright += arriving * shine * GLOSS;
        }
        bright
    }

    /// Darkens rays whose wall has another wall close in front of it. `to_voxel` turns world directions into voxels.
    #[inline(never)]
    pub(crate) fn darken<S: Simd>(
        &self,
        simd: S,
        ray: &Directions<S>,
        light: &mut Sums<S>,
        to_voxel: [Vec3; 3],
        surround: &[SurroundLanes<'_>; LEVELS],
    ) {
        simd.vectorize(
            #[inline(always)]
            || {
                let (zero, one) = (f32x16::splat(simd, 0.0), f32x16::splat(simd, 1.0));
                let n = light.normal;
                let square = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
                let seen = one - light.through;
                let wanted = seen.simd_gt(1e-3) & square.simd_gt(1e-6);
                if !wanted.any_true() {
                    return;
                }
                let unit = wanted.select(one / wanted.select(square, one).sqrt(), zero);
                let n = n.map(|n| n * unit);
                let before = to_voxel.map(|row| n[0] * row.x + n[1] * row.y + n[2] * row.z);
                let at = ray.at_each(self.origin, light.depth / wanted.select(seen, one));
                let mut open = one;
                for (level, share) in surround.iter().zip(CONTACT) {
                    let at = [0, 1, 2].map(|a| before[a] * level.ahead_mm + at[a]);
                    let near = (level.opacity(simd, at, wanted) - FLAT).max(zero);
                    open -= wanted.select(near * share, zero);
                }
                let open = open.max(CONTACT_LEAST);
                light.bright *= open;
                light.tone *= open;
            },
        );
    }

    /// Adds the light that a custom shader gives to the layers in `lanes`.
    #[inline(never)]
    fn shade_by(&self, shader: &dyn Shader, layers: &OwnLayers, mut lanes: u64, colours: &mut Colours) {
        while lanes != 0 {
            let n = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            let [gradient, direction] =
                [&layers.gradient, &layers.direction].map(|v| Vec3::new(v[0][n], v[1][n], v[2][n]));
            let weight = layers.weight[n];
            let distance = layers.place[n] / weight * self.step_mm;
            let hu = PALETTE_HU[0] + layers.value[n] / weight;
            let colour = shown(shader.colour(&SurfacePoint::new(self.camera, direction, distance, hu, gradient)));
            for (channel, colour) in colours.iter_mut().zip(colour.to_array()) {
                channel[n] += weight * colour;
            }
        }
    }

    /// Makes homogeneous regions face the camera. Only a camera within the wall sees one.
    #[inline(never)]
    fn face_camera<S: Simd>(&self, facing: &mut f32x16<S>, q: [f32x16<S>; 3], mut lanes: u64) {
        while lanes != 0 {
            let n = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            if is_homogeneous(self.volume, Vec3::new(q[0][n], q[1][n], q[2][n])) {
                facing[n] = 1.0;
            }
        }
    }

    /// Returns the world gradient at the positions `t` in the cells of the rays in `mask`.
    ///
    /// It is computed cell by cell where neighbouring rays share cells, and ray by ray where there are many cells.
    #[inline(always)]
    fn gradient<S: Simd>(
        &self,
        simd: S,
        mask: mask32x16<S>,
        cell: [i32x16<S>; 3],
        t: [f32x16<S>; 3],
        cells: &mut Cells,
    ) -> [f32x16<S>; 3] {
        let [nx, ny, _] = self.voxels.last();
        let key = cell[0] + (cell[1] + cell[2] * (ny + 2)) * (nx + 2);
        let lanes = mask.to_bitmask();
        let mut others = lanes;
        for _ in 0..MANY {
            if others != 0 {
                others &= !key.simd_eq(key[others.trailing_zeros() as usize]).to_bitmask();
            }
        }
        if others != 0
            && let Some(blocks) = self.voxels.blocks(simd, cell, mask)
        {
            let g = gradients(simd, self.source.regression(), &blocks, t);
            return self.source.to_world().map(|row| g[0] * row.x + g[1] * row.y + g[2] * row.z);
        }
        self.gradient_by_cells(simd, lanes, key, cell, t, cells)
    }

    /// Computes the gradient cell by cell.
    #[inline(always)]
    fn gradient_by_cells<S: Simd>(
        &self,
        simd: S,
        mut lanes: u64,
        key: i32x16<S>,
        cell: [i32x16<S>; 3],
        t: [f32x16<S>; 3],
        cells: &mut Cells,
    ) -> [f32x16<S>; 3] {
        let mut g = [f32x16::splat(simd, 0.0); 3];
        while lanes != 0 {
            let n = lanes.trailing_zeros() as usize;
            let same = key.simd_eq(key[n]);
            lanes &= !same.to_bitmask();
            let corners = cells.get(&self.source, key[n], [cell[0][n], cell[1][n], cell[2][n]]);
            for a in 0..3 {
                let k = &corners[a];
                let low = t[0] * k[1] + k[0] + (t[0] * k[4] + k[2]) * t[1];
                let high = t[0] * k[5] + k[3] + (t[0] * k[7] + k[6]) * t[1];
                g[a] = same.select(low + high * t[2], g[a]);
            }
        }
        g
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{DMat3, DVec3};

    use super::*;
    use crate::math::hash;
    use crate::render::packets::levels;
    use crate::render::packets::occupancy::Occupancy;
    use crate::render::{Quality, Settings, View};
    use crate::space::{PreparedVolume, TransferFunction};
    use crate::volume::{Grid, Volume};

    /// On a rotated grid of stretched voxels both methods give the world gradient, in the wanted rays and in no others.
    #[test]
    fn cell_by_cell_is_ray_by_ray() {
        let turn = DMat3::from_rotation_z(0.4) * DMat3::from_rotation_x(-1.1);
        let grid = Grid::new([20, 18, 16], DVec3::new(0.7, 0.9, 1.6), DVec3::splat(-3.0), turn).unwrap();
        // The world gradient is (30, -20, 10) everywhere, in whole HU.
        let slope = DVec3::new(30.0, -20.0, 10.0);
        let value = |n: usize| {
            let [x, y, z] = [n % 20, n / 20 % 18, n / 360].map(|c| c as f64);
            slope.dot(turn * (DVec3::new(x, y, z) * DVec3::new(0.7, 0.9, 1.6))).round() as i16
        };
        let volume = PreparedVolume::new(
            Arc::new(Volume::new(grid, (0..20 * 18 * 16).map(value).collect())),
            TransferFunction::default(),
        );
        let occupancy = Occupancy::new(volume.voxels(), volume.transfer());
        let view = View::new(DVec3::ZERO, DVec3::X, DVec3::Z, 90.0, 64, 64).unwrap();
        let rays = Rays::new(&volume, &occupancy, 1.0, &view, &Settings::new(Quality::High), None).unwrap();
        for seed in 0..20 {
            let random = |lane: u64, a: u64| hash::uniform(seed, 6 * lane + a) as f32;
            let mut cell = [[0i32; 16]; 3];
            let mut place = [[0f32; 16]; 3];
            for lane in 0..16 {
                for a in 0..3 {
                    cell[a][lane] = 2 + (random(lane as u64, a as u64) * 13.0) as i32;
                    place[a][lane] = random(lane as u64, 3 + a as u64);
                }
            }
            fearless_simd::dispatch!(levels()[0].1, simd => {
                let c = cell.map(|c| i32x16::load_array_ref(simd, &c));
                let t = place.map(|t| f32x16::load_array_ref(simd, &t));
                let all = f32x16::splat(simd, 0.0).simd_lt(1.0);
                let key = c[0] + c[1] * 100 + c[2] * 10_000;
                let one = rays.gradient(simd, all, c, t, &mut Cells::default()).map(|g| g.to_array());
                let other = rays.gradient_by_cells(simd, 0xffff, key, c, t, &mut Cells::default()).map(|g| g.to_array());
                for lane in 0..16 {
                    let [one, other] = [one, other].map(|g| Vec3::new(g[0][lane], g[1][lane], g[2][lane]));
                    assert!((one - other).length() < 2e-3, "{one} {other}");
                    assert!((one - slope.as_vec3()).length() < 0.6, "{one}");
                }
            });
        }
    }

    /// A scan whose gradient is 40 HU/mm for each mm from the middle; the middle and the spacing, mm.
    fn bowl() -> (PreparedVolume, DVec3, DVec3) {
        let spacing = DVec3::new(0.7, 0.9, 1.6);
        let grid = Grid::new([20, 18, 16], spacing, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let middle = DVec3::new(9.0, 8.0, 7.0) * spacing;
        let value = |n: usize| {
            let [x, y, z] = [n % 20, n / 20 % 18, n / 360].map(|c| c as f64);
            (20.0 * (DVec3::new(x, y, z) * spacing).distance_squared(middle)).round() as i16
        };
        let data = (0..20 * 18 * 16).map(value).collect();
        (PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default()), middle, spacing)
    }

    /// Whether a ray's layers are shaded one by one or two at once, each adds its own light at its own position: the
    /// gradient turns by more than a right angle between them.
    #[test]
    fn layers_that_wait_are_not_lost() {
        let (volume, middle, spacing) = bowl();
        let occupancy = Occupancy::new(volume.voxels(), volume.transfer());
        let camera = middle + DVec3::new(-1.2, 1.0, 0.8);
        let view = View::new(camera, DVec3::X, DVec3::Z, 40.0, 64, 64).unwrap();
        let rays = Rays::new(&volume, &occupancy, 1.0, &view, &Settings::new(Quality::High), None).unwrap();
        let layers = [(0.5, 1.0, 2.0), (0.2, 2.5, 3.0), (0.1, 4.0, 1.0)];
        fearless_simd::dispatch!(levels()[0].1, simd => {
            let number: [f32; 16] = std::array::from_fn(|n| n as f32);
            let number = f32x16::load_array_ref(simd, &number);
            let ray = rays.directions.lanes(simd, number * 4.0, number * 2.0 + 7.0);
            let mut light = Sums::new(simd);
            let mut cells = Cells::default();
            // Each layer ends in some of the rays earlier than in the others.
            for (share, place, rest) in layers {
                let late = (number - (number * (1.0 / rest) + 0.01).floor() * rest).simd_lt(0.5);
                light.layer.weight += f32x16::splat(simd, share);
                light.layer.place += f32x16::splat(simd, share * place);
                light.layer.value += f32x16::splat(simd, share * 100.0);
                rays.end(simd, &ray, !late, &mut light, &mut cells, Medium::Air);
                rays.end(simd, &ray, late, &mut light, &mut cells, Medium::Air);
            }
            rays.shade(simd, &ray, &mut light, &mut cells, Medium::Air);
            let (bright, tone, depth) = (light.bright.to_array(), light.tone.to_array(), light.depth.to_array());
            for n in 0..16 {
                let direction = DVec3::from_array([0, 1, 2].map(|a| f64::from(ray.world[a][n])));
                let expected = layers.map(|(share, place, _)| {
                    let place = camera + direction * f64::from(place * rays.step()) * spacing.min_element();
                    let dot = (place - middle).normalize().dot(direction).max(0.0);
                    f64::from(share) * (f64::from(AMBIENT) + f64::from(DIFFUSE) * dot)
                });
                let expected: f64 = expected.iter().sum();
                for (found, expected) in [(bright[n], expected), (tone[n], 100.0 * expected), (depth[n], 1.4)] {
                    assert!((f64::from(found) - expected).abs() < 0.02 * expected, "lane {n}: {found} {expected}");
                }
            }
            assert!(!(light.waiting.any() | light.layer.any()).any_true());
        });
    }

    /// Lights other than the headlight use the sum of the layers' normals into the gas, weighted by their shares of the
    /// light. A ray without a layer adds nothing.
    #[test]
    fn normals_are_weighted_like_the_light() {
        let (volume, middle, spacing) = bowl();
        let occupancy = Occupancy::new(volume.voxels(), volume.transfer());
        let camera = middle + DVec3::new(-1.2, 1.0, 0.8);
        let view = View::new(camera, DVec3::X, DVec3::Z, 40.0, 64, 64).unwrap();
        let settings = Settings { light: Light::ENDOSCOPE, ..Settings::new(Quality::High) };
        let rays = Rays::new(&volume, &occupancy, 1.0, &view, &settings, None).unwrap();
        fearless_simd::dispatch!(levels()[0].1, simd => {
            let number: [f32; 16] = std::array::from_fn(|n| n as f32);
            let number = f32x16::load_array_ref(simd, &number);
            let ray = rays.directions.lanes(simd, number * 4.0, number * 2.0 + 7.0);
            let mut light = Sums::new(simd);
            let mut cells = Cells::default();
            // All rays meet the nearer layer, and the first eight of them another one.
            for (share, place, rays_met) in [(0.5f32, 1.0f32, 16.0f32), (0.2, 4.0, 8.0)] {
                let met = number.simd_lt(rays_met);
                let zero = f32x16::splat(simd, 0.0);
                light.layer.weight += met.select(f32x16::splat(simd, share), zero);
                light.layer.place += met.select(f32x16::splat(simd, share * place), zero);
                light.layer.value += met.select(f32x16::splat(simd, share * 100.0), zero);
                rays.end(simd, &ray, met, &mut light, &mut cells, Medium::Air);
                rays.shade(simd, &ray, &mut light, &mut cells, Medium::Air);
            }
            let normal = light.normal.map(|n| n.to_array());
            for n in 0..16 {
                let direction = DVec3::from_array([0, 1, 2].map(|a| f64::from(ray.world[a][n])));
                let inwards = |place: f64| {
                    let place = camera + direction * place * f64::from(rays.step()) * spacing.min_element();
                    (middle - place).normalize()
                };
                let expected = inwards(1.0) * 0.5 + if n < 8 { inwards(4.0) * 0.2 } else { DVec3::ZERO };
                let found = DVec3::from_array(normal.map(|a| f64::from(a[n])));
                assert!(found.distance(expected) < 0.02, "lane {n}: {found}, not {expected}");
            }
        });
    }
}
