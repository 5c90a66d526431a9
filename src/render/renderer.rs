//! A way to make pictures, with whatever it keeps from one to the next.

use super::adaptive::Budget;
use super::memory::MemoryPart;
use super::{Frame, Settings, View, Work};

/// Side of the squares of pixels by which [`Renderer::render_squares`] is told what to trace.
pub const SQUARE: usize = 2;

/// Renders views of one volume, in the order of a flight. It may keep what it likes between frames as long as each
/// frame is as good on its own: the views may jump.
pub trait Renderer: Send + Sync {
    /// Renders `view` into `frame` (made to fit if it does not), on all of rayon's threads; the same bytes for every
    /// number of threads, if the views before were the same.
    fn render(&mut self, view: &View, frame: &mut Frame) -> Work;

    /// Memory that it takes now, beside the 16-bit voxels, bytes.
    fn bytes(&self) -> usize {
        self.parts().iter().map(|p| p.1).sum()
    }

    /// What that memory is for, and how much of it, bytes.
    fn parts(&self) -> Vec<(MemoryPart, usize)>;

    /// Lets each picture from now on cost about so much. Only renderers whose detail follows the need listen.
    fn set_budget(&mut self, _budget: Budget) {}

    /// Whether it traces a part of the pixels and stretches them: strips of a picture, each rendered as one of its own, would
    /// not fit together.
    fn stretches(&self) -> bool {
        false
    }

    /// How detailed the last picture is, where that follows the need.
    fn detail(&self) -> Option<Detail> {
        None
    }

    /// A renderer of the same volume for the samples that a picture at rest is refined with, as good as rays one after the
    /// other by `settings`; it shares what this one has prepared. Where it is none, rays one after the other make the samples of
    /// this crate's presets, and the pictures of a preset of another crate stay as sharp as that makes them.
    fn refining(&self, _settings: Settings) -> Option<Box<dyn Renderer>> {
        None
    }

    /// As [`Renderer::render`], where only the squares of [`SQUARE`] × [`SQUARE`] pixels that are `wanted` (row by row of
    /// squares) are looked at: what `frame` holds elsewhere does not matter.
    fn render_squares(&mut self, view: &View, frame: &mut Frame, _wanted: &[bool]) -> Work {
        self.render(view, frame)
    }

    /// What it did wrong since the last call, where somebody holds it to its promises: who, and what. Renderers of other crates
    /// are held to theirs; they need not implement this.
    fn complaint(&mut self) -> Option<(String, String)> {
        None
    }

    /// Memory that it takes now and shares neither with the renderer that it [refines](Renderer::refining) nor with the
    /// volume, bytes.
    fn own_bytes(&self) -> usize {
        0
    }
}

/// How detailed a picture is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Detail {
    /// Pixels that were traced, before the picture was stretched.
    pub size: (usize, usize),
    /// Samples of the reference that each pixel has.
    pub samples: u32,
    /// Whether the same view rendered again would be no better.
    pub best: bool,
}
