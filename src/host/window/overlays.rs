//! The overlays of a window, and which of them are shown.

use crate::app::overlay::{Canvas, Mark};
use crate::app::{FlightApp, Overlay};
use crate::error::Error;

/// Height of the bar and the text lines that [`flight`](super::overlay::flight) draws over the picture's lower edge, points. This
/// is the height in a narrow window, where it is largest, so that overlays do not jump as the window's size changes.
const FOOT: f32 = 80.0;

/// Overlays and their visibility.
#[derive(Clone, Debug, Default)]
pub(crate) struct Overlays {
    all: Vec<Overlay>,
    shown: Vec<bool>,
}

impl Overlays {
    /// Creates the list with the initial visibility of each overlay.
    pub(crate) fn new(all: Vec<Overlay>) -> Self {
        let shown = all.iter().map(|o| o.shown).collect();
        Self { all, shown }
    }

    /// Shows or hides an overlay by its number.
    pub(crate) fn switch(&mut self, number: usize) {
        if let Some(shown) = self.shown.get_mut(number) {
            *shown = !*shown;
        }
    }

    /// Returns the marks of the visible overlays, on a screen of `scale` pixels per point. Does nothing if none is visible. An
    /// overlay that panics is hidden, and its error returned.
    pub(crate) fn draw(&mut self, flight: &FlightApp, scale: f32) -> (Vec<Mark>, Option<Error>) {
        let Some(view) = flight.view().filter(|_| self.shown.contains(&true)) else { return (Vec::new(), None) };
        let mut canvas = Canvas::at_scale(view, scale).with_foot(FOOT);
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
