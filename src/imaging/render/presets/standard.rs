//! `default`: packets of rays, or single rays if a scene selects something that packets cannot do.

use crate::render::choices::{self, LowDetail};
use crate::render::direct::Direct;
use crate::render::low::Low;
use crate::render::memory::MemoryPart;
use crate::render::options::Options;
use crate::render::packets::{PacketRenderer, Pixels};
use crate::render::preset::{Preparation, Preset, Reuse};
use crate::render::quality::{Classification, Quality, Settings};
use crate::render::renderer::Renderer;
use crate::render::single::{stretched, words};
use crate::render::{Frame, View, Work};
use crate::space::PreparedVolume;

/// The best available renderer: packets of rays, with a third of the resolution at low quality.
pub const PRESET: Preset = Preset {
    name: "default",
    summary: "fastest: packets of sixteen rays",
    memory: "a bit for each cell, distances of bricks and a gradient cache",
    preparation: Preparation::Flags,
    takes: choices::all,
    check: Options::none,
    make,
};

impl Preset {
    /// The default renderer without a name, for scenes that choose none of its techniques. Use it as the base of others: `..Preset::BASE`.
    pub const BASE: Self = Self { name: "", summary: "", memory: "", takes: choices::none, ..PRESET };
}

fn make(volume: &PreparedVolume, settings: Settings, reuse: Reuse) -> Box<dyn Renderer> {
    // Packets classify by values alone, and have their own leaping, shading and ray starts.
    let single = settings.classification != Classification::Value || settings.choices.need_single_rays();
    let several = settings.samples_per_pixel > 1;
    match (settings.quality, settings.choices.low) {
        (Quality::Low, Some(LowDetail::Nearest)) => words(volume, settings, reuse),
        (Quality::Low, Some(LowDetail::Third)) if single || several => {
            Box::new(Low::around(volume, make(volume, stretched(settings), reuse)))
        }
        _ if single => words(volume, settings, reuse),
        _ if several => Box::new(Supersampled::new(volume, settings)),
        (Quality::Low, _) => Box::new(Low::new(volume, settings)),
        _ => Box::new(PacketRenderer::new(volume, settings, Pixels::Needed)),
    }
}

/// Several rays a pixel, which packets do not support: they are cast one by one, and refined by packets.
struct Supersampled {
    volume: PreparedVolume,
    direct: Direct,
}

impl Supersampled {
    fn new(volume: &PreparedVolume, settings: Settings) -> Self {
        Self { volume: volume.clone(), direct: Direct::new(volume, settings) }
    }
}

impl Renderer for Supersampled {
    fn render(&mut self, view: &View, frame: &mut Frame) -> Work {
        self.direct.render(view, frame)
    }

    fn parts(&self) -> Vec<(MemoryPart, usize)> {
        self.direct.parts()
    }

    fn refining(&self, settings: Settings) -> Option<Box<dyn Renderer>> {
        Some(Box::new(PacketRenderer::refining_alone(&self.volume, settings)))
    }
}
