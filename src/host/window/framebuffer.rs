//! The window's framebuffer: where a flight's pictures are presented, with what there is to say over them.

use std::num::NonZeroU32;
use std::rc::Rc;
use std::time::Instant;

use winit::event_loop::ActiveEventLoop;
use winit::window::{Window, WindowAttributes};

use super::overlay::Content;
use super::painter::Painter;
use super::screen::Screen;
use crate::components::output::Picture;
use crate::error::{Error, Result};
use crate::render::Frame;
use crate::systems::present::Presenter;

/// A window's pixels.
pub struct Framebuffer {
    screen: Screen,
    painter: Painter,
    /// What is to lie over the next picture that is presented; none while nothing is to be shown.
    next: Option<(Content, Picturing, Instant)>,
    presented: Option<Result<Presented>>,
}

/// What is shown below what there is to say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Picturing {
    /// The picture.
    Picture,
    /// Nothing: there is none yet.
    Nothing,
}

/// What came of a presentation.
#[derive(Clone, Copy, Debug)]
pub struct Presented {
    /// Whether what was to lie over the picture does; else it comes with one of the next.
    pub settled: bool,
    /// From the finished picture to the presented one, ms.
    pub ms: f64,
    /// From the call of [`Framebuffer::prepare`] to the finished picture, ms.
    pub traced_ms: f64,
}

impl Framebuffer {
    /// Opens a window and asks for its first picture.
    ///
    /// # Errors
    /// Status 1 when the system gives none.
    pub fn open(events: &ActiveEventLoop, attributes: WindowAttributes) -> Result<Self> {
        Ok(Self { screen: Screen::open(events, attributes)?, painter: Painter::new()?, next: None, presented: None })
    }

    /// The window.
    pub fn window(&self) -> Rc<Window> {
        Rc::clone(&self.screen.window)
    }

    /// Has `content` over the picture that is presented next.
    pub fn prepare(&mut self, content: Content, below: Picturing) {
        self.next = Some((content, below, Instant::now()));
    }

    /// What came of the last presentation; none if there was none.
    pub fn take_presented(&mut self) -> Option<Result<Presented>> {
        self.presented.take()
    }

    /// Shows `content` over `image`. A window without pixels shows nothing.
    ///
    /// # Errors
    /// Status 1 when the window system refuses.
    pub fn show(&mut self, image: Option<&Frame>, content: &Content) -> Result<Presented> {
        let begun = Instant::now();
        let size = self.screen.window.inner_size();
        let (Some(width), Some(height)) = (NonZeroU32::new(size.width), NonZeroU32::new(size.height)) else {
            return Ok(Presented { settled: true, ms: 0.0, traced_ms: 0.0 });
        };
        let mut show = || {
            self.screen.surface.resize(width, height)?;
            let scale = self.screen.window.scale_factor() as f32;
            let mut buffer = self.screen.surface.buffer_mut()?;
            let pixels = (size.width as usize, size.height as usize);
            let settled = self.painter.paint(pixels, scale, image, content, &mut buffer);
            self.screen.window.pre_present_notify();
            buffer.present().map(|()| settled)
        };
        let settled =
            show().map_err(|e: softbuffer::SoftBufferError| Error::fault("window", e.to_string(), "use --headless"))?;
        Ok(Presented { settled, ms: begun.elapsed().as_secs_f64() * 1e3, traced_ms: 0.0 })
    }
}

impl Presenter for Framebuffer {
    fn name(&self) -> &'static str {
        "window"
    }

    fn present(&mut self, picture: &Picture) {
        if let Some((content, below, since)) = self.next.take() {
            let traced_ms = since.elapsed().as_secs_f64() * 1e3;
            let image = (below == Picturing::Picture).then_some(&picture.frame);
            self.presented = Some(self.show(image, &content).map(|p| Presented { traced_ms, ..p }));
        }
    }
}
