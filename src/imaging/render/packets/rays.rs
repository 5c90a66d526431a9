//! What all rays of a picture share, and the result of sixteen of them.
//!
//! [`packet`](super::packet) casts the rays, [`layer`](super::layer) shades what they meet.

use fearless_simd::{Simd, f32x16, mask32x16, prelude::*};
use glam::{DVec3, IVec3, Vec3};

use super::blur;
use super::cells::{Cells, Colours, Source};
use super::directions::{DirectionSource, split};
use super::lanes::{OccupancyLanes, Voxels, interpolate};
use super::occupancy::Occupancy;
use crate::render::camera::{Origins, View};
use crate::render::light::{BORDER, Light, half_mm};
use crate::render::march::Step;
use crate::render::quality::Settings;
use crate::render::regression::{Regression, Weighting, to_world};
use crate::render::sampler::{Sampler, Trilinear};
use crate::render::shaders::Shader;
use crate::render::transfer::FOOT;
use crate::space::PreparedVolume;
use crate::space::surround::{self, LEVELS, OPAQUE};

/// Side of a packet, rays.
pub(crate) const SIDE: usize = 4;
/// A ray runs along the wall where its value changes by less than this over a path of h, the smallest spacing, HU. A
/// ray that goes straight through the wall has one layer: its brightness hardly depends on how the wall turns.
const STEEP: f32 = 200.0;
/// A camera is close to the wall if something of the wall is within about this many voxels of the smallest spacing.
const NEAR: f64 = 2.0;
/// Rounding errors that a leap must allow for, voxels: over the longest leap that a distance allows, and for each voxel
/// from the first one to the ray's position.
const ROUNDING: [f32; 2] = [2e-3, 4e-7];
/// A camera with a larger grown voxel coordinate than this is rendered in double precision.
const FAR: f64 = 1e4;
/// A step that moves less than this along an axis does not move along it, voxels: a million steps add up to a thousandth.
pub(super) const STILL: f32 = 1e-9;
/// Limit for a layer's share of the light times how far back it is, steps. The error of a layer's light scales with its
/// share and grows with its length.
const LAYER_LONG: f32 = 0.1;
/// A layer is shaded when its mean position is this many steps back, whatever its share.
const LAYER_FAR: f32 = 4.0;

/// The state that all rays of a picture share.
pub(crate) struct Rays<'a> {
    pub(super) volume: &'a PreparedVolume,
    pub(super) voxels: Voxels<'a>,
    pub(super) occupancy: &'a Occupancy,
    pub(super) lookup: OccupancyLanes<'a>,
    pub(super) source: Source<'a>,
    pub(super) scalar: Trilinear<'a>,
    /// The camera's position, grown voxel coordinates.
    pub(super) origin: Vec3,
    /// The rays' directions.
    pub(super) directions: DirectionSource,
    /// The most that a step moves along an axis of the volume, voxels.
    pub(super) longest: f32,
    /// How much a leap is shortened to allow for rounding, voxels.
    pub(super) rounding: f32,
    /// Far corner of the grown volume.
    pub(super) border: Vec3,
    pub(super) foot: f32,
    pub(super) lo: f32,
    pub(super) iso: f32,
    pub(super) scale: f32,
    /// A step is h · 2^`power`, which determines how often the opacity is halved.
    pub(super) power: i32,
    pub(super) sensitivity: f32,
    /// A layer is shaded, and another begins, in two cases. Its mean position's distance back, in steps, times its share of the
    /// light exceeds the first number while the ray runs along the wall; or the distance exceeds the second number.
    pub(super) layer: [f32; 2],
    /// The most that a value changes over a step where a ray runs along the wall, HU: see [`STEEP`].
    pub(super) steep: f32,
    /// True if steps are twice as long as requested.
    pub(super) smooth: bool,
    /// Length of the finest waves in the scan, in units of twice the smallest spacing ([`blur::waves`]).
    waves: f32,
    pub(super) limit: f32,
    /// The camera's position, world, mm.
    pub(super) camera: DVec3,
    /// Length of a step, mm.
    pub(super) step_mm: f32,
    /// Effects of the light at the camera, in addition to the headlight.
    pub(super) lighting: Option<PacketLighting<'a>>,
    /// The shader that takes the headlight's place.
    pub(super) shader: Option<&'a dyn Shader>,
}

/// A light other than the headlight, for packets.
pub(crate) struct PacketLighting<'a> {
    pub light: Light,
    /// The rows of the matrix that turns world directions into voxels.
    pub to_voxel: [Vec3; 3],
    /// The distance at which half of the light arrives, mm.
    pub half_mm: f32,
    /// What contact shadows are taken from.
    pub surround: Option<[SurroundLanes<'a>; LEVELS]>,
}

/// A level of a volume's [`Surround`](crate::space::surround::Surround), for packets.
pub(crate) struct SurroundLanes<'a> {
    voxels: Voxels<'a>,
    /// Transform the volume's grown voxel coordinates to those of the level.
    scale: Vec3,
    offset: Vec3,
    /// Distance before the wall at which it is looked up, mm.
    pub(super) ahead_mm: f32,
}

impl<'a> SurroundLanes<'a> {
    /// Wraps `level`; `None` if it has more cells than an `i32` can count.
    fn new(level: &'a surround::Level) -> Option<Self> {
        let &surround::Level { scale, offset, ahead_mm, .. } = level;
        Some(Self { voxels: Voxels::new(&level.means)?, scale, offset, ahead_mm })
    }

    /// Returns the mean opacity (0 to 1) around the places `q` (grown voxel coordinates of the volume) of the lanes in `wanted`.
    #[inline(always)]
    pub(super) fn opacity<S: Simd>(&self, simd: S, q: [f32x16<S>; 3], wanted: mask32x16<S>) -> f32x16<S> {
        let last = self.voxels.last();
        let (scale, offset) = (self.scale, self.offset);
        let x = (q[0] * scale.x + offset.x).max(1.0).min(last[0] as f32 + (1.0 - BORDER));
        let y = (q[1] * scale.y + offset.y).max(1.0).min(last[1] as f32 + (1.0 - BORDER));
        let z = (q[2] * scale.z + offset.z).max(1.0).min(last[2] as f32 + (1.0 - BORDER));
        let (cell, t) = split([x, y, z]);
        interpolate(simd, self.voxels.corners(simd, cell, wanted), t) * (1.0 / OPAQUE)
    }
}

/// The result of sixteen rays.
#[derive(Clone, Copy, Default)]
pub(crate) struct PacketResult {
    /// Brightness, weighted by the light that passed through, 0 to 1.
    pub bright: [f32; 16],
    /// Brightness × HU above the palette's first.
    pub tone: [f32; 16],
    /// Share of light that would still come from beyond; NaN where the camera shows nothing.
    pub through: [f32; 16],
    /// Mean position of the visible matter, steps from the camera, weighted like the light (not divided by the weight).
    pub depth: [f32; 16],
    /// Number of layers that ended before another began.
    pub layers: [f32; 16],
    /// For the first of several layers: its share of the light, and that share times its position; 0 if there is only one.
    pub front: [[f32; 16]; 2],
    /// Number of samples taken.
    pub samples: u32,
}

/// Returns the first halves of two packets, and the second halves.
#[inline(always)]
pub(super) fn paired([a, b]: [&[f32; 16]; 2]) -> [[f32; 16]; 2] {
    [0, 8].map(|from| std::array::from_fn(|n| if n < 8 { a[from + n] } else { b[from + n - 8] }))
}

impl PacketResult {
    /// Returns the rays in the first halves of two packets, and those in the second halves. The first counts all samples.
    #[inline(always)]
    pub(super) fn paired([a, b]: [&Self; 2]) -> [Self; 2] {
        let mut out = [Self::default(); 2];
        let mut put = |of: fn(&mut Self) -> &mut [f32; 16], a: &[f32; 16], b: &[f32; 16]| {
            let [first, second] = paired([a, b]);
            (*of(&mut out[0]), *of(&mut out[1])) = (first, second);
        };
        put(|p| &mut p.bright, &a.bright, &b.bright);
        put(|p| &mut p.tone, &a.tone, &b.tone);
        put(|p| &mut p.through, &a.through, &b.through);
        put(|p| &mut p.depth, &a.depth, &b.depth);
        put(|p| &mut p.layers, &a.layers, &b.layers);
        put(|p| &mut p.front[0], &a.front[0], &b.front[0]);
        put(|p| &mut p.front[1], &a.front[1], &b.front[1]);
        out[0].samples = a.samples + b.samples;
        out
    }
}

/// True if something of the wall is within about [`NEAR`] of the camera, which is in `cell`.
///
/// The voxels themselves are read, so that pictures do not depend on what is known to be empty.
fn is_near(volume: &PreparedVolume, cell: IVec3) -> bool {
    let (voxels, foot) = (volume.voxels(), volume.transfer().lo() + FOOT);
    let grid = voxels.grid();
    let reach = (NEAR * grid.min_spacing() / grid.spacing()).ceil().as_ivec3();
    // Cell g is between the voxels g − 1 and g.
    let (first, last) = (cell - 1 - reach, cell + reach);
    let range = |a: usize| first[a].max(0)..=last[a].min(grid.dims()[a] as i32 - 1);
    range(2).any(|z| {
        range(1)
            .any(|y| range(0).any(|x| f32::from(voxels.data()[grid.index(x as usize, y as usize, z as usize)]) > foot))
    })
}

/// Returns the limits for how far back, in steps, a layer's mean position may be before another layer begins: one for
/// the distance times the layer's share of the light, and one for the distance alone.
///
/// Steps are 2^`power` times as long as those of a flight; over `waves` of these the wall's gradient turns little.
/// Shorter steps mean that less error is wanted, too: layers are then a quarter of a flight's step.
fn layer_steps(waves: f32, power: i32) -> [f32; 2] {
    let step = 2f32.powi(power);
    if power < 0 {
        let fine = (0.25 / step).min(1.0);
        [LAYER_LONG * fine, LAYER_FAR * fine]
    } else {
        [LAYER_LONG * (waves / step).max(1.0), LAYER_FAR]
    }
}

impl<'a> Rays<'a> {
    /// Prepares the rays of `view` in a scan with the given [`waves`](super::blur::waves).
    ///
    /// Returns `None` if this caster cannot render the view. It needs at least two voxels along each axis, no more voxels and
    /// pieces of their bits than an `i32` can count, a camera within ten thousand voxels, and rays that all start at the camera.
    pub(crate) fn new(
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
        // Half as many samples: values between them are known well enough, except where rays run along a close wall.
        // Callers that request shorter steps already have them.
        let near = settings.step_power >= -1 && is_near(volume, origin.floor().as_ivec3());
        let power = settings.step_power + 1 - i32::from(near);
        let step = Step::new(volume, power + i32::from(smooth));
        let per_step = [view.forward(), view.right(), view.up()]
            .map(|d| (grid.to_voxel().transform_vector3(d) * step.mm).as_vec3());
        let wall = volume.transfer();
        let border = Vec3::from_array(grid.dims().map(|n| (n + 1) as f32));
        // All directions are of unit length in the camera's orthonormal frame, so this also holds where the volume's
        // axes are not at right angles.
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
            layer: layer_steps(if smooth { waves * 0.5 } else { waves }, power),
            steep: STEEP * 2f32.powi(step.power),
            smooth,
            waves,
            limit: (1 << 22) as f32,
            camera: view.position(),
            step_mm: step.mm as f32,
            lighting: (settings.light != Light::HEADLIGHT).then(|| PacketLighting {
                light: settings.light,
                to_voxel: [0, 1, 2].map(|n| grid.to_voxel().matrix3.row(n).as_vec3()),
                half_mm: half_mm(volume, view.position()),
                surround: settings.light.contact.then(|| volume.surround()).flatten().and_then(|s| {
                    let [near, far] = s.levels();
                    Some([SurroundLanes::new(near)?, SurroundLanes::new(far)?])
                }),
            }),
            shader,
        })
    }

    /// Returns the colours of the most recent packet if a custom shader has set them.
    #[inline(always)]
    pub(crate) fn colours<'c>(&self, cells: &'c Cells) -> Option<&'c Colours> {
        self.shader.map(|_| &cells.colours)
    }

    /// Returns by how much unit directions of neighbouring pixels differ at most; `None` if unknown.
    pub(crate) fn pixel_turn(&self) -> Option<f32> {
        self.directions.pixel_turn()
    }

    /// Returns the length of a step, voxels of the smallest spacing.
    pub(crate) fn step(&self) -> f32 {
        2f32.powi(self.power)
    }

    /// Returns the length of a step in units of half the finest waves: what rays between others may miss is measured by these.
    pub(crate) fn step_in_waves(&self) -> f32 {
        self.step() / self.waves
    }

    /// Returns the trilinear HU at the positions `q` of the lanes in `wanted`; other lanes are arbitrary.
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

    /// Returns values at and beyond the volume's border, one by one.
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
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Longer steps allow no more than the scan's smoothness does, shorter ones a quarter of a flight's step.
    #[test]
    fn layers_are_as_deep_as_the_steps_allow() {
        for (waves, power, long, far) in [
            (1.0, 0, LAYER_LONG, LAYER_FAR),
            (4.0, 0, 4.0 * LAYER_LONG, LAYER_FAR),
            (4.0, 1, 2.0 * LAYER_LONG, LAYER_FAR),
            (1.0, 1, LAYER_LONG, LAYER_FAR),
            (1.0, -1, 0.5 * LAYER_LONG, 0.5 * LAYER_FAR),
            (1.0, -2, LAYER_LONG, LAYER_FAR),
            (1.0, -3, LAYER_LONG, LAYER_FAR),
        ] {
            assert_eq!(layer_steps(waves, power), [long, far], "{waves} {power}");
        }
    }
}
