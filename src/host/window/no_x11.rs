//! Systems without X servers have no windows of theirs.

use winit::keyboard::KeyCode;
use winit::window::Window;

use super::stroke::Printing;

use crate::render::ImageSize;

/// The pixels of a window of an X server: none.
pub(crate) enum XPixels {}

impl XPixels {
    /// Returns `None`: no window is one of an X server.
    pub(crate) fn open(_: &Window) -> Option<Result<Self, String>> {
        None
    }

    /// Shows a picture.
    ///
    /// # Errors
    /// Never.
    pub(crate) fn show<T>(
        &mut self,
        _: &Window,
        _: ImageSize,
        _: &mut impl FnMut(&mut [u32]) -> T,
    ) -> Result<T, String> {
        match *self {}
    }
}

/// Returns `None`: no server tells what keys print.
pub(crate) fn printed(_: &Window) -> Option<Vec<(KeyCode, Printing)>> {
    None
}

/// Returns false: there is no display that could be lost.
pub(crate) fn is_display_lost() -> bool {
    false
}
