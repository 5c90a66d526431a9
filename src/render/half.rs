//! Low detail by packets of rays: one ray for four pixels at the most.

use super::caster::depths;
use super::enlarge::enlarge;
use super::fast::Fast;
use super::{Frame, Renderer, Settings, Space, View, Work};

/// Renders at half the resolution, and stretches the picture.
pub struct Half {
    space: Space,
    fast: Fast,
    small: Frame,
}

impl Half {
    /// Renders `space` by `settings`; packets take steps of a half voxel at the most, so that no wall is stepped over.
    pub fn new(space: &Space, settings: Settings) -> Self {
        let settings = Settings { step_power: settings.step_power.min(-1), ..settings };
        let fast = Fast::new(space, settings, super::fast::Pixels::Needed);
        Self { space: space.clone(), fast, small: Frame::default() }
    }
}

impl Renderer for Half {
    fn render(&mut self, view: &View, frame: &mut Frame) -> Work {
        frame.resize(view.width(), view.height());
        let work =
            self.fast.render(&view.resized(view.width().div_ceil(2), view.height().div_ceil(2)), &mut self.small);
        enlarge(&self.small, frame);
        if let Some(depth) = frame.buffers().1 {
            depths(&self.space, view, depth);
        }
        work
    }

    fn parts(&self) -> Vec<(&'static str, usize)> {
        let mut parts = self.fast.parts();
        parts.push(("picture of half the size", self.small.pixels().len() * 3));
        parts
    }
}
