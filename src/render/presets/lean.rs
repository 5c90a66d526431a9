//! `lean`: the least memory.

use crate::render::PreparedVolume;
use crate::render::direct::Direct;
use crate::render::preset::{Preparation, Preset, Reuse};
use crate::render::quality::Settings;
use crate::render::renderer::Renderer;

/// The least memory: bricks to leap by, no flag for each voxel, nothing kept between frames.
pub const PRESET: Preset = Preset {
    name: "lean",
    summary: "The least memory: bricks to leap by, nothing kept between frames",
    memory: "a byte for each brick",
    preparation: Preparation::BricksOnly,
    make,
};

fn make(space: &PreparedVolume, settings: Settings, _: Reuse) -> Box<dyn Renderer> {
    Box::new(Direct::new(space, settings))
}
