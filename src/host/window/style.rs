//! How the window writes: sizes, colours, and texts that occur in several places.

use egui::{Align2, Color32, FontId, Painter, Pos2, Rect, vec2};

/// Always shown.
pub(crate) const DISCLAIMER: &str = "Research software. Not for diagnosis.";
/// Size of text, points.
pub(crate) const TEXT: f32 = 14.0;
/// Size of the letters of directions, points.
pub(crate) const LABEL: f32 = 20.0;
/// Colour of text.
pub(crate) const INK: Color32 = Color32::from_rgb(240, 240, 240);
/// Colour of secondary text.
pub(crate) const SOFT: Color32 = Color32::from_rgb(190, 196, 204);
/// Colour of highlights.
pub(crate) const ACCENT: Color32 = Color32::from_rgb(96, 190, 255);
/// Colour of what the patient's other position lets expect.
pub(crate) const EXPECTED: Color32 = Color32::from_rgb(214, 160, 255);

/// The urgency of a state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Severity {
    /// The flight runs automatically.
    #[default]
    Normal,
    /// The operator has paused it or taken control.
    Notice,
    /// The operator has to act.
    Alert,
}

impl Severity {
    /// Returns its colour.
    pub(crate) fn colour(self) -> Color32 {
        match self {
            Self::Normal => Color32::from_rgb(120, 220, 140),
            Self::Notice => Color32::from_rgb(255, 214, 102),
            Self::Alert => Color32::from_rgb(255, 128, 112),
        }
    }
}

/// Returns the font of texts of a size in points.
pub(crate) fn font(size: f32) -> FontId {
    FontId::proportional(size)
}

/// Draws text and returns its rectangle.
pub(crate) fn text(p: &Painter, at: Pos2, align: Align2, text: &str, size: f32, colour: Color32) -> Rect {
    p.text(at, align, text, font(size), colour)
}

/// Draws the letters of a direction.
pub(crate) fn label(p: &Painter, at: Pos2, align: Align2, name: &str) {
    if name.is_empty() {
        return;
    }
    let size = p.layout_no_wrap(name.to_owned(), font(LABEL), INK).size();
    let rect = align.anchor_size(at, size + vec2(12.0, 2.0));
    p.rect_filled(rect, 4.0, Color32::from_black_alpha(120));
    text(p, rect.center(), Align2::CENTER_CENTER, name, LABEL, Color32::from_rgb(255, 236, 150));
}

/// Formats a view angle: "74.4°".
pub(crate) fn angle(degrees: f64) -> String {
    format!("{}°", (degrees * 10.0).round() / 10.0)
}
