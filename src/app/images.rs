//! How a scene's images are made.

use serde::Deserialize;

use crate::app::Catalog;
use crate::components::output::Picture;
use crate::error::{Error, Result};
use crate::panics::ask_plugin;
use crate::render::{
    CameraModel, Choices, Classification, GradientSource, Leaping, Light, LowDetail, Options, Preset, Settings,
    ShaderModel,
};

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
    /// What the light at the camera does; none for the host's own: an endoscope's in a window, else the paper's headlight.
    pub light: Option<Light>,
    /// What the wall looks like.
    pub shader: ShaderModel,
}

impl RenderSettings {
    /// A quality's settings with what the scene says in their place.
    pub fn apply(&self, settings: Settings) -> Settings {
        Settings {
            sensitivity: self.sensitivity.unwrap_or(settings.sensitivity),
            classification: if self.filtered_density { Classification::Filtered } else { settings.classification },
            choices: self.choices,
            light: self.light.unwrap_or(settings.light),
            shader: self.shader,
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
        self.choices.check()?;
        self.shader.check()
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
        let preset = || format!("preset {}", self.preset.name);
        ask_plugin(preset, || (self.preset.takes)(&self.settings.choices))?;
        ask_plugin(preset, || (self.preset.check)(self.settings.options))?;
        self.settings.shader.check()?;
        self.camera.camera(self.fov_degrees, 1.0).map(drop)
    }
}

/// [`RenderSettings`] as they stand in a file.
#[derive(Deserialize, Default)]
#[serde(default, deny_unknown_fields)]
pub(super) struct RenderFile {
    sensitivity: Option<f32>,
    filtered_density: bool,
    preset: Option<String>,
    camera: Option<String>,
    fov_degrees: Option<f64>,
    shade: Option<String>,
    light: Option<Light>,
    leap: Option<Leaping>,
    gradients: Option<GradientSource>,
    key_frames: Option<u32>,
    low: Option<LowDetail>,
}

impl RenderFile {
    /// The settings, and what images are like; preset, camera and shader are among those of `catalog`, with the settings that
    /// `options` knows of their names.
    ///
    /// # Errors
    /// Status 2 where there is no such preset, camera or shader.
    pub(super) fn settings(
        self,
        catalog: &Catalog,
        options: impl Fn(&str) -> Options,
    ) -> Result<(RenderSettings, ImageSettings)> {
        let Self { sensitivity, filtered_density, light, leap, gradients, key_frames, low, .. } = self;
        let preset = self.preset.map_or(Ok(Preset::default()), |name| catalog.find_preset(&name))?;
        let camera = self.camera.map_or(Ok(CameraModel::default()), |name| catalog.find_camera(&name))?;
        let shader = self.shade.map_or(Ok(ShaderModel::default()), |name| catalog.find_shader(&name))?;
        let choices = Choices { leap, gradients, key_frames, low };
        let shader = ShaderModel { options: options(shader.name), ..shader };
        let render = RenderSettings { sensitivity, filtered_density, choices, light, shader };
        let settings = Settings { options: options(preset.name), ..render.apply(Settings::default()) };
        let camera = CameraModel { options: options(camera.name), ..camera };
        let fov_degrees = self.fov_degrees.unwrap_or(90.0);
        Ok((render, ImageSettings { camera, fov_degrees, settings, preset, ..ImageSettings::default() }))
    }
}
