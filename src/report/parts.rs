//! The paper's accelerations one at a time, beside the flags alone: each a renderer that owns what it needs.

use crate::render::begin::FromScratch;
use crate::render::caster::ImageRequest;
use crate::render::classify::ByValue;
use crate::render::gradient_store::{
    CachedGradientSampler, GradientCache, GradientVolume, Stored, StoredGradientSampler,
};
use crate::render::leap::{BrickLeap, BrickWalls, VoxelLeap, VoxelWalls};
use crate::render::sampler::Trilinear;
use crate::render::skip::Leap;
use crate::render::{Frame, MemoryPart, PreparedVolume, Renderer, Settings, View, Work};

/// An acceleration.
pub enum Part {
    /// Leaping by the wall's distance, a byte for each voxel.
    Voxels(VoxelWalls),
    /// Leaping by the wall's distance, a byte for each brick.
    Bricks(BrickWalls),
    /// Gradients ahead of time.
    Stored(GradientVolume),
    /// Gradients kept from frame to frame.
    Cache(GradientCache),
}

/// High detail with one acceleration.
pub struct Accelerated {
    space: PreparedVolume,
    settings: Settings,
    part: Part,
}

impl Accelerated {
    /// High detail of `space` with `part`, which was made for it.
    pub fn new(space: &PreparedVolume, part: Part) -> Self {
        Self { space: space.clone(), settings: Settings::default(), part }
    }

    /// Leaping by the wall's distance at each voxel.
    pub fn voxels(space: &PreparedVolume) -> Self {
        Self::new(space, Part::Voxels(VoxelWalls::new(space)))
    }

    /// Leaping by the wall's distance at each brick.
    pub fn bricks(space: &PreparedVolume) -> Self {
        Self::new(space, Part::Bricks(BrickWalls::new(space)))
    }

    /// Gradients near the wall ahead of time.
    pub fn stored(space: &PreparedVolume) -> Self {
        Self::new(space, Part::Stored(GradientVolume::new(space, Stored::NearWall)))
    }

    /// A gradient cache.
    pub fn cache(space: &PreparedVolume) -> Self {
        Self::new(space, Part::Cache(GradientCache::new(space)))
    }
}

impl Renderer for Accelerated {
    fn render(&mut self, view: &View, frame: &mut Frame) -> Work {
        let (space, settings) = (&self.space, &self.settings);
        let request = ImageRequest { space, view, settings };
        let mut kept = vec![(); view.width() * view.height()];
        let (high, flags) = (Trilinear::new(space), Leap::<true>::new(space));
        match &self.part {
            Part::Voxels(walls) => {
                request.image(&high, &VoxelLeap::<1>::new(walls), &ByValue, &FromScratch, &mut kept, frame)
            }
            Part::Bricks(walls) => {
                request.image(&high, &BrickLeap::<true>::new(space, walls), &ByValue, &FromScratch, &mut kept, frame)
            }
            Part::Stored(s) => {
                request.image(&StoredGradientSampler::new(space, s), &flags, &ByValue, &FromScratch, &mut kept, frame)
            }
            Part::Cache(c) => {
                request.image(&CachedGradientSampler::new(space, c), &flags, &ByValue, &FromScratch, &mut kept, frame)
            }
        }
    }

    fn parts(&self) -> Vec<(MemoryPart, usize)> {
        let flags = (MemoryPart::Flags, self.space.bytes());
        vec![
            flags,
            match &self.part {
                Part::Voxels(w) => (MemoryPart::VoxelDistances, w.bytes()),
                Part::Bricks(w) => (MemoryPart::BrickDistances, w.bytes()),
                Part::Stored(s) => (MemoryPart::StoredGradients, s.bytes()),
                Part::Cache(c) => (MemoryPart::GradientCache, c.bytes()),
            },
        ]
    }
}
