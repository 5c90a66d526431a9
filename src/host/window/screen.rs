//! A window with its pixel surface.

use std::rc::Rc;

use softbuffer::{Context, Surface};
use winit::event_loop::{ActiveEventLoop, OwnedDisplayHandle};
use winit::window::{Window, WindowAttributes};

use crate::error::{Error, Result};

/// An open window with its surface.
pub(crate) struct Screen {
    /// The window.
    pub window: Rc<Window>,
    /// Its pixels.
    pub surface: Surface<OwnedDisplayHandle, Rc<Window>>,
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
            let surface = Surface::new(&context, Rc::clone(&window)).map_err(|e| e.to_string())?;
            window.request_redraw();
            Ok(Self { window, surface })
        });
        made.map_err(|why| Error::fault("window", why, "use --headless"))
    }
}
