//! `colvis`: the paper's own renderer, with everything of its section 2.2.
//!
//! | idea of section 2.2 | part of `src/imaging/render` | setting |
//! |---|---|---|
//! | L and A front to back, to the end at the camera's sensitivity | `caster` | `[render] sensitivity` |
//! | headlight, simplified Phong | [`headlight`](crate::render::shaders::headlight) | `[render] shade`, default |
//! | gradient and filtered density by 4D linear regression | `regression` | always |
//! | … between the eight nearest voxels: high detail | `bytes::sampler` | `--quality high` |
//! | … the nearest voxel's: low detail | `bytes::sampler` | `--quality low`, `[render] low` |
//! | tissue in homogeneous surroundings has a gradient towards the camera | `sampler` | always |
//! | 7 + 1 bits a voxel with a homogeneous-region flag | `bytes` | `[render] leap = "flag"`, default |
//! | the potential field to leap by | `leap::voxels` | `[render] leap = "voxel"` |
//! | frame-level gradient cache | `gradient_cache` | `[render] gradients = "cached"`, default |
//! | precomputed gradients and densities | `gradient_store` | `[render] gradients = "stored"` |
//! | fixed point | `bytes::sampler` | where values, not densities, are classified |
//! | frame-to-frame reuse: forwards, backwards, rotation | `reuse::paper` | without `--no-reuse` |
//! | every Nth frame from scratch | `reuse` | `[render] key_frames`, 10 |
//!
//! `colvis report render` measures the benefit of each.

use crate::render::bytes::{ByteStorage, ByteVolume};
use crate::render::choices::{self, GradientSource, Leaping, LowDetail};
use crate::render::low::Low;
use crate::render::options::Options;
use crate::render::preset::{Preparation, Preset, Reuse};
use crate::render::quality::{Classification, Quality, Settings};
use crate::render::renderer::Renderer;
use crate::render::single::{by_frames, stretched};
use crate::space::PreparedVolume;

/// The paper's renderer: 7 + 1 bits a voxel, classification by filtered density, the homogeneous-region flag, the nearest voxel at
/// low detail and trilinear at high, a gradient cache, and frame-to-frame reuse by the paper's rule with key frames.
pub const PRESET: Preset = Preset {
    name: "colvis",
    summary: "the paper's combination: 7 + 1 bits per voxel, reuse with key frames",
    memory: "a byte for each voxel, a gradient cache, and the last frame's empty distances",
    preparation: Preparation::Flags,
    takes: choices::all,
    check: Options::none,
    make,
};

/// Default number of frames from one key frame to the next.
pub const KEY_FRAMES: u32 = 10;
/// Default leaping method.
pub const LEAPING: Leaping = Leaping::Flag;
/// Default source of regressions.
pub const GRADIENTS: GradientSource = GradientSource::Cached;

/// The flags reach as far as a filtered density does: two voxels.
const REACH: usize = 2;

fn make(volume: &PreparedVolume, settings: Settings, reuse: Reuse) -> Box<dyn Renderer> {
    let chosen = settings.choices;
    let settings = Settings { classification: Classification::Filtered, ..settings };
    if settings.quality == Quality::Low && chosen.low == Some(LowDetail::Third) {
        return Box::new(Low::around(volume, make(volume, stretched(settings), reuse)));
    }
    let (leap, gradients) = (chosen.leap.unwrap_or(LEAPING), chosen.gradients.unwrap_or(GRADIENTS));
    let storage = ByteStorage::new(volume, ByteVolume::new(volume, REACH), leap, gradients);
    let key_frames = chosen.key_frames.unwrap_or(KEY_FRAMES);
    by_frames(storage, settings, (reuse == Reuse::Allowed).then_some(key_frames))
}
