//! A wrapper that checks a renderer of another crate against the renderer contract.

use super::adaptive::Budget;
use super::distances::Distances;
use super::memory::MemoryPart;
use super::renderer::{Detail, Renderer};
use super::{Frame, ImageSize, Settings, View, Work};

/// Forwards every call to a renderer and enforces the requested frame size.
pub(crate) struct Checked {
    name: &'static str,
    inner: Box<dyn Renderer>,
    complaint: Option<String>,
}

impl Checked {
    /// Wraps the renderer of the preset `name`.
    pub(crate) fn new(name: &'static str, inner: Box<dyn Renderer>) -> Self {
        Self { name, inner, complaint: None }
    }

    fn check(&mut self, view: &View, frame: &mut Frame) {
        let (made, asked) = (frame.size(), ImageSize::new(view.width(), view.height()));
        if made != asked {
            self.complaint.get_or_insert(format!("made a frame of {made} pixels instead of {asked}"));
            frame.resize(asked.width, asked.height);
        }
    }
}

impl Renderer for Checked {
    fn render(&mut self, view: &View, frame: &mut Frame) -> Work {
        let work = self.inner.render(view, frame);
        self.check(view, frame);
        work
    }

    fn parts(&self) -> Vec<(MemoryPart, usize)> {
        self.inner.parts()
    }

    fn set_budget(&mut self, budget: Budget) {
        self.inner.set_budget(budget);
    }

    fn stretches(&self) -> bool {
        self.inner.stretches()
    }

    fn distances(&self) -> Option<Distances<'_>> {
        self.inner.distances()
    }

    fn detail(&self) -> Option<Detail> {
        self.inner.detail()
    }

    fn refining(&self, settings: Settings) -> Option<Box<dyn Renderer>> {
        let refining = self.inner.refining(settings)?;
        Some(Box::new(Self::new(self.name, refining)))
    }

    fn render_squares(&mut self, view: &View, frame: &mut Frame, wanted: &[bool]) -> Work {
        let work = self.inner.render_squares(view, frame, wanted);
        self.check(view, frame);
        work
    }

    fn own_bytes(&self) -> usize {
        self.inner.own_bytes()
    }

    fn complaint(&mut self) -> Option<(String, String)> {
        let what = self.complaint.take()?;
        Some((format!("preset {}", self.name), what))
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    struct Odd([usize; 2]);

    impl Renderer for Odd {
        fn render(&mut self, _: &View, frame: &mut Frame) -> Work {
            frame.resize(self.0[0], self.0[1]);
            Work::default()
        }

        fn parts(&self) -> Vec<(MemoryPart, usize)> {
            Vec::new()
        }
    }

    #[test]
    fn a_frame_keeps_its_size_and_the_renderer_is_told_of() {
        let view = View::new(DVec3::ZERO, DVec3::X, DVec3::Z, 90.0, 8, 6).unwrap();
        for size in [[0, 0], [7, 6], [800, 600], [8, 6]] {
            let mut renderer = Checked::new("odd", Box::new(Odd(size)));
            let mut frame = Frame::with_depth(8, 6);
            renderer.render(&view, &mut frame);
            let right = size == [8, 6];
            assert_eq!((frame.width(), frame.height(), frame.pixels().len()), (8, 6, 48));
            assert_eq!(frame.depth().map(<[f32]>::len), Some(48));
            assert_eq!(renderer.complaint().is_none(), right, "{size:?}");
            assert_eq!(renderer.complaint(), None, "said once");
        }
    }
}
