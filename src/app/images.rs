//! Settings of a scene's images.

use crate::components::output::Picture;
use crate::error::{Error, Result};
use crate::render::{CameraModel, Choices, Classification, Light, Preset, Settings, ShaderModel};

/// A scene's settings for its images. The quality's own settings apply where the scene sets none.
///
/// They are kept beside the [`Settings`] of the current quality, because they apply to each quality that is switched to.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RenderSettings {
    /// The camera's sensitivity: a ray ends when less than this share of light comes from beyond, 0 to 1.
    pub sensitivity: Option<f32>,
    /// True if opacity is looked up by the regression's filtered density, as in the paper, instead of by the trilinear value.
    pub filtered_density: bool,
    /// The paper's techniques that replace the preset's own.
    pub choices: Choices,
    /// How the light at the camera behaves. `None` selects the host's own: an endoscope's in a window, otherwise the paper's
    /// headlight.
    pub light: Option<Light>,
    /// Appearance of the wall.
    pub shader: ShaderModel,
}

impl RenderSettings {
    /// Applies the scene's settings to those of a quality.
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

/// Size, camera and renderer of images.
#[derive(Clone, Debug)]
pub struct ImageSettings {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Camera model.
    pub camera: CameraModel,
    /// View angle over the shorter side, degrees.
    pub fov_degrees: f64,
    /// The renderer's settings.
    pub settings: Settings,
    /// Renderer. The command line's `--preset` takes precedence over the scene file.
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
    /// Checks the settings.
    ///
    /// # Errors
    /// Returns status 2 for a setting out of range.
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
    /// Creates a view with these settings.
    pub fn picture(&self) -> Picture {
        let Self { width, height, camera, fov_degrees, settings, preset } = *self;
        Picture { camera, fov_degrees, settings, preset, ..Picture::new(width, height) }
    }

    /// Checks that the preset supports the settings.
    ///
    /// # Errors
    /// Returns status 2 if it does not.
    pub fn check(&self) -> Result<()> {
        self.preset.supports(&self.settings)?;
        self.camera.camera(self.fov_degrees, 1.0).map(drop)
    }
}
