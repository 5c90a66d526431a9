//! The overlays that a window has, and which of them are shown.

use crate::app::overlay::{Canvas, Mark};
use crate::app::{FlightApp, Overlay};
use crate::error::Error;

/// Overlays, each shown or not.
#[derive(Clone, Debug, Default)]
pub struct Overlays {
    all: Vec<Overlay>,
    shown: Vec<bool>,
}

impl Overlays {
    /// As each says whether it is shown from the beginning.
    pub fn new(all: Vec<Overlay>) -> Self {
        let shown = all.iter().map(|o| o.shown).collect();
        Self { all, shown }
    }

    /// Shows or hides one, by its number.
    pub fn switch(&mut self, number: usize) {
        if let Some(shown) = self.shown.get_mut(number) {
            *shown = !*shown;
        }
    }

    /// What those draw that are shown, on a screen of `scale` pixels a point. Where none is, nothing is done. One that panics is
    /// hidden, and told of.
    pub fn draw(&mut self, flight: &FlightApp, scale: f32) -> (Vec<Mark>, Option<Error>) {
        let Some(view) = flight.view().filter(|_| self.shown.contains(&true)) else { return (Vec::new(), None) };
        let mut canvas = Canvas::at_scale(view, scale);
        let mut fault = None;
        for (overlay, shown) in self.all.iter().zip(&mut self.shown).filter(|o| *o.1) {
            if let Err(e) = canvas.draw(overlay, flight) {
                *shown = false;
                fault = Some(e);
            }
        }
        (canvas.into_marks(), fault)
    }
}
