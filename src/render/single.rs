//! Single rays with the ideas of the paper's section 2.2 that a scene can choose ([`Choices`](super::Choices)).

use super::begin::Begin;
use super::caster::ImageRequest;
use super::choices::{GradientSource, Leaping};
use super::classify::{ByDensity, ByValue};
use super::direct::Direct;
use super::gradient_store::{FitSampler, Fits};
use super::leap::Leaper;
use super::memory::MemoryPart;
use super::preset::Reuse;
use super::quality::{Classification, Quality, Settings};
use super::renderer::Renderer;
use super::reuse::paper::Trace;
use super::reuse::{Plain, Refresh, Reusing, VoxelStorage, WordStorage};
use super::sampler::{Trilinear, VoxelSampler};
use super::skip::Skipper;
use super::{Frame, Work};
use crate::space::PreparedVolume;

/// The leaping method and the regression source for the rays of a storage.
pub struct Accelerations {
    /// The leaping method.
    pub leaper: Leaper,
    /// The source of the regressions.
    pub fits: Fits,
}

impl Accelerations {
    /// Prepares what `leap` and `gradients` need for `volume`, whose voxels `sampler` sees.
    pub fn new<S: VoxelSampler>(
        volume: &PreparedVolume,
        sampler: &S,
        leap: Leaping,
        gradients: GradientSource,
    ) -> Self {
        Self { leaper: Leaper::new(leap, volume), fits: Fits::new(gradients, sampler, volume) }
    }

    /// Casts a picture through the voxels that `sampler` sees.
    ///
    /// `flags` leap by the storage's own flags: the first is used where values are classified, the second where
    /// densities are.
    pub fn image<S: VoxelSampler, V: Skipper, D: Skipper, B: Begin>(
        &self,
        request: &ImageRequest<'_>,
        sampler: S,
        flags: (V, D),
        begin: &B,
        kept: &mut [B::Kept],
        frame: &mut Frame,
    ) -> Work {
        let sampler = FitSampler::new(sampler, &self.fits);
        match request.settings.classification {
            Classification::Value => {
                let leap = self.leaper.skipper::<_, 1>(request.volume, flags.0);
                request.image(&sampler, &leap, &ByValue, begin, kept, frame)
            }
            Classification::Filtered => {
                let leap = self.leaper.skipper::<_, 2>(request.volume, flags.1);
                request.image(&sampler, &leap, &ByDensity, begin, kept, frame)
            }
        }
    }

    /// Returns the memory beside the flags, by purpose.
    pub fn parts(&self) -> impl Iterator<Item = (MemoryPart, usize)> {
        self.leaper.part().into_iter().chain(self.fits.part())
    }
}

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
pub(crate) fn by_frames<S: VoxelStorage + 'static>(
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
