//! Light at the camera: the paper's headlight, and the additions of an endoscope.
//!
//! The brightness of a point scales the wall's colour. With n·r the cosine between normal and ray and d the distance
//! (mm):
//!
//! * headlight (the paper's simplified Phong model): `b = 0.1 + 0.9 (n·r)`;
//! * falloff: `b ← 1.2 b / (1 + (d/55)²)`, the inverse square of a light of finite size, exposed for near surfaces;
//! * gloss: `b ← b + 0.4 (n·r)⁶⁴ / (1 + (d/55)²)`, the Blinn-Phong highlight, whose half vector is the ray since light
//!   and eye are in one place. Colours saturate towards white there;
//! * contact: `b ← b (1 − 0.5 o)`, with o the opacity (0 to 1) 3 mm before the wall along its normal. This is ambient
//!   occlusion by one sample. It darkens the feet of folds, clefts, and the floor beneath an object. Packets of rays take
//!   the sample once per ray, at the mean place and normal of everything that the ray meets.

use glam::{DMat3, Vec3};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};

use super::shaders::headlight::{AMBIENT, DIFFUSE};
use crate::space::PreparedVolume;

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
/// The distance at which half of the light arrives, mm.
pub(crate) const HALF_MM: f32 = 55.0;
/// The brightness of the highlight.
pub(crate) const GLOSS: f32 = 0.4;
/// The highlight's exponent is 2 to this power.
pub(crate) const GLOSS_DOUBLINGS: u32 = 6;
/// Distance before the wall at which another wall is detected, mm.
pub(crate) const CONTACT_MM: f32 = 3.0;
/// The share by which a near wall darkens the surface.
pub(crate) const CONTACT: f32 = 0.5;

/// Returns the share of the camera's light that arrives at `distance_mm`.
#[inline(always)]
fn arriving(distance_mm: f32) -> f32 {
    let d = distance_mm * (1.0 / HALF_MM);
    1.0 / (1.0 + d * d)
}

/// A [`Light`] with the volume data that it needs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lighting {
    light: Light,
    /// Transforms world to voxel directions.
    to_voxel: DMat3,
    lo: f32,
    scale: f32,
}

impl Lighting {
    /// Prepares `light` for `volume`.
    pub(crate) fn new(light: Light, volume: &PreparedVolume) -> Self {
        let wall = volume.transfer();
        let to_voxel = volume.voxels().grid().to_voxel().matrix3;
        Self { light, to_voxel, lo: wall.lo(), scale: 1.0 / (wall.hi() - wall.lo()) }
    }

    /// Returns the brightness of a point `distance_mm` from the camera whose normal and ray have the cosine `facing`.
    ///
    /// `gradient` (world) is 0 in a homogeneous region. `value` returns the HU at an offset from the point, given in
    /// voxels.
    #[inline(always)]
    pub(crate) fn brightness(&self, facing: f32, distance_mm: f32, gradient: Vec3, value: impl Fn(Vec3) -> f32) -> f32 {
        let Light { falloff, gloss, contact } = self.light;
        let mut bright = AMBIENT + DIFFUSE * facing;
        let arriving = if falloff { arriving(distance_mm) } else { 1.0 };
        if falloff {
            bright *= EXPOSURE * arriving;
        }
        if gloss {
            let mut shine = facing;
            for _ in 0..GLOSS_DOUBLINGS {
                shine *= shine;
            }
            bright += GLOSS * arriving * shine;
        }
        let square = gradient.length_squared();
        if contact && square > 1e-6 {
            let before = self.to_voxel.as_mat3() * (gradient / -square.sqrt());
            bright *= 1.0 - CONTACT * ((value(before * CONTACT_MM) - self.lo) * self.scale).clamp(0.0, 1.0);
        }
        bright
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DVec3;

    use super::*;
    use crate::phantom::{Phantom, PhantomSettings, Size};
    use crate::progress::Progress;
    use crate::render::{Frame, Preset, Quality, Reuse, Settings, View, presets, psnr, renderer};
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

    /// The whole ball is seen head on, at the same distance, with nothing near in front of it.
    #[test]
    fn a_ball_has_the_formulas_brightness() {
        let volume = ball();
        let view = View::new(DVec3::ZERO, DVec3::X, DVec3::Z, 60.0, 64, 64).unwrap();
        let arriving = arriving(19.7);
        let parts = Light::HEADLIGHT;
        for (light, expected) in [
            (Light { falloff: true, ..parts }, EXPOSURE * arriving),
            (Light { gloss: true, ..parts }, 1.0 + GLOSS),
            (Light { contact: true, ..parts }, 1.0),
            (Light::ENDOSCOPE, (EXPOSURE + GLOSS) * arriving),
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
        let phantom = Phantom::new(&PhantomSettings { size: Size::Small, ..PhantomSettings::default() });
        let volume = phantom.voxelise(&phantom.grid(), &Progress::new()).unwrap();
        let volume = PreparedVolume::new(Arc::new(volume), TransferFunction::default());
        let axis = phantom.axis();
        let mut worst = f64::INFINITY;
        for share in [0.15, 0.4, 0.62, 0.9] {
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
