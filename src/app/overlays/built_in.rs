//! The list of overlays of this crate, and the drawing of any overlay.

use std::time::Instant;

use super::{coats, forces, gaps, mines, tentacles, translucency};
use crate::error::{Error, Result};
use crate::schedule::book_time;
use crate::{Canvas, FlightApp, Overlay, panics};

/// All overlays of this crate.
pub const BUILT_IN: [Overlay; 6] =
    [tentacles::OVERLAY, mines::OVERLAY, forces::OVERLAY, gaps::OVERLAY, translucency::OVERLAY, coats::OVERLAY];

impl Overlay {
    /// Shows it in a flight in one of its [ways](Overlay::ways), counted from 0, or hides it with `None`. Call it before its marks are drawn.
    ///
    /// # Errors
    /// Returns its own error, or status 1 if it panics.
    pub fn switch(&self, flight: &mut FlightApp, way: Option<usize>) -> Result<()> {
        let Some(switch) = self.switch else { return Ok(()) };
        let switched = panics::catch(|| switch(flight, self.options, way));
        switched.unwrap_or_else(|why| {
            Err(Error::fault(format!("overlay {}", self.name), format!("panicked: {why}"), "fix it, or hide it"))
        })
    }
}

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
