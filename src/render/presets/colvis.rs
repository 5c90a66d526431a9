//! `colvis`: the paper's own combination.

use crate::render::PreparedVolume;
use crate::render::bytes::{ByteStorage, ByteVolume};
use crate::render::preset::{Preparation, Preset, Reuse};
use crate::render::quality::{Classification, Settings};
use crate::render::renderer::Renderer;
use crate::render::reuse::paper::Trace;
use crate::render::reuse::{Plain, Refresh, Reusing};

/// The paper's own: 7 + 1 bits a voxel, classification by filtered density, the homogeneous-region flag, the nearest
/// voxel at low detail and trilinear at high, frame-to-frame reuse by the paper's rule with key frames.
pub const PRESET: Preset = Preset {
    name: "colvis",
    summary: "The paper's own combination: 7 + 1 bits a voxel, reuse with key frames",
    memory: "a byte for each voxel, and the last frame's empty distances",
    preparation: Preparation::Flags,
    make,
};

/// Frames from one key frame to the next.
const KEY_FRAMES: u32 = 10;

fn make(space: &PreparedVolume, settings: Settings, reuse: Reuse) -> Box<dyn Renderer> {
    let settings = Settings { classification: Classification::Filtered, ..settings };
    let storage = ByteStorage::new(space, ByteVolume::new(space, 2));
    match reuse {
        Reuse::Allowed => Box::new(Reusing::<_, Trace>::new(storage, settings, Refresh::KeyFrames(KEY_FRAMES))),
        Reuse::Never => Box::new(Plain::new(storage, settings)),
    }
}
