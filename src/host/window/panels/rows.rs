//! Rows of a list: each is chosen by a click, or by Enter or Space once Tab has led to it.

use std::hash::Hash;

use egui::{Color32, Rect, Response, Sense, Stroke, StrokeKind, Ui, WidgetInfo, WidgetType, vec2};

use crate::host::window::style::ACCENT;

/// Background of the row that is chosen, and of the one under the pointer.
const CHOSEN: Color32 = Color32::from_rgb(38, 62, 84);
const HOVERED: Color32 = Color32::from_gray(45);
const ROUND: f32 = 4.0;

/// Lays out an empty row as wide as the list, `height` points high. `id` stays that of the thing it tells of, wherever in the list it
/// is, and `name` says what that is. Its ground shows whether it is chosen, under the pointer, or has the keyboard.
pub(super) fn row(ui: &mut Ui, height: f32, id: impl Hash, name: &str, is_chosen: bool) -> (Rect, Response) {
    let (_, rect) = ui.allocate_space(vec2(ui.available_width(), height));
    let row = ui.interact(rect, ui.id().with(("row", id)), Sense::click());
    row.widget_info(|| WidgetInfo::selected(WidgetType::SelectableLabel, true, is_chosen, name));
    if row.gained_focus() {
        row.scroll_to_me(None);
    }
    let p = ui.painter_at(rect);
    if is_chosen {
        p.rect_filled(rect, ROUND, CHOSEN);
    } else if row.hovered() {
        p.rect_filled(rect, ROUND, HOVERED);
    }
    if row.has_focus() {
        p.rect_stroke(rect, ROUND, Stroke::new(2.0, ACCENT), StrokeKind::Inside);
    }
    (rect, row)
}

#[cfg(test)]
mod tests {
    use egui::{Context, Event, Key, Modifiers, Pos2, RawInput};

    use super::*;

    /// Lays out three rows after a key; returns the row that was chosen and the outlined ones.
    fn after(context: &Context, key: Option<Key>) -> (Option<usize>, usize) {
        let press =
            |key| Event::Key { key, physical_key: None, pressed: true, repeat: false, modifiers: Modifiers::NONE };
        let area = Rect::from_min_size(Pos2::ZERO, vec2(200.0, 100.0));
        let input =
            RawInput { screen_rect: Some(area), events: key.map(press).into_iter().collect(), ..RawInput::default() };
        let mut chosen = None;
        let output = context.run_ui(input, |ui| {
            for n in 0..3 {
                if row(ui, 20.0, n, "a row", false).1.clicked() {
                    chosen = Some(n);
                }
            }
        });
        let outlined =
            |s: &&egui::epaint::ClippedShape| matches!(&s.shape, egui::Shape::Rect(r) if r.stroke.width == 2.0);
        (chosen, output.shapes.iter().filter(outlined).count())
    }

    #[test]
    fn a_row_is_reached_by_tab_outlined_and_chosen_by_enter_or_space() {
        let context = Context::default();
        assert_eq!(after(&context, None), (None, 0));
        for (key, n) in [(Key::Enter, 0), (Key::Space, 1)] {
            after(&context, Some(Key::Tab));
            assert_eq!(after(&context, None), (None, 1));
            assert_eq!(after(&context, Some(key)).0, Some(n));
        }
    }
}
