//! Presets: named renderers such as `default`.

use std::sync::Arc;

use super::choices::Choices;
use super::options::Options;
use super::quality::Settings;
use super::renderer::Renderer;
use crate::error::Result;
use crate::panics::ask_plugin;
use crate::space::PreparedVolume;
use crate::space::TransferFunction;
use crate::volume::Volume;

/// A named renderer.
///
/// [`presets::BUILT_IN`](super::presets::BUILT_IN) lists those of this crate. A program can add its own, which work
/// everywhere that these do.
///
/// The quality `reference` is the same for all presets of this crate, and `adaptive` for all presets: see
/// [`renderer`](super::renderer()). Build a preset on [`Preset::BASE`], so that your code also compiles with later fields.
#[derive(Clone, Copy, Debug)]
pub struct Preset {
    /// The name on the command line and in scene files. Presets with the same name are equal.
    pub name: &'static str,
    /// A one-sentence description for users.
    pub summary: &'static str,
    /// A one-sentence description of its memory beside the 16-bit voxels, for users.
    pub memory: &'static str,
    /// How the volume is prepared for it.
    pub preparation: Preparation,
    /// Checks a scene's choices: [`choices::all`](super::choices::all), [`choices::none`](super::choices::none), or a
    /// custom function whose error (invalid arguments) gives the reason.
    pub takes: fn(&Choices) -> Result<()>,
    /// Checks the preset's settings ([`Settings::options`]) and returns an error (invalid arguments) if they are
    /// invalid. Use [`Options::none`] for a preset without settings.
    pub check: fn(Options) -> Result<()>,
    /// Creates the renderer of a volume that was prepared accordingly, at high or low quality. A custom preset also
    /// receives the quality `reference`.
    pub make: fn(&PreparedVolume, Settings, Reuse) -> Box<dyn Renderer>,
}

impl Preset {
    /// Checks that the preset supports the settings, and that these are in range.
    ///
    /// # Errors
    /// Returns status 2 if one is not, and status 1 if a preset of another crate panics.
    pub fn supports(&self, settings: &Settings) -> Result<()> {
        settings.choices.check()?;
        let preset = || format!("preset {}", self.name);
        ask_plugin(preset, || (self.takes)(&settings.choices))?;
        ask_plugin(preset, || (self.check)(settings.options))?;
        settings.shader.check()
    }
}

impl PartialEq for Preset {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl Eq for Preset {}

/// How a volume is prepared for ray casting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preparation {
    /// With the homogeneous-region flag of each voxel and empty bricks.
    Flags,
    /// With empty bricks only, which takes the least memory.
    BricksOnly,
}

impl Preparation {
    /// Prepares a volume.
    pub fn prepare(self, volume: Arc<Volume>, transfer: TransferFunction) -> PreparedVolume {
        match self {
            Self::Flags => PreparedVolume::new(volume, transfer),
            Self::BricksOnly => PreparedVolume::lean(volume, transfer),
        }
    }
}

/// Determines if a renderer may use data from earlier frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reuse {
    /// It may use earlier frames.
    Allowed,
    /// Each frame is rendered from scratch.
    Never,
}
