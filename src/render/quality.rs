//! How good a picture is asked for.

/// The level of detail.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Quality {
    /// Trilinear values and interpolated regressions, empty space skipped.
    #[default]
    High,
    /// Empty space skipped, a ray for nine pixels where packets of rays render; else the nearest voxel for everything.
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

/// Which combination of parts renders.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Preset {
    /// The best there is.
    #[default]
    Default,
    /// The paper's own: 7 + 1 bits a voxel, classification by filtered density, the homogeneous-region flag, the nearest
    /// voxel at low detail and trilinear at high, frame-to-frame reuse by the paper's rule with key frames.
    Colvis,
    /// The least memory: bricks to leap by, no flag for each voxel, nothing kept between frames.
    Lean,
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
        Self { quality, classification, sensitivity, step_power, samples_per_pixel: 1, adaptive: false }
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self::new(Quality::High)
    }
}
