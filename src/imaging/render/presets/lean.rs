//! `lean`: the least memory.

use crate::error::{Error, Result};
use crate::render::choices::{Choices, GradientSource, Leaping, LowDetail};
use crate::render::low::Low;
use crate::render::options::Options;
use crate::render::preset::{Preparation, Preset, Reuse};
use crate::render::quality::{Quality, Settings};
use crate::render::renderer::Renderer;
use crate::render::single::{stretched, words};
use crate::space::PreparedVolume;

/// The renderer with the least memory: bricks to leap by, no flag for each voxel, nothing kept between frames.
pub const PRESET: Preset = Preset {
    name: "lean",
    summary: "least memory: one ray at a time, nothing kept between frames",
    memory: "a byte for each brick",
    preparation: Preparation::BricksOnly,
    takes,
    check: Options::none,
    make,
};

/// Refuses choices that cost memory for each voxel or from frame to frame.
fn takes(choices: &Choices) -> Result<()> {
    let instead = "or the preset colvis or default";
    let refuse = |what: &str, why: &str, hint: String| {
        Err(Error::usage(format!("render.{what}"), format!("the preset lean {why}"), hint))
    };
    if matches!(choices.leap, Some(Leaping::Flag | Leaping::Voxel)) {
        return refuse("leap", "stores nothing per voxel", format!("choose \"brick\" or \"none\", {instead}"));
    }
    if matches!(choices.gradients, Some(GradientSource::Cached | GradientSource::Stored)) {
        return refuse("gradients", "keeps no gradients", format!("choose \"none\" or \"eight\", {instead}"));
    }
    if choices.key_frames.is_some() {
        return refuse("key_frames", "keeps nothing between frames", format!("leave it out, {instead}"));
    }
    Ok(())
}

fn make(volume: &PreparedVolume, settings: Settings, reuse: Reuse) -> Box<dyn Renderer> {
    if settings.quality == Quality::Low && settings.choices.low == Some(LowDetail::Third) {
        return Box::new(Low::around(volume, words(volume, stretched(settings), reuse)));
    }
    words(volume, settings, reuse)
}
