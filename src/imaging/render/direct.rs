//! A renderer that casts rays one by one.

use super::memory::MemoryPart;
use super::renderer::Renderer;
use super::{Frame, Settings, View, Work, caster};
use crate::space::PreparedVolume;

/// The ray caster of [`caster::render`] as a renderer. It keeps nothing between frames.
pub struct Direct {
    volume: PreparedVolume,
    settings: Settings,
}

impl Direct {
    /// Creates a renderer of `volume` with `settings`.
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
