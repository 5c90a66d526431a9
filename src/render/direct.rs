//! Rays one after the other as a renderer.

use super::memory::MemoryPart;
use super::renderer::Renderer;
use super::{Frame, PreparedVolume, Settings, View, Work, caster};

/// The ray caster of [`caster::render`]: nothing is kept between frames.
pub struct Direct {
    volume: PreparedVolume,
    settings: Settings,
}

impl Direct {
    /// Renders `space` by `settings`.
    pub fn new(volume: &PreparedVolume, settings: Settings) -> Self {
        Self { volume: volume.clone(), settings }
    }
}

impl Renderer for Direct {
    fn render(&mut self, view: &View, frame: &mut Frame) -> Work {
        caster::render(&self.volume, view, &self.settings, frame)
    }

    fn parts(&self) -> Vec<(MemoryPart, usize)> {
        vec![(MemoryPart::Flags, self.volume.bytes())]
    }
}
