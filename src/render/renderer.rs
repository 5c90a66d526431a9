//! A way to make pictures, with whatever it keeps from one to the next.

use super::caster;
use super::{Frame, Settings, Space, View, Work};

/// Renders views of one space, in the order of a flight. It may keep what it likes between frames as long as each
/// frame is as good on its own: the views may jump.
pub trait Renderer: Send + Sync {
    /// Renders `view` into `frame` (made to fit if it does not), on all of rayon's threads; the same bytes for every
    /// number of threads, if the views before were the same.
    fn render(&mut self, view: &View, frame: &mut Frame) -> Work;

    /// Memory that it takes now, beside the 16-bit voxels, bytes.
    fn bytes(&self) -> usize;
}

/// The ray caster of [`caster::render`]: nothing is kept between frames.
pub struct Direct {
    space: Space,
    settings: Settings,
}

impl Direct {
    /// Renders `space` by `settings`.
    pub fn new(space: &Space, settings: Settings) -> Self {
        Self { space: space.clone(), settings }
    }
}

impl Renderer for Direct {
    fn render(&mut self, view: &View, frame: &mut Frame) -> Work {
        caster::render(&self.space, view, &self.settings, frame)
    }

    fn bytes(&self) -> usize {
        self.space.bytes()
    }
}
