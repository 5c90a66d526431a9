//! What the patient's other position lets expect, drawn into a view: a stretch of the wall, not a point.

use egui::{Align2, Color32, Painter, Stroke};

use super::Context;
use super::candidates::Marking;
use crate::host::window::style::{EXPECTED, TEXT, text};

/// Draws the stretches in which findings and marked candidates of the other position are expected here.
pub(super) fn draw(context: &Context<'_>, p: &Painter, view: &Marking<'_>) {
    for expected in context.expected() {
        let mut before = None;
        for &point in &expected.stretch {
            let at = (view.find)(point);
            if let (Some(from), Some(to)) = (before, at) {
                for (colour, width) in [(Color32::BLACK, 4.0), (EXPECTED, 2.0)] {
                    p.line_segment([from, to], Stroke::new(width, colour));
                }
            }
            before = at;
        }
        let Some(at) = (view.find)(expected.place) else { continue };
        for (colour, width) in [(Color32::BLACK, 4.0), (EXPECTED, 2.0)] {
            p.circle_stroke(at, 4.0, Stroke::new(width, colour));
        }
        let about = if expected.is_gap { ", collapsed: a guess" } else { "" };
        let words = format!("{} expected here, ± {:.0} mm{about}", expected.name, expected.uncertainty_mm.ceil());
        let at = at + egui::vec2(0.0, -8.0);
        let size = p.layout_no_wrap(words.clone(), egui::FontId::proportional(TEXT), EXPECTED).size();
        p.rect_filled(Align2::CENTER_BOTTOM.anchor_size(at, size).expand(2.0), 3.0, Color32::from_black_alpha(170));
        text(p, at, Align2::CENTER_BOTTOM, &words, TEXT, EXPECTED);
    }
}
