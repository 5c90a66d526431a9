//! Light at the camera: the paper's headlight, and the additions of an endoscope.
//!
//! The brightness of a point scales the wall's colour. With n·r the cosine between normal and ray and d the distance (mm):
//!
//! * headlight (the paper's simplified Phong model): `b = 0.1 + 0.9 (n·r)`;
//! * falloff: `b ← 1.2 b / (1 + (d/h)²)`, the inverse square of a light of finite size, exposed for near surfaces. An
//!   endoscope's exposure follows the lumen, and so does `h`, at which half of the light arrives: it is
//!   [`HALF`] times the lumen's width around the camera ([`width`]);
//! * gloss: `b ← b + 0.3 (n·r)¹²⁸ / (1 + (d/h)²)`, the Blinn-Phong highlight, whose half vector is the ray since light
//!   and eye are in one place. Colours saturate towards white there;
//! * contact: `b ← b max(0.3, 1 − Σ sₖ max(0, oₖ − f))`, with oₖ the mean opacity (0 to 1) of cells ([`Surround`]) around the
//!   place [`AHEAD`](crate::space::surround::AHEAD) cells before the wall along its normal, and f that of a flat wall. This
//!   is ambient occlusion by cones of which the axis is sampled (Crassin et al., *Interactive indirect illumination using
//!   voxel cone tracing*, 2011). It darkens the feet of folds, clefts, and the floor beneath an object, softly and from a
//!   distance; a flat wall keeps its brightness. Packets of rays take the samples once per ray, at the mean place and
//!   normal of everything that the ray meets.

use glam::{DMat3, DVec3, Vec3};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};

use super::sampler::{Sampler, Trilinear, trilinear};
use super::shaders::headlight::{AMBIENT, DIFFUSE};
use crate::math::sphere::directions;
use crate::space::PreparedVolume;
use crate::space::surround::{LEVELS, OPAQUE, Surround};

/// The effects of the light at the camera. With none it is the paper's headlight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Light {
    /// Distant surfaces are darker.
    pub falloff: bool,
    /// The wet wall is glossy where it faces the camera.
    pub gloss: bool,
    /// Surfaces are darker where another wall is near.
    pub contact: bool,
}

/// Names of the effects in scene files.
const PARTS: [&str; 3] = ["falloff", "gloss", "contact"];

impl Light {
    /// The paper's light: brightness is linear in the cosine between ray and normal.
    pub const HEADLIGHT: Self = Self { falloff: false, gloss: false, contact: false };
    /// An endoscope's light. It makes near and far, fold and floor easy to distinguish.
    pub const ENDOSCOPE: Self = Self { falloff: true, gloss: true, contact: true };

    /// Prepares a volume for this light, so that its first picture need not wait for that.
    #[doc(hidden)]
    pub fn prepare(self, volume: &PreparedVolume) {
        if self.contact {
            volume.surround();
        }
    }

    /// Returns the light's name for messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::HEADLIGHT => "headlight",
            Self::ENDOSCOPE => "endoscope",
            _ => "parts of the endoscope's",
        }
    }
}

impl<'de> Deserialize<'de> for Light {
    /// Reads `"headlight"`, `"endoscope"`, or a list of effects to add to the headlight.
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum Written {
            Name(String),
            Parts(Vec<String>),
        }
        let expected = "give \"headlight\", \"endoscope\", or a list of \"falloff\", \"gloss\" and \"contact\"";
        match Written::deserialize(from).map_err(|_| D::Error::custom(expected))? {
            Written::Name(name) if name == "headlight" => Ok(Self::HEADLIGHT),
            Written::Name(name) if name == "endoscope" => Ok(Self::ENDOSCOPE),
            Written::Name(name) => Err(D::Error::custom(format!("there is no light {name:?}; {expected}"))),
            Written::Parts(parts) => match parts.iter().find(|p| !PARTS.contains(&p.as_str())) {
                Some(p) => Err(D::Error::custom(format!("a light has no part {p:?}; {expected}"))),
                None => {
                    let has = |part: usize| parts.iter().any(|p| p == PARTS[part]);
                    Ok(Self { falloff: has(0), gloss: has(1), contact: has(2) })
                }
            },
        }
    }
}

/// Brightness near the camera with falloff.
pub(crate) const EXPOSURE: f32 = 1.2;
/// The distance at which half of the light arrives, in widths of the lumen.
const HALF: f32 = 3.5;
/// The range of that distance, mm.
const HALF_MM: [f32; 2] = [45.0, 120.0];
/// The brightness of the highlight.
pub(crate) const GLOSS: f32 = 0.3;
/// The highlight's exponent is 2 to this power.
pub(crate) const GLOSS_DOUBLINGS: u32 = 7;
/// Cosines below this shine as this one does, invisibly (10⁻²⁸). Their powers would be subnormal numbers, which take processors
/// a hundred times as long.
pub(crate) const GLOSS_FROM: f32 = 0.6;
/// The shares by which opaque surroundings there darken the surface.
pub(crate) const CONTACT: [f32; LEVELS] = [1.0, 0.7];
/// The most that a flat wall itself contributes there.
pub(crate) const FLAT: f32 = 0.01;
/// The least brightness that contact leaves.
pub(crate) const CONTACT_LEAST: f32 = 0.3;

/// Places beyond the last cell's middle are moved back by this, in cells, so that there is a cell after them.
pub(crate) const BORDER: f32 = 1e-3;

/// Returns the share of the camera's light that arrives at `distance_mm`, with half of it at `half_mm`.
#[inline(always)]
fn arriving(distance_mm: f32, half_mm: f32) -> f32 {
    let d = distance_mm / half_mm;
    1.0 / (1.0 + d * d)
}

/// Distance between two looks for the wall, mm.
const LOOK_MM: f32 = 2.0;
/// Number of looks in a direction.
const LOOKS: usize = 30;
/// Number of directions.
const DIRECTIONS: usize = 64;

/// Returns the lumen's width around a camera at `camera` (world, mm): the mean distance to the wall, mm, over the middle
/// half of the directions, which leaves out those along the lumen and those into a near fold. It is 1.2 radii in a tube,
/// one radius in a ball, 0 inside tissue, and at most 60 mm.
///
/// It hardly changes under small moves of the camera, and brightness with it.
fn width(volume: &PreparedVolume, camera: DVec3) -> f32 {
    let (sampler, grid) = (Trilinear::new(volume), volume.voxels().grid());
    let origin = grid.voxel(camera).as_vec3() + 1.0;
    let border = Vec3::from_array(grid.dims().map(|n| (n + 1) as f32));
    let (to_voxel, iso) = (grid.to_voxel().matrix3.as_mat3(), volume.transfer().iso() as f32);
    let value = |q: Vec3| sampler.value(q.clamp(Vec3::ZERO, border));
    if !origin.is_finite() {
        return 0.0;
    }
    let first = value(origin);
    let mut distances = [0.0; DIRECTIONS];
    for (distance, direction) in distances.iter_mut().zip(directions(DIRECTIONS)) {
        let step = to_voxel * (direction.as_vec3() * LOOK_MM);
        let mut last = first;
        let looks = if first < iso { LOOKS } else { 0 };
        *distance = looks as f32 * LOOK_MM;
        for look in 1..=looks {
            let next = value(origin + step * look as f32);
            if next >= iso {
                *distance = ((look - 1) as f32 + (iso - last) / (next - last)) * LOOK_MM;
                break;
            }
            last = next;
        }
    }
    distances.sort_unstable_by(f32::total_cmp);
    let middle = &distances[DIRECTIONS / 4..DIRECTIONS * 3 / 4];
    middle.iter().sum::<f32>() / middle.len() as f32
}

/// Returns the distance at which half of the light of a camera at `camera` (world, mm) arrives, mm.
pub(crate) fn half_mm(volume: &PreparedVolume, camera: DVec3) -> f32 {
    (HALF * width(volume, camera)).clamp(HALF_MM[0], HALF_MM[1])
}

/// A [`Light`] with the volume data that it needs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lighting<'a> {
    light: Light,
    /// Transforms world to voxel directions.
    to_voxel: DMat3,
    /// What contact shadows are taken from.
    surround: Option<&'a Surround>,
    /// The distance at which half of the light arrives, mm.
    half_mm: f32,
}

impl<'a> Lighting<'a> {
    /// Prepares `light` at `camera` (world, mm) for `volume`.
    pub(crate) fn new(light: Light, volume: &'a PreparedVolume, camera: DVec3) -> Self {
        let surround = if light.contact { volume.surround() } else { None };
        let to_voxel = volume.voxels().grid().to_voxel().matrix3;
        Self { light, to_voxel, surround, half_mm: half_mm(volume, camera) }
    }

    /// Returns the brightness of a point `distance_mm` from the camera whose normal and ray have the cosine `facing`.
    ///
    /// The point `q` is given in grown voxel coordinates. `gradient` (world) is 0 in a homogeneous region.
    #[inline(always)]
    pub(crate) fn brightness(&self, facing: f32, distance_mm: f32, gradient: Vec3, q: Vec3) -> f32 {
        let Light { falloff, gloss, .. } = self.light;
        let mut bright = AMBIENT + DIFFUSE * facing;
        let arriving = if falloff { arriving(distance_mm, self.half_mm) } else { 1.0 };
        if falloff {
            bright *= EXPOSURE * arriving;
        }
        if gloss {
            let mut shine = facing.max(GLOSS_FROM);
            for _ in 0..GLOSS_DOUBLINGS {
                shine *= shine;
            }
            bright += GLOSS * arriving * shine;
        }
        let square = gradient.length_squared();
        if let Some(surround) = self.surround.filter(|_| square > 1e-6) {
            let before = self.to_voxel.as_mat3() * (gradient / -square.sqrt());
            let mut open = 1.0;
            for (level, share) in surround.levels().iter().zip(CONTACT) {
                let last = Vec3::from_array(level.means.grid().dims().map(|n| n as f32)) - BORDER;
                let q = (level.scale * (q + before * level.ahead_mm) + level.offset).clamp(Vec3::ONE, last);
                open -= share * (trilinear(&level.means, q) * (1.0 / OPAQUE) - FLAT).max(0.0);
            }
            bright *= open.max(CONTACT_LEAST);
        }
        bright
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::checks::cases;
    use crate::phantom::PhantomSettings;
    use crate::render::{Frame, Preset, Quality, Reuse, Settings, View, presets, psnr, renderer};
    use crate::shared::shared;
    use crate::space::TransferFunction;
    use crate::volume::{Grid, Volume};

    #[derive(Deserialize)]
    struct File {
        light: Light,
    }

    #[test]
    fn a_light_is_a_name_or_parts() {
        let read = |text: &str| toml::from_str::<File>(text).map(|f| f.light);
        assert_eq!(read("light = \"endoscope\""), Ok(Light::ENDOSCOPE));
        assert_eq!(read("light = \"headlight\""), Ok(Light::HEADLIGHT));
        assert_eq!(read("light = []"), Ok(Light::HEADLIGHT));
        assert_eq!(read("light = [\"gloss\", \"falloff\"]"), Ok(Light { contact: false, ..Light::ENDOSCOPE }));
        for bad in ["light = \"sun\"", "light = [\"sun\"]", "light = 3"] {
            assert!(read(bad).unwrap_err().to_string().contains("\"endoscope\""), "{bad}");
        }
    }

    /// A ball of gas of radius 20 mm around the camera, blurred like a scan.
    fn ball() -> PreparedVolume {
        let grid = Grid::new([64; 3], DVec3::ONE, DVec3::splat(-31.5), DMat3::IDENTITY).unwrap();
        let value = |n: usize| {
            let at = DVec3::from_array([n % 64, n / 64 % 64, n / 4096].map(|c| c as f64 - 31.5));
            (1000.0 / (1.0 + (-2.0 * (at.length() - 20.0)).exp()) - 1000.0) as i16
        };
        let volume = Volume::new(grid.clone(), (0..grid.len()).map(value).collect());
        PreparedVolume::new(Arc::new(volume), TransferFunction::default())
    }

    /// A tube of gas of radius 15 mm along x, with a fold of 8 mm across it at x = 0, blurred like a scan.
    fn tube_with_fold() -> PreparedVolume {
        let grid = Grid::new([100, 50, 50], DVec3::ONE, DVec3::new(-50.0, -24.5, -24.5), DMat3::IDENTITY).unwrap();
        let value = |n: usize| {
            let at = grid.world(DVec3::from_array([n % 100, n / 100 % 50, n / 5000].map(|c| c as f64)));
            let radius = 15.0 - 8.0 * (1.0 - (at.x.abs() / 4.0).powi(4)).max(0.0);
            (1000.0 / (1.0 + (-2.0 * (at.y.hypot(at.z) - radius)).exp()) - 1000.0) as i16
        };
        let volume = Volume::new(grid.clone(), (0..grid.len()).map(value).collect());
        PreparedVolume::new(Arc::new(volume), TransferFunction::default())
    }

    /// The shadow of a fold begins more than 3 mm before its foot and grows towards it; the wall between folds keeps its brightness.
    #[test]
    fn the_foot_of_a_fold_is_in_a_wide_soft_shadow() {
        let volume = tube_with_fold();
        let contact = Lighting::new(Light { contact: true, ..Light::HEADLIGHT }, &volume, DVec3::ZERO);
        let plain = Lighting::new(Light::HEADLIGHT, &volume, DVec3::ZERO);
        let grid = volume.voxels().grid();
        let share = |x: f64| {
            let q = grid.voxel(DVec3::new(x, 15.0, 0.0)).as_vec3() + 1.0;
            contact.brightness(1.0, 10.0, Vec3::Y, q) / plain.brightness(1.0, 10.0, Vec3::Y, q)
        };
        let all = [30.0, 10.0, 7.0, 5.5, 4.5].map(share);
        assert!(all[0] > 0.93, "between folds {all:?}");
        assert!(all.windows(2).all(|w| w[1] < w[0] + 0.01), "{all:?}");
        assert!(all[2] < all[0] - 0.02, "wider than the 3 mm of one sample: {all:?}");
        assert!((CONTACT_LEAST..0.8).contains(&all[4]), "at the foot: {all:?}");
    }

    /// A flat wall keeps its brightness wherever it lies among the cells: shadows have no texture of the cells' size.
    #[test]
    fn a_flat_wall_has_no_shadow_and_no_texture() {
        for spacing in [0.68, 1.0, 1.5, 2.2] {
            let grid = Grid::new([40; 3], DVec3::splat(spacing), DVec3::ZERO, DMat3::IDENTITY).unwrap();
            let middle = 20.0 * spacing;
            for n in 0..16 {
                let wall = middle + 0.4 * f64::from(n);
                let value = |n: usize| {
                    let z = (n / 1600) as f64 * spacing;
                    (1000.0 / (1.0 + (-2.0 * (z - wall)).exp()) - 1000.0) as i16
                };
                let volume = Volume::new(grid.clone(), (0..grid.len()).map(value).collect());
                let volume = PreparedVolume::new(Arc::new(volume), TransferFunction::default());
                let camera = DVec3::new(middle, middle, wall - 10.0);
                let contact = Lighting::new(Light { contact: true, ..Light::HEADLIGHT }, &volume, camera);
                let q = grid.voxel(DVec3::new(middle, middle, wall)).as_vec3() + 1.0;
                let share = contact.brightness(1.0, 10.0, Vec3::Z, q);
                assert!((0.97..=1.0).contains(&share), "spacing {spacing}, wall at {wall}: {share}");
            }
        }
    }

    /// The lumen's width is that of a ball and of a tube, nothing inside tissue, bounded in the open, and steady under small
    /// moves of the camera.
    #[test]
    fn light_reaches_as_far_as_the_lumen_is_wide() {
        let (ball, tube) = (ball(), tube_with_fold());
        let at = |x: f64| width(&tube, DVec3::new(x, 0.0, 0.0));
        assert!((width(&ball, DVec3::ZERO) - 20.0).abs() < 1.0, "{}", width(&ball, DVec3::ZERO));
        assert!((at(25.0) - 1.19 * 15.0).abs() < 1.0, "{}", at(25.0));
        assert_eq!((width(&ball, DVec3::splat(25.0)), half_mm(&ball, DVec3::splat(25.0))), (0.0, HALF_MM[0]));
        let empty = Grid::new([4; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let empty = Volume::new(empty, vec![-1000; 64]);
        let empty = PreparedVolume::new(Arc::new(empty), TransferFunction::default());
        for bad in [DVec3::splat(1.5), DVec3::splat(1e30), DVec3::splat(f64::NAN)] {
            assert!((0.0..=60.0).contains(&width(&empty, bad)), "{bad}");
        }
        for n in 0..400 {
            let x = -20.0 + 0.1 * f64::from(n);
            let change =
                (half_mm(&tube, DVec3::new(x + 0.1, 0.0, 0.0)) / half_mm(&tube, DVec3::new(x, 0.0, 0.0)) - 1.0).abs();
            assert!(change < 0.05, "at {x}: {change}");
        }
    }

    /// The whole ball is seen head on, at the same distance, with nothing near in front of it.
    #[test]
    fn a_ball_has_the_formulas_brightness() {
        let volume = ball();
        let view = View::new(DVec3::ZERO, DVec3::X, DVec3::Z, 60.0, 64, 64).unwrap();
        let arriving = arriving(19.7, HALF * 20.0);
        let parts = Light::HEADLIGHT;
        // A ball is hollow: its own wall stands close on all sides.
        let contact = Lighting::new(Light { contact: true, ..parts }, &volume, DVec3::ZERO);
        let q = volume.voxels().grid().voxel(DVec3::X * 19.7).as_vec3() + 1.0;
        let open = contact.brightness(1.0, 19.7, Vec3::X, q);
        assert!((0.9..=1.0).contains(&open), "{open}");
        for (light, expected) in [
            (Light { falloff: true, ..parts }, EXPOSURE * arriving),
            (Light { gloss: true, ..parts }, 1.0 + GLOSS),
            (Light { contact: true, ..parts }, open),
            (Light::ENDOSCOPE, (EXPOSURE + GLOSS) * arriving * open),
        ] {
            for quality in [Quality::Reference, Quality::High] {
                let render = |light| {
                    let settings = Settings { light, ..Settings::new(quality) };
                    let mut frame = Frame::default();
                    renderer(&volume, settings, Preset::default(), Reuse::Never).render(&view, &mut frame);
                    frame.pixels()[32 * 64 + 32].map(f32::from)
                };
                let (plain, lit) = (render(parts), render(light));
                for (plain, lit) in plain.into_iter().zip(lit) {
                    let expected = (plain * expected).min(255.0);
                    assert!((lit - expected).abs() < 6.0, "{light:?} {quality:?}: {lit} of {expected}");
                }
            }
        }
    }

    /// Packets of rays produce the same pictures as single rays, and every preset supports the light.
    #[test]
    fn every_renderer_has_the_same_light() {
        let (phantom, volume) = shared(&PhantomSettings::embedded(1));
        let volume = PreparedVolume::new(Arc::new(volume), TransferFunction::default());
        let axis = phantom.axis();
        let mut worst = f64::INFINITY;
        for share in [0.4, 0.15, 0.62, 0.9].into_iter().take(cases(4, 1)) {
            let lumen = axis.frame(axis.length() * share);
            let view = View::new(lumen.at, lumen.tangent, lumen.normal, 90.0, 150, 150).unwrap();
            let render = |quality, preset, light| {
                let mut frame = Frame::default();
                let settings = Settings { light, ..Settings::new(quality) };
                renderer(&volume, settings, preset, Reuse::Never).render(&view, &mut frame);
                frame
            };
            let reference = render(Quality::Reference, Preset::default(), Light::ENDOSCOPE);
            for preset in presets::BUILT_IN {
                let lit = render(Quality::High, preset, Light::ENDOSCOPE);
                let plain = render(Quality::High, preset, Light::HEADLIGHT);
                let (db, other) = (psnr(&lit, &reference), psnr(&plain, &reference));
                println!("{} at {share}: {db:.1} dB; another light {other:.1} dB", preset.name);
                assert!(other < 25.0, "the light shows");
                // The volume of 7 + 1 bits differs much from the reference in any light.
                worst = worst.min(if preset.name == "colvis" { f64::INFINITY } else { db });
            }
        }
        assert!(worst > 40.0, "{worst} dB");
    }

    #[test]
    fn a_light_is_named_as_it_is_written() {
        for light in [Light::HEADLIGHT, Light::ENDOSCOPE] {
            let text = format!("light = {:?}", light.name());
            assert_eq!(toml::from_str::<File>(&text).map(|f| f.light), Ok(light), "{text}");
        }
        let parts = Light { gloss: false, ..Light::ENDOSCOPE };
        assert_eq!(parts.name(), "parts of the endoscope's");
    }
}
