//! How a scene's images are made.

use serde::Deserialize;

use crate::app::Catalog;
use crate::components::output::Picture;
use crate::error::{Error, Result};
use crate::render::{CameraModel, Choices, Classification, GradientSource, Leaping, LowDetail, Preset, Settings};

/// What a scene says about its images; the quality's own settings hold where it says nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RenderSettings {
    /// The camera's sensitivity: a ray ends when less than this share of light comes from beyond, 0 to 1.
    pub sensitivity: Option<f32>,
    /// Whether opacity is looked up by the regression's filtered density, as the paper has it, instead of by the
    /// trilinear value.
    pub filtered_density: bool,
    /// Which of the paper's ideas are used in the place of the preset's own.
    pub choices: Choices,
}

impl RenderSettings {
    /// A quality's settings with what the scene says in their place.
    pub fn apply(&self, settings: Settings) -> Settings {
        Settings {
            sensitivity: self.sensitivity.unwrap_or(settings.sensitivity),
            classification: if self.filtered_density { Classification::Filtered } else { settings.classification },
            choices: self.choices,
            ..settings
        }
    }
}

/// How images are made.
#[derive(Clone, Debug)]
pub struct ImageSettings {
    /// Pixels.
    pub width: usize,
    /// Pixels.
    pub height: usize,
    /// Which camera.
    pub camera: CameraModel,
    /// View angle over the shorter side, degrees.
    pub fov_degrees: f64,
    /// The renderer's settings.
    pub settings: Settings,
    /// Which renderer; the command line's `--preset` wins over the scene file's.
    pub preset: Preset,
}

impl Default for ImageSettings {
    /// 1024 × 1024 pixels, perspective with 90°, the best renderer at high quality.
    fn default() -> Self {
        let (settings, preset, camera) = Default::default();
        Self { width: 1024, height: 1024, camera, fov_degrees: 90.0, settings, preset }
    }
}

impl RenderSettings {
    /// # Errors
    /// Status 2 for a setting that makes no sense.
    pub fn check(&self) -> Result<()> {
        if let Some(s) = self.sensitivity.filter(|s| !(*s > 0.0 && *s < 1.0)) {
            let why = format!("is {s}");
            return Err(Error::usage("render.sensitivity", why, "give a finite number between 0 and 1"));
        }
        self.choices.check()
    }
}

impl ImageSettings {
    /// A view with these settings.
    pub fn picture(&self) -> Picture {
        let Self { width, height, camera, fov_degrees, settings, preset } = *self;
        Picture { camera, fov_degrees, settings, preset, ..Picture::new(width, height) }
    }

    /// # Errors
    /// Status 2 where the preset does not follow what is chosen.
    pub fn check(&self) -> Result<()> {
        self.settings.choices.check()?;
        (self.preset.takes)(&self.settings.choices)
    }
}

/// [`RenderSettings`] as they stand in a file.
#[derive(Deserialize, Default)]
#[serde(default, deny_unknown_fields)]
pub(super) struct RenderFile {
    sensitivity: Option<f32>,
    filtered_density: bool,
    preset: Option<String>,
    leap: Option<Leaping>,
    gradients: Option<GradientSource>,
    key_frames: Option<u32>,
    low: Option<LowDetail>,
}

impl RenderFile {
    /// The settings, and the preset, which is one of `catalog`.
    ///
    /// # Errors
    /// Status 2 where there is no such preset.
    pub(super) fn settings(self, catalog: &Catalog) -> Result<(RenderSettings, Preset)> {
        let Self { sensitivity, filtered_density, preset, leap, gradients, key_frames, low } = self;
        let preset = preset.map_or(Ok(Preset::default()), |name| catalog.find_preset(&name))?;
        let choices = Choices { leap, gradients, key_frames, low };
        Ok((RenderSettings { sensitivity, filtered_density, choices }, preset))
    }
}
