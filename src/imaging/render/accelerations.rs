//! What single rays leap by and take their regressions from, as a scene chooses ([`Choices`](super::Choices)).

use super::begin::Begin;
use super::caster::ImageRequest;
use super::choices::{GradientSource, Leaping};
use super::classify::{ByDensity, ByValue};
use super::gradient_store::{FitSampler, Fits};
use super::leap::Leaper;
use super::memory::MemoryPart;
use super::quality::Classification;
use super::sampler::VoxelSampler;
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
    /// `flags` leap by the storage's own flags: the first is used where values are classified, the second where densities are.
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

    /// Returns the memory in addition to the flags, by purpose.
    pub fn parts(&self) -> impl Iterator<Item = (MemoryPart, usize)> {
        self.leaper.part().into_iter().chain(self.fits.part())
    }
}
