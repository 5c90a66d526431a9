//! Rays one after the other with the ideas of the paper's section 2.2 that a scene chooses ([`Choices`](super::Choices)).

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
use super::{Frame, PreparedVolume, Work};

/// How rays through a storage leap, and where their regressions come from.
pub struct Accelerations {
    /// How they leap.
    pub leaper: Leaper,
    /// Where regressions come from.
    pub fits: Fits,
}

impl Accelerations {
    /// What `leap` and `gradients` need for `space`, whose voxels `sampler` sees.
    pub fn new<S: VoxelSampler>(
        volume: &PreparedVolume,
        sampler: &S,
        leap: Leaping,
        gradients: GradientSource,
    ) -> Self {
        Self { leaper: Leaper::new(leap, volume), fits: Fits::new(gradients, sampler, volume) }
    }

    /// Casts a picture through voxels that `sampler` sees; by the storage's own flags it leaps with the first of `flags` where
    /// values are classified, with the second where densities are.
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

    /// Memory beside the flags, by what it is for.
    pub fn parts(&self) -> impl Iterator<Item = (MemoryPart, usize)> {
        self.leaper.part().into_iter().chain(self.fits.part())
    }
}

/// Rays through the 16-bit voxels by the choices of `settings`.
pub fn words(volume: &PreparedVolume, settings: Settings, reuse: Reuse) -> Box<dyn Renderer> {
    let choices = settings.choices;
    if !choices.need_single_rays() {
        return Box::new(Direct::new(volume, settings));
    }
    // Where no voxel has a flag, bricks do what the flags would.
    let own = if volume.flags().has_bits() { Leaping::Flag } else { Leaping::Brick };
    let gradients = choices.gradients.unwrap_or(GradientSource::None);
    let accelerations = Accelerations::new(volume, &Trilinear::new(volume), choices.leap.unwrap_or(own), gradients);
    let key_frames = choices.key_frames.filter(|_| reuse == Reuse::Allowed);
    let storage = WordStorage::accelerated(volume, accelerations, key_frames.is_some());
    by_frames(storage, settings, key_frames)
}

/// Pictures each on its own, or by the paper's rule with a key frame every so often.
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

/// The settings of the traced part of a picture that low detail stretches: high detail, by steps of half a voxel at the most,
/// since longer ones save little and cost much.
pub fn stretched(settings: Settings) -> Settings {
    Settings { quality: Quality::High, step_power: settings.step_power.min(-1), ..settings }
}
