//! The renderer interface.

use super::adaptive::Budget;
use super::distances::Distances;
use super::memory::MemoryPart;
use super::{Frame, Settings, View, Work};
use crate::render::frame::ImageSize;

/// Side of the pixel squares that [`Renderer::render_squares`] traces, pixels.
pub const SQUARE: usize = 2;

/// Renders views of one volume in the order of a flight.
///
/// A renderer may keep any data between frames as long as each frame is as good as it would be without: the views may jump.
pub trait Renderer: Send + Sync {
    /// Renders `view` into `frame`, resizing it if needed, on all of rayon's threads.
    ///
    /// The bytes are the same for every number of threads, provided that the previous views were the same.
    fn render(&mut self, view: &View, frame: &mut Frame) -> Work;

    /// Returns the memory in use beside the 16-bit voxels, bytes.
    fn bytes(&self) -> usize {
        self.parts().iter().map(|p| p.1).sum()
    }

    /// Returns the purposes of that memory with their sizes, bytes.
    fn parts(&self) -> Vec<(MemoryPart, usize)>;

    /// Sets the approximate cost of each following picture. Only renderers with adaptive detail use it.
    fn set_budget(&mut self, _budget: Budget) {}

    /// Returns true if the renderer traces a part of the pixels and stretches them. Strips of a picture that are
    /// rendered separately would then not fit together.
    fn stretches(&self) -> bool {
        false
    }

    /// Returns the distances to the wall that the last picture was made from, if they are kept. They are for the picture as it is shown.
    fn distances(&self) -> Option<Distances<'_>> {
        None
    }

    /// Returns the detail of the last picture, if the detail adapts.
    fn detail(&self) -> Option<Detail> {
        None
    }

    /// Creates a renderer of the same volume for the samples that refine a picture at rest, with the quality of single
    /// rays by `settings`. It shares this renderer's prepared data.
    ///
    /// If it returns `None`, single rays make the samples for this crate's presets, and the pictures of a preset of
    /// another crate stay as sharp as that preset makes them.
    fn refining(&self, _settings: Settings) -> Option<Box<dyn Renderer>> {
        None
    }

    /// Renders like [`Renderer::render`], but only needs to trace the squares of [`SQUARE`] × [`SQUARE`] pixels that
    /// are `wanted` (row by row of squares). The content of `frame` elsewhere does not matter.
    fn render_squares(&mut self, view: &View, frame: &mut Frame, _wanted: &[bool]) -> Work {
        self.render(view, frame)
    }

    /// Returns a violation of the renderer contract since the last call, if the renderer is checked: the culprit and the problem.
    ///
    /// Renderers of other crates are checked automatically and need not implement this.
    fn complaint(&mut self) -> Option<(String, String)> {
        None
    }

    /// Returns the memory in use that is shared neither with the renderer that this one [refines](Renderer::refining)
    /// nor with the volume, bytes.
    fn own_bytes(&self) -> usize {
        0
    }
}

/// The detail of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Detail {
    /// Traced pixels, before the picture was stretched.
    pub size: ImageSize,
    /// Reference-quality samples per pixel.
    pub samples: u32,
    /// True if rendering the same view again would not improve it.
    pub best: bool,
}
