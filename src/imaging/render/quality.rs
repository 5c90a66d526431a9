//! Quality levels and settings of pictures.

use super::choices::Choices;
use super::light::Light;
use super::options::Options;
use super::shaders::ShaderModel;

/// The level of detail.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Quality {
    /// Trilinear values and interpolated regressions, with empty space skipped.
    #[default]
    High,
    /// Empty space skipped, with one ray for nine pixels if packets of rays render, otherwise the nearest voxel for
    /// everything. A scene may choose ([`LowDetail`](super::LowDetail)).
    Low,
    /// As high, by brute force: fine steps, nothing skipped. Everything else is measured against it.
    Reference,
}

impl Quality {
    /// Returns the name of the level.
    pub fn name(self) -> &'static str {
        match self {
            Self::High => "high",
            Self::Low => "low",
            Self::Reference => "reference",
        }
    }
}

/// The value that opacity is looked up by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Classification {
    /// The sampled HU: the trilinearly interpolated value.
    #[default]
    Value,
    /// The filtered density D of the regression, as in the paper.
    Filtered,
}

/// Settings of the ray caster.
///
/// The wall's ramp is part of the [`PreparedVolume`](super::PreparedVolume), whose flags depend on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// The level of detail.
    pub quality: Quality,
    /// The value that opacity is looked up by.
    pub classification: Classification,
    /// The camera's sensitivity: a ray ends when less than this share of light (1 − A) can still arrive from beyond.
    pub sensitivity: f32,
    /// The step length exponent: Δs = h · 2^`step_power`, h the smallest spacing.
    pub step_power: i32,
    /// Rays per pixel, at least 1.
    pub samples_per_pixel: u32,
    /// True if the detail adapts: coarser while the camera moves fast or pictures cost too much, and up to the reference at rest.
    pub adaptive: bool,
    /// Choices that replace the preset's defaults.
    pub choices: Choices,
    /// The effects of the light at the camera, if the shader is the headlight.
    pub light: Light,
    /// The shader of the wall.
    pub shader: ShaderModel,
    /// The preset's settings: the table of its name in the scene file.
    pub options: Options,
}

impl Settings {
    /// Returns the settings of a quality.
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
