//! The overlays of a window, and which of them are shown.

use crate::app::overlay::{Canvas, Mark};
use crate::app::{FlightApp, Overlay};
use crate::error::{Error, Result};

/// Height of the bar and the text lines that [`flight`](super::overlay::flight) draws over the picture's lower edge, points. This
/// is the height in a narrow window, where it is largest, so that overlays do not jump as the window's size changes.
const FOOT: f32 = 80.0;

/// Overlays and their visibility.
#[derive(Clone, Debug, Default)]
pub(crate) struct Overlays {
    all: Vec<Overlay>,
    /// In which of its ways each is shown.
    shown: Vec<Option<usize>>,
}

impl Overlays {
    /// Creates the list with the initial visibility of each overlay.
    ///
    /// # Errors
    /// Returns the error of an overlay that cannot be shown in the flight.
    pub(crate) fn new(all: Vec<Overlay>, flight: &mut FlightApp) -> Result<Self> {
        let shown: Vec<_> = all.iter().map(|o| o.shown.then_some(0)).collect();
        for (overlay, way) in all.iter().zip(&shown).filter(|o| o.1.is_some()) {
            overlay.switch(flight, *way)?;
        }
        Ok(Self { all, shown })
    }

    /// Goes on to the next of the ways in which an overlay is shown, by its number, or hides it. Returns what to tell.
    ///
    /// # Errors
    /// Returns the error of an overlay that cannot be shown in the flight. It is hidden.
    pub(crate) fn switch(&mut self, number: usize, flight: &mut FlightApp) -> Result<Option<String>> {
        let (Some(overlay), Some(shown)) = (self.all.get(number), self.shown.get_mut(number)) else { return Ok(None) };
        let next = shown.map_or(0, |way| way + 1);
        *shown = (next < overlay.ways.len().max(1)).then_some(next);
        let (way, done) = (*shown, overlay.switch(flight, *shown));
        if done.is_err() {
            *shown = None;
        }
        let told = || way.map_or("hidden", |way| overlay.ways[way]);
        done.map(|()| (!overlay.ways.is_empty()).then(|| format!("{}: {}", overlay.name, told())))
    }

    /// True if the overlay of that name is shown.
    pub(crate) fn is_shown(&self, name: &str) -> bool {
        self.all.iter().zip(&self.shown).any(|(o, shown)| o.name == name && shown.is_some())
    }

    /// Shows what is shown anew, because what it shows has become known.
    pub(crate) fn refresh(&mut self, flight: &mut FlightApp) {
        for (overlay, shown) in self.all.iter().zip(&mut self.shown).filter(|o| o.1.is_some()) {
            if overlay.switch(flight, *shown).is_err() {
                *shown = None;
            }
        }
    }

    /// Returns the marks of the visible overlays, on a screen of `scale` pixels per point. Does nothing if none is visible. An
    /// overlay that panics is hidden, and its error returned.
    pub(crate) fn draw(&mut self, flight: &FlightApp, scale: f32) -> (Vec<Mark>, Option<Error>) {
        let Some(view) = flight.view().filter(|_| self.shown.iter().any(Option::is_some)) else {
            return (Vec::new(), None);
        };
        let mut canvas = Canvas::at_scale(view, scale).with_foot(FOOT);
        let mut fault = None;
        for (overlay, shown) in self.all.iter().zip(&mut self.shown).filter(|o| o.1.is_some()) {
            if let Err(e) = canvas.draw(overlay, flight) {
                *shown = None;
                fault = Some(e);
            }
        }
        (canvas.into_marks(), fault)
    }
}

#[cfg(test)]
mod tests {
    use egui::{Context, LayerId, Pos2, RawInput, Rect, Shape, Vec2};

    use super::*;
    use crate::host::window::directions::Directions;
    use crate::host::window::overlay::{self, HudState};
    use crate::host::window::style::Severity;

    /// Returns the height that text covers across the whole lower edge of a picture without marks, points.
    fn foot(size: Vec2) -> f32 {
        let hud = HudState {
            state: String::new(),
            severity: Severity::Normal,
            more: Vec::new(),
            figures: Vec::new(),
            directions: Directions::default(),
            bar: crate::host::window::place::Bar::default(),
            place: "place".to_owned(),
            message: None,
            keys: String::new(),
            marks_drawn: Vec::new(),
        };
        let area = Rect::from_min_size(Pos2::ZERO, size);
        let input = RawInput { screen_rect: Some(area), ..RawInput::default() };
        let output = Context::default().run_ui(input, |ui| {
            overlay::flight(&ui.ctx().layer_painter(LayerId::background()), area, &hud, false);
        });
        let spans = |shape: &Shape| match shape {
            Shape::Rect(r) if r.rect.width() == area.width() && r.rect.max.y == area.max.y => Some(r.rect.height()),
            _ => None,
        };
        output.shapes.iter().find_map(|s| spans(&s.shape)).expect("a foot")
    }

    #[test]
    fn overlays_keep_off_the_foot() {
        for size in [[300.0, 200.0], [420.0, 300.0], [640.0, 480.0], [1280.0, 720.0], [3840.0, 2160.0]] {
            let foot = foot(Vec2::from(size));
            assert!((30.0..=FOOT).contains(&foot), "{foot} points at {size:?}");
        }
    }
}
