//! The window's framebuffer, which presents a flight's pictures with the interface over them.

use std::rc::Rc;
use std::sync::Arc;
use std::time::Instant;

use bevy_ecs::prelude::Entity;
use winit::event_loop::ActiveEventLoop;
use winit::window::{Window, WindowAttributes};

use super::contract::Beside;
use super::interface::Layout;
use super::layer::Placed;
use super::painter::Painter;
use super::screen::Screen;
use crate::components::output::Picture;
use crate::error::Result;
use crate::render::Frame;
use crate::systems::present::Presenter;

/// A window's pixels.
pub(crate) struct Framebuffer {
    screen: Screen,
    painter: Painter,
    /// Position of the next picture to be presented, and the time since when it is awaited; `None` while nothing has to be shown.
    next: Option<(Places, Instant)>,
    /// The slices as they were last received.
    slices: Vec<(Entity, Frame)>,
    /// The other pictures as they were last received.
    beside: Vec<(Beside, Frame)>,
    presented: Option<Result<PresentResult>>,
    /// Why the window system refused a picture.
    refused: Option<String>,
}

/// Positions of pictures in the window: their upper left corners, pixels.
#[derive(Clone, Debug, Default)]
pub(crate) struct Places {
    /// Position of the flight's picture; `None` if it is not shown.
    pub flight: Option<(usize, usize)>,
    /// Positions of the slices.
    pub slices: Vec<(Entity, (usize, usize))>,
    /// Positions of other pictures.
    pub beside: Vec<(Beside, (usize, usize))>,
}

/// Result of a presentation.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PresentResult {
    /// True if the latest layout is over the picture. Otherwise it follows with one of the next pictures, as does a picture that
    /// the window system refused.
    pub settled: bool,
    /// From the finished picture to the presented one, ms.
    pub ms: f64,
    /// From the call of [`Framebuffer::prepare`] to the finished picture, ms.
    pub traced_ms: f64,
}

impl Framebuffer {
    /// Opens a window and requests its first picture.
    ///
    /// # Errors
    /// Returns status 1 if the system cannot open one.
    pub(crate) fn open(events: &ActiveEventLoop, attributes: WindowAttributes) -> Result<Self> {
        Ok(Self {
            screen: Screen::open(events, attributes)?,
            painter: Painter::new()?,
            next: None,
            slices: Vec::new(),
            beside: Vec::new(),
            presented: None,
            refused: None,
        })
    }

    /// Removes the slices and all beside them: they belong to a scan that is closed, or not worked in any more.
    pub(crate) fn forget_pictures(&mut self) {
        self.slices.clear();
        self.beside.clear();
    }

    /// Takes over a picture that is shown beside the flight's.
    pub(crate) fn show_beside(&mut self, which: Beside, picture: &Frame) {
        match self.beside.iter_mut().find(|b| b.0 == which) {
            Some((_, kept)) => kept.show(picture),
            None => self.beside.push((which, picture.clone())),
        }
    }

    /// Returns the window.
    pub(crate) fn window(&self) -> Rc<Window> {
        Rc::clone(&self.screen.window)
    }

    /// Sets the layout over the next presented picture. Pass every layout, in order, to this method or to
    /// [`Framebuffer::show_alone`].
    pub(crate) fn prepare(&mut self, layout: &Arc<Layout>, places: Places) {
        self.painter.prepare(layout);
        self.slices.retain(|s| places.slices.iter().any(|p| p.0 == s.0));
        self.next = Some((places, Instant::now()));
    }

    /// Shows a layout without pictures below.
    ///
    /// # Errors
    /// Returns status 1 if the display is lost.
    pub(crate) fn show_alone(&mut self, layout: &Arc<Layout>) -> Result<PresentResult> {
        self.painter.prepare(layout);
        self.show(&[])
    }

    /// Shows the layout that was prepared last, with the slices, if no picture of the flight took it: for scenes whose renderer or
    /// presentation is that of a plug-in that shows none. Returns true if so.
    pub(crate) fn show_without_flight(&mut self) -> bool {
        let Some((places, _)) = self.next.take() else { return false };
        self.show_at(&Places { flight: None, ..places }, None);
        true
    }

    /// Takes the result of the last presentation; `None` if there was none.
    pub(crate) fn take_presented(&mut self) -> Option<Result<PresentResult>> {
        self.presented.take()
    }

    /// Takes the reason why the window system refused a picture, since the last call; `None` if it showed all.
    pub(crate) fn take_refused(&mut self) -> Option<String> {
        self.refused.take()
    }

    /// Shows the layout over the flight's picture, with the time that it took, and the slices.
    fn show_at(&mut self, places: &Places, picture: Option<(&Frame, f64)>) {
        // Taken out while shown, since the presentation borrows the rest of `self`.
        let slices = std::mem::take(&mut self.slices);
        let flight = places.flight.zip(picture).map(|(at, (frame, _))| Placed { at, frame });
        let beside = std::mem::take(&mut self.beside);
        let mut placed: Vec<Placed<'_>> = flight.into_iter().collect();
        placed.extend(slices.iter().filter_map(|(entity, frame)| {
            let at = places.slices.iter().find(|p| p.0 == *entity)?.1;
            Some(Placed { at, frame })
        }));
        placed.extend(beside.iter().filter_map(|(which, frame)| {
            let at = places.beside.iter().find(|p| p.0 == *which)?.1;
            Some(Placed { at, frame })
        }));
        let shown = self.show(&placed);
        (self.slices, self.beside) = (slices, beside);
        let traced_ms = picture.map_or(0.0, |(_, ms)| ms);
        self.presented = Some(shown.map(|p| PresentResult { traced_ms, ..p }));
    }

    /// Shows the layout over `pictures`. A window without pixels shows nothing.
    ///
    /// # Errors
    /// Returns status 1 if the display is lost.
    fn show(&mut self, pictures: &[Placed<'_>]) -> Result<PresentResult> {
        let begun = Instant::now();
        let Some(size) = self.screen.size() else {
            return Ok(PresentResult { settled: true, ms: 0.0, traced_ms: 0.0 });
        };
        let shown = self.screen.show(size, |surface| self.painter.paint(size, pictures, surface))?;
        let settled = shown.unwrap_or_else(|why| {
            self.refused = Some(why);
            false
        });
        Ok(PresentResult { settled, ms: begun.elapsed().as_secs_f64() * 1e3, traced_ms: 0.0 })
    }
}

impl Presenter for Framebuffer {
    fn name(&self) -> &'static str {
        "window"
    }

    fn present(&mut self, picture: &Picture) {
        if let Some((places, since)) = self.next.take() {
            let traced_ms = since.elapsed().as_secs_f64() * 1e3;
            self.show_at(&places, Some((&picture.frame, traced_ms)));
        }
    }

    fn beside(&mut self, slice: Entity, frame: &Frame) {
        match self.slices.iter_mut().find(|s| s.0 == slice) {
            Some((_, kept)) => kept.show(frame),
            None => self.slices.push((slice, frame.clone())),
        }
    }
}
