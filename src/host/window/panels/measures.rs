//! The measures panel: a list of measured distances, and their drawing in other panels.

use egui::{Align2, Color32, Painter, Pos2, ScrollArea, Stroke, Ui};
use glam::DVec3;

use super::{Context, Panel, PanelEntry, Requests};
use crate::host::window::intent::{FindingOf, Intent};
use crate::host::window::measures::Measure;
use crate::host::window::style::{INK, SOFT, TEXT, text};

/// Its entry in the table.
pub const PANEL: PanelEntry =
    PanelEntry { name: "measures", title: "Distances", make: || Box::new(MeasuresPanel), ..PanelEntry::NONE };

/// Colour of measures. It is distinguishable from the crosshair's yellow and the camera's blue, even without perception of red or
/// green.
const COLOUR: Color32 = Color32::from_rgb(255, 255, 255);

/// What slices show of a distance that is gone to, as a multiple of its length.
const AROUND: f64 = 1.5;

struct MeasuresPanel;

impl Panel for MeasuresPanel {
    fn ui(&mut self, context: &Context<'_>, ui: &mut Ui, requests: &mut Requests) {
        let measures = context.measures();
        ui.horizontal(|ui| {
            let text = if measures.is_on() { "Stop measuring" } else { "Measure" };
            context.button(ui, text, "measure", requests);
            context.button(ui, "Undo", "undo", requests);
        });
        let hint = match (measures.is_on(), measures.begun()) {
            (true, None) => "Click the first end, in the flight or in a slice.",
            (true, Some(_)) => "Click the other end.",
            (false, _) if measures.list().is_empty() => "No distances yet.",
            (false, _) => "",
        };
        ui.label(egui::RichText::new(hint).color(SOFT));
        ScrollArea::vertical().show(ui, |ui| {
            for (n, m) in measures.list().iter().enumerate() {
                ui.horizontal(|ui| {
                    if ui.button("Delete").on_hover_text("delete this distance").clicked() {
                        requests.ask(Intent::DeleteMeasure(n));
                    }
                    if ui.button("Finding").on_hover_text("mark a finding of this diameter").clicked() {
                        requests.ask(Intent::Finding(FindingOf::Distance(n)));
                    }
                    let name = format!("{}.  {}", n + 1, m.text());
                    if ui.button(name).on_hover_text("show it in the slices").clicked() {
                        requests.go_to(m.from.midpoint(m.to), AROUND * m.mm());
                    }
                });
            }
        });
    }
}

/// Draws the measures into a view. `find` returns the position of a point (world, mm) in the view, if it is visible.
pub fn draw(context: &Context<'_>, p: &Painter, find: impl Fn(DVec3) -> Option<Pos2>) {
    let measures = context.measures();
    // That of a finding is drawn as its diameter.
    let is_diameter = |m: &&Measure| context.found().findings.iter().any(|f| f.ends == Some((**m).into()));
    for (n, m) in measures.list().iter().enumerate().filter(|(_, m)| !is_diameter(m)) {
        let ends = [m.from, m.to].map(&find);
        for end in ends.into_iter().flatten() {
            mark(p, end);
        }
        if let [Some(from), Some(to)] = ends {
            for (colour, width) in [(Color32::BLACK, 3.5), (COLOUR, 1.5)] {
                p.line_segment([from, to], Stroke::new(width, colour));
            }
            let at = from.lerp(to, 0.5) - egui::vec2(0.0, 6.0);
            let words = format!("{}: {}", n + 1, m.text());
            let size = p.layout_no_wrap(words.clone(), egui::FontId::proportional(TEXT), INK).size();
            p.rect_filled(Align2::CENTER_BOTTOM.anchor_size(at, size).expand(2.0), 3.0, Color32::from_black_alpha(170));
            text(p, at, Align2::CENTER_BOTTOM, &words, TEXT, INK);
        }
    }
    if let Some(at) = measures.begun().and_then(find) {
        mark(p, at);
    }
}

fn mark(p: &Painter, at: Pos2) {
    for (colour, width) in [(Color32::BLACK, 3.0), (COLOUR, 1.5)] {
        p.circle_stroke(at, 4.0, Stroke::new(width, colour));
    }
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use egui::{LayerId, RawInput, Rect, Shape, pos2, vec2};

    use super::*;
    use crate::host::settings::KeySettings;
    use crate::host::window::action::Actions;
    use crate::host::window::contract::WindowView;
    use crate::host::window::controller::FlightController;
    use crate::host::window::controller::tests::{controller, perform, wish};
    use crate::host::window::intent::SliceInput;
    use crate::host::window::overlay::HudState;

    #[test]
    fn measures_are_drawn_between_the_ends_that_are_visible() {
        let (mut c, now) = (controller("manual"), Instant::now());
        let actions = Actions::new(&c.flight().setup().scene.guides, &[], &[], &KeySettings::new()).unwrap();
        perform(&mut c, "measure", now);
        // A distance of 5 mm in view, one with an end behind it, and one that is begun.
        for place in [[40.0, 50.0, 1.0], [43.0, 54.0, 1.0], [80.0, 50.0, 1.0], [80.0, 60.0, 9.0], [120.0, 70.0, 1.0]] {
            c.slice(SliceInput::Click(DVec3::from_array(place)), now);
        }
        let hud = HudState::default();
        let area = Rect::from_min_size(Pos2::ZERO, vec2(200.0, 100.0));
        let input = RawInput { screen_rect: Some(area), ..RawInput::default() };
        let drawn = |c: &FlightController| {
            egui::Context::default().run_ui(input.clone(), |ui| {
                let p = ui.ctx().layer_painter(LayerId::background());
                let find = |place: DVec3| (place.z < 5.0).then(|| pos2(place.x as f32, place.y as f32));
                draw(&Context::new(c, &actions, &[], &hud), &p, find);
            })
        };
        let (mut lines, mut texts, mut rings) = (Vec::new(), Vec::new(), Vec::new());
        for shape in drawn(&c).shapes {
            match shape.shape {
                Shape::LineSegment { points, stroke } => lines.push((points, stroke.color)),
                Shape::Text(text) => texts.push(text.galley.text().to_owned()),
                Shape::Circle(ring) => rings.push((ring.center, ring.stroke.color)),
                _ => {}
            }
        }
        let ends = [pos2(40.0, 50.0), pos2(43.0, 54.0)];
        assert_eq!(lines, [(ends, Color32::BLACK), (ends, COLOUR)]);
        assert_eq!(texts, ["1: 5.0 mm"]);
        let marked = [ends[0], ends[1], pos2(80.0, 50.0), pos2(120.0, 70.0)];
        assert_eq!(rings, marked.map(|at| [(at, Color32::BLACK), (at, COLOUR)]).concat());
        // The diameter of a finding is drawn with that.
        wish(&mut c, Intent::Finding(FindingOf::Distance(0)), now);
        assert!(drawn(&c).shapes.iter().all(|s| !matches!(s.shape, Shape::LineSegment { .. })));
    }
}
