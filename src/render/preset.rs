//! A choice of renderer: what a name such as `default` stands for.

use std::sync::Arc;

use super::TransferFunction;
use super::choices::Choices;
use super::options::Options;
use super::prepared_volume::PreparedVolume;
use super::quality::Settings;
use super::renderer::Renderer;
use crate::error::Result;
use crate::volume::Volume;

/// A renderer by its name. Those of this crate are in [`presets::BUILT_IN`](super::presets::BUILT_IN); a program may have
/// its own, which work wherever these do.
///
/// The quality `reference` is common to the presets of this crate, and `adaptive` to all: see [`renderer`](super::renderer()).
#[derive(Clone, Copy, Debug)]
pub struct Preset {
    /// Its name on the command line and in scene files; presets of the same name are equal.
    pub name: &'static str,
    /// What it is, in a sentence for people.
    pub summary: &'static str,
    /// What it keeps in memory beside the 16-bit voxels, in a sentence for people.
    pub memory: &'static str,
    /// How the volume is prepared for it.
    pub preparation: Preparation,
    /// Whether it follows what a scene chooses: [`choices::all`](super::choices::all), [`choices::none`](super::choices::none),
    /// or a function of its own, whose error (wrong usage) says why not.
    pub takes: fn(&Choices) -> Result<()>,
    /// Checks its own settings ([`Settings::options`]), an error (wrong usage) if they make no sense: [`Options::none`] for a
    /// preset without any.
    pub check: fn(Options) -> Result<()>,
    /// Makes the renderer of a volume, prepared so, at high or low quality; of an own preset at the quality `reference`, too.
    pub make: fn(&PreparedVolume, Settings, Reuse) -> Box<dyn Renderer>,
}

impl PartialEq for Preset {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl Eq for Preset {}

/// How a volume is made ready for rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preparation {
    /// With the homogeneous-region flag of each voxel, and empty bricks.
    Flags,
    /// With empty bricks alone: the least memory.
    BricksOnly,
}

impl Preparation {
    /// Makes a volume ready.
    pub fn prepare(self, volume: Arc<Volume>, transfer: TransferFunction) -> PreparedVolume {
        match self {
            Self::Flags => PreparedVolume::new(volume, transfer),
            Self::BricksOnly => PreparedVolume::lean(volume, transfer),
        }
    }
}

/// Whether a renderer may use what it kept of earlier frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reuse {
    /// It may.
    Allowed,
    /// Each frame is made from scratch.
    Never,
}
