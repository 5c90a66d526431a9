//! Single rays with the ideas of the paper's section 2.2 that a scene can choose ([`Choices`](super::Choices)).

use super::accelerations::Accelerations;
use super::choices::{GradientSource, Leaping};
use super::direct::Direct;
use super::preset::Reuse;
use super::quality::{Quality, Settings};
use super::renderer::Renderer;
use super::reuse::paper::Trace;
use super::reuse::{Plain, Refresh, Reusing, VoxelStorage, WordStorage};
use super::sampler::Trilinear;
use crate::space::PreparedVolume;

/// Creates a renderer of the 16-bit voxels with the choices of `settings`.
pub(crate) fn words(volume: &PreparedVolume, settings: Settings, reuse: Reuse) -> Box<dyn Renderer> {
    let choices = settings.choices;
    if !choices.need_single_rays() {
        return Box::new(Direct::new(volume, settings));
    }
    // If no voxel has a flag, bricks replace the flags.
    let own = if volume.flags().has_bits() { Leaping::Flag } else { Leaping::Brick };
    let gradients = choices.gradients.unwrap_or(GradientSource::None);
    let accelerations = Accelerations::new(volume, &Trilinear::new(volume), choices.leap.unwrap_or(own), gradients);
    let key_frames = choices.key_frames.filter(|_| reuse == Reuse::Allowed);
    let storage = WordStorage::accelerated(volume, accelerations, key_frames.is_some());
    by_frames(storage, settings, key_frames)
}

/// Creates a renderer of independent pictures, or one that follows the paper's rule with regular key frames.
#[doc(hidden)]
pub fn by_frames<S: VoxelStorage + 'static>(
    storage: S,
    settings: Settings,
    key_frames: Option<u32>,
) -> Box<dyn Renderer> {
    match key_frames {
        Some(every) => Box::new(Reusing::<_, Trace>::new(storage, settings, Refresh::KeyFrames(every))),
        None => Box::new(Plain::new(storage, settings)),
    }
}

/// Returns the settings for tracing a picture that low detail stretches: high detail, with steps of half a voxel at the
/// most, since longer ones save little and cost much quality.
pub(crate) fn stretched(settings: Settings) -> Settings {
    Settings { quality: Quality::High, step_power: settings.step_power.min(-1), ..settings }
}
