//! The paper's accelerations one at a time, beside the flags alone: each a renderer that owns what it needs.

use crate::render::begin::Anew;
use crate::render::caster::Shot;
use crate::render::classify::ByValue;
use crate::render::gradients::{GradientCache, GradientVolume, Stored, WithCache, WithStored};
use crate::render::leap::{BrickLeap, BrickWalls, VoxelLeap, VoxelWalls};
use crate::render::sampler::Trilinear;
use crate::render::skip::Leap;
use crate::render::{Frame, PreparedVolume, Renderer, Settings, View, Work};

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
pub struct With {
    space: PreparedVolume,
    settings: Settings,
    part: Part,
}

impl With {
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

impl Renderer for With {
    fn render(&mut self, view: &View, frame: &mut Frame) -> Work {
        let (space, settings) = (&self.space, &self.settings);
        let shot = Shot { space, view, settings };
        let mut kept = vec![(); view.width() * view.height()];
        let (high, flags) = (Trilinear::new(space), Leap::<true>::new(space));
        match &self.part {
            Part::Voxels(walls) => shot.image(&high, &VoxelLeap::<1>::new(walls), &ByValue, &Anew, &mut kept, frame),
            Part::Bricks(walls) => {
                shot.image(&high, &BrickLeap::<true>::new(space, walls), &ByValue, &Anew, &mut kept, frame)
            }
            Part::Stored(s) => shot.image(&WithStored::new(space, s), &flags, &ByValue, &Anew, &mut kept, frame),
            Part::Cache(c) => shot.image(&WithCache::new(space, c), &flags, &ByValue, &Anew, &mut kept, frame),
        }
    }

    fn parts(&self) -> Vec<(&'static str, usize)> {
        let flags = ("homogeneous-region flags", self.space.bytes());
        vec![
            flags,
            match &self.part {
                Part::Voxels(w) => ("wall distance per voxel", w.bytes()),
                Part::Bricks(w) => ("wall distance per brick", w.bytes()),
                Part::Stored(s) => ("gradients ahead of time", s.bytes()),
                Part::Cache(c) => ("gradient cache", c.bytes()),
            },
        ]
    }
}
