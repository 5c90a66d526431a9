//! How good a picture is asked for.

use super::choices::Choices;
use super::light::Light;
use super::options::Options;
use super::shaders::ShaderModel;

/// The level of detail.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Quality {
    /// Trilinear values and interpolated regressions, empty space skipped.
    #[default]
    High,
    /// Empty space skipped, a ray for nine pixels where packets of rays render, else the nearest voxel for everything; a scene
    /// may choose ([`LowDetail`](super::LowDetail)).
    Low,
    /// As high, by brute force: fine steps, nothing skipped. What everything else is measured against.
    Reference,
}

/// What opacity is looked up by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Classification {
    /// The sampled HU: the trilinearly interpolated value.
    #[default]
    Value,
    /// The filtered density D of the regression, as the paper has it.
    Filtered,
}

/// Settings of the ray caster. The wall's ramp is part of the [`PreparedVolume`](super::PreparedVolume), whose flags depend on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// The level of detail.
    pub quality: Quality,
    /// What opacity is looked up by.
    pub classification: Classification,
    /// The camera's sensitivity: a ray ends when less than this share of light (1 − A) comes from beyond.
    pub sensitivity: f32,
    /// Δs = h · 2^`step_power`, h the smallest spacing.
    pub step_power: i32,
    /// Rays for each pixel, at least 1.
    pub samples_per_pixel: u32,
    /// Whether detail follows the need: coarser while the camera moves fast or pictures cost too much, and up to the
    /// reference at rest ([`adaptive`](super::adaptive)).
    pub adaptive: bool,
    /// What is chosen in the place of the preset's own.
    pub choices: Choices,
    /// What the light at the camera does, where the shader is the headlight.
    pub light: Light,
    /// What the wall looks like.
    pub shader: ShaderModel,
    /// The preset's own settings: the scene file's table of its name.
    pub options: Options,
}

impl Settings {
    /// The settings that a quality stands for.
    pub fn new(quality: Quality) -> Self {
        let (sensitivity, step_power) = match quality {
            Quality::High => (1.0 / 512.0, -1),
            Quality::Low => (1.0 / 128.0, 0),
            Quality::Reference => (1e-5, -3),
        };
        let classification = Classification::Value;
        Self {
            quality,
            classification,
            sensitivity,
            step_power,
            samples_per_pixel: 1,
            adaptive: false,
            choices: Choices::default(),
            light: Light::default(),
            shader: ShaderModel::default(),
            options: Options::NONE,
        }
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self::new(Quality::High)
    }
}
