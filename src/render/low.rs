//! Low detail by packets of rays: one ray for nine pixels at the most. A voxel of the wall covers more than that of most
//! pictures, so that it is three times cheaper than high detail and still better than the nearest voxel for each pixel.

use super::caster::depths;
use super::enlarge::Enlarger;
use super::fast::{Fast, Pixels};
use super::memory::MemoryPart;
use super::renderer::Renderer;
use super::{Frame, PreparedVolume, Settings, View, Work};

/// Sides of the picture are so many times those of the traced one.
const PART: usize = 3;

/// Renders at a part of the resolution, and stretches the picture.
pub struct Low {
    space: PreparedVolume,
    fast: Fast,
    small: Frame,
    enlarger: Enlarger,
}

impl Low {
    /// Renders `space` by `settings`, but by steps of half a voxel at the most: longer ones save little and cost much.
    pub fn new(space: &PreparedVolume, settings: Settings) -> Self {
        let settings = Settings { step_power: settings.step_power.min(-1), ..settings };
        let fast = Fast::new(space, settings, Pixels::Needed);
        Self { space: space.clone(), fast, small: Frame::default(), enlarger: Enlarger::default() }
    }
}

impl Renderer for Low {
    fn render(&mut self, view: &View, frame: &mut Frame) -> Work {
        frame.resize(view.width(), view.height());
        let [width, height] = [view.width(), view.height()].map(|side| side.div_ceil(PART));
        let work = self.fast.render(&view.resized(width, height), &mut self.small);
        self.enlarger.enlarge(&self.small, frame);
        if let Some(depth) = frame.buffers().1 {
            depths(&self.space, view, depth);
        }
        work
    }

    fn stretches(&self) -> bool {
        true
    }

    fn parts(&self) -> Vec<(MemoryPart, usize)> {
        let mut parts = self.fast.parts();
        parts.push((MemoryPart::SmallPicture, self.small.pixels().len() * 3 + self.enlarger.bytes()));
        parts
    }
}
