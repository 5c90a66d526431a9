//! Low detail by fewer rays: one for nine pixels at the most.
//!
//! A voxel of the wall covers more than nine pixels of most pictures. With packets of rays this is three times cheaper
//! than high detail, and still better than the nearest voxel for each pixel, which is the paper's low detail
//! ([`sampler::Nearest`](super::sampler::Nearest)).

use super::caster::fill_depth;
use super::distances::Distances;
use super::enlarge::Enlarger;
use super::memory::MemoryPart;
use super::packets::{PacketRenderer, Pixels};
use super::renderer::Renderer;
use super::{Frame, ImageSize, Settings, View, Work};
use crate::space::PreparedVolume;

/// The factor between the sides of the picture and of the traced picture.
const PART: usize = 3;

/// Renders at a fraction of the resolution and stretches the picture.
pub(crate) struct Low {
    volume: PreparedVolume,
    renderer: Box<dyn Renderer>,
    small: Frame,
    enlarger: Enlarger,
    shown: ImageSize,
}

impl Low {
    /// Renders `volume` with packets of rays and `settings`, with steps of half a voxel at the most: longer steps save
    /// little and cost much quality.
    pub(crate) fn new(volume: &PreparedVolume, settings: Settings) -> Self {
        let settings = Settings { step_power: settings.step_power.min(-1), ..settings };
        Self::around(volume, Box::new(PacketRenderer::new(volume, settings, Pixels::Needed)))
    }

    /// Stretches the pictures of `volume` that `renderer` makes.
    pub(crate) fn around(volume: &PreparedVolume, renderer: Box<dyn Renderer>) -> Self {
        Self {
            volume: volume.clone(),
            renderer,
            small: Frame::default(),
            enlarger: Enlarger::default(),
            shown: ImageSize::default(),
        }
    }
}

impl Renderer for Low {
    fn render(&mut self, view: &View, frame: &mut Frame) -> Work {
        frame.resize(view.width(), view.height());
        self.shown = frame.size();
        let [width, height] = [view.width(), view.height()].map(|side| side.div_ceil(PART));
        let work = self.renderer.render(&view.resized(width, height), &mut self.small);
        self.enlarger.enlarge(&self.small, frame);
        fill_depth(&self.volume, view, frame);
        work
    }

    fn distances(&self) -> Option<Distances<'_>> {
        Some(self.renderer.distances()?.stretched(self.small.size(), self.shown))
    }

    fn stretches(&self) -> bool {
        true
    }

    fn parts(&self) -> Vec<(MemoryPart, usize)> {
        let mut parts = self.renderer.parts();
        parts.push((MemoryPart::SmallPicture, self.small.pixels().len() * 3 + self.enlarger.bytes()));
        parts
    }
}
