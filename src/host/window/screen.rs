//! A window with its pixels.

use std::num::NonZeroU32;
use std::rc::Rc;

use softbuffer::{Context, SoftBufferError, Surface};
use winit::event_loop::{ActiveEventLoop, OwnedDisplayHandle};
use winit::window::{Window, WindowAttributes};

use super::x11::{XPixels, is_display_lost};
use crate::error::{Error, Result};
use crate::output;
use crate::render::ImageSize;

/// An open window with its pixels.
pub(crate) struct Screen {
    /// The window.
    pub window: Rc<Window>,
    pixels: Pixels,
    /// True if a failure was reported. Others are not: there may be one at each picture.
    reported: bool,
}

enum Pixels {
    /// In memory that the window system shares, where it can.
    Shared(Surface<OwnedDisplayHandle, Rc<Window>>),
    /// Sent to an X server, which softbuffer cannot do for every window.
    Sent(Box<XPixels>),
}

impl Screen {
    /// Opens a window and requests its first picture.
    ///
    /// # Errors
    /// Returns status 1 if the system cannot open one.
    pub(crate) fn open(events: &ActiveEventLoop, attributes: WindowAttributes) -> Result<Self> {
        let made = events.create_window(attributes).map_err(|e| e.to_string()).and_then(|window| {
            let window = Rc::new(window);
            let context = Context::new(events.owned_display_handle()).map_err(|e| e.to_string())?;
            let pixels = match Surface::new(&context, Rc::clone(&window)) {
                Ok(surface) => Pixels::Shared(surface),
                // Displays of 16 or 30 bits, for example.
                Err(e) => Pixels::Sent(Box::new(XPixels::open(&window).ok_or_else(|| e.to_string())??)),
            };
            window.request_redraw();
            Ok(Self { window, pixels, reported: false })
        });
        made.map_err(|why| Error::fault("window", why, "use --headless"))
    }

    /// Returns the window's size; `None` if it has no pixels, for example while it is minimised.
    pub(crate) fn size(&self) -> Option<ImageSize> {
        let size = self.window.inner_size();
        (size.width > 0 && size.height > 0).then(|| ImageSize::new(size.width as usize, size.height as usize))
    }

    /// Shows the `size` pixels of `0x00RRGGBB` that `paint` fills. It fills all of them, and may be called twice. Returns its
    /// result, or the reason if the window system refuses the picture: it may show the next one, so this does not end a flight.
    /// The first reason is printed.
    ///
    /// # Errors
    /// Returns status 1 if the display is lost.
    pub(crate) fn show<T>(
        &mut self,
        size: ImageSize,
        mut paint: impl FnMut(&mut [u32]) -> T,
    ) -> Result<std::result::Result<T, String>> {
        let window = &self.window;
        let shown = match &mut self.pixels {
            Pixels::Shared(surface) => show_shared(surface, window, size, &mut paint).or_else(|e| {
                // A frame beyond the X server's longest request, for example.
                let mut sent = XPixels::open(window).ok_or_else(|| e.to_string())??;
                let shown = sent.show(window, size, &mut paint)?;
                self.pixels = Pixels::Sent(Box::new(sent));
                Ok(shown)
            }),
            Pixels::Sent(sent) => sent.show(window, size, &mut paint).inspect_err(|_| {
                // The connection may be closed, and the display still there.
                if let Some(Ok(again)) = XPixels::open(window) {
                    **sent = again;
                }
            }),
        };
        if let Err(why) = &shown {
            if is_display_lost() {
                return Err(display_lost());
            }
            if !std::mem::replace(&mut self.reported, true) {
                output::to_stderr(format_args!("note: window: a picture could not be shown: {why}"));
            }
        }
        Ok(shown)
    }
}

/// Returns the error of a display that has gone while its window was open.
pub(super) fn display_lost() -> Error {
    Error::fault("window", "the display was lost", "start it again: a flight resumes where it was left")
}

/// Shows a picture in shared memory.
fn show_shared<T>(
    surface: &mut Surface<OwnedDisplayHandle, Rc<Window>>,
    window: &Window,
    size: ImageSize,
    paint: &mut impl FnMut(&mut [u32]) -> T,
) -> std::result::Result<T, SoftBufferError> {
    let edge = |n: usize| NonZeroU32::new(u32::try_from(n).unwrap_or(u32::MAX)).unwrap_or(NonZeroU32::MIN);
    surface.resize(edge(size.width), edge(size.height))?;
    let mut buffer = surface.buffer_mut()?;
    let painted = paint(&mut buffer);
    window.pre_present_notify();
    buffer.present().map(|()| painted)
}
