//! The list of overlays of this crate, and the drawing of any overlay.

use std::time::Instant;

use super::{forces, gaps, mines, tentacles};
use crate::error::{Error, Result};
use crate::schedule::book_time;
use crate::{Canvas, FlightApp, Overlay, panics};

/// All overlays of this crate.
pub const BUILT_IN: [Overlay; 4] = [tentacles::OVERLAY, mines::OVERLAY, forces::OVERLAY, gaps::OVERLAY];

impl Canvas {
    /// Runs an overlay's drawing function. If it panics, its marks are removed.
    ///
    /// # Errors
    /// Returns status 1 if it panics.
    pub fn draw(&mut self, overlay: &Overlay, flight: &FlightApp) -> Result<()> {
        self.options = overlay.options;
        let (before, begun) = (self.marks.len(), Instant::now());
        let drawn = panics::catch(|| (overlay.draw)(flight, self));
        if BUILT_IN.iter().all(|o| o.name != overlay.name) {
            book_time(format!("overlay {}", overlay.name), begun.elapsed().as_secs_f64() * 1e3);
        }
        drawn.map_err(|why| {
            self.marks.truncate(before);
            Error::fault(format!("overlay {}", overlay.name), format!("panicked: {why}"), "fix it, or hide it")
        })
    }
}
