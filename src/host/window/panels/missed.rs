//! The panel of what was not seen: the share of the wall, and the patches that were missed.

use egui::{Align2, Color32, RichText, ScrollArea, Ui, vec2};

use super::{Context, Panel, PanelEntry, Requests, rows};
use crate::coverage::{LiveCoverage, Missed};
use crate::host::window::intent::{FindingOf, Intent};
use crate::host::window::style::{INK, SOFT, Severity, TEXT, text};

/// Its entry in the table.
pub const PANEL: PanelEntry =
    PanelEntry { name: "missed", title: "Wall not seen", make: || Box::<MissedPanel>::default(), ..PanelEntry::NONE };

/// Height of a row, points.
const ROW: f32 = 40.0;
/// Colour of a patch that was seen since it was listed.
const DONE: Color32 = Color32::from_rgb(130, 235, 140);

#[derive(Default)]
struct MissedPanel {
    /// The patch that the list was scrolled to.
    scrolled_to: Option<usize>,
}

impl Panel for MissedPanel {
    fn ui(&mut self, context: &Context<'_>, ui: &mut Ui, requests: &mut Requests) {
        let seen = context.seen();
        let coverage = context.flight.camera::<LiveCoverage>();
        let text = if seen.is_painted() { "Hide the paint" } else { "Paint what was not seen" };
        context.button(ui, text, "unseen", requests);
        match seen.state() {
            Some(Ok(what)) => {
                ui.label(format!("{what} ..."));
            }
            Some(Err(why)) => {
                ui.label(RichText::new(why).color(Severity::Alert.colour()));
            }
            None => {}
        }
        let Some(coverage) = coverage else {
            let told = "Measures which parts of the wall have been in the picture, from the start of the flight.";
            ui.label(RichText::new(told).color(SOFT));
            return;
        };
        ui.label(format!("{:.1} % of the wall seen", 100.0 * coverage.share()));
        ui.horizontal_wrapped(|ui| {
            context.button(ui, "Next missed", "missed-next", requests);
            let text = match (context.flight.tour(), seen.goes_to) {
                (None, _) => "Review all",
                (Some(_), None) => "End the review",
                (Some(_), Some(_)) => "Stop on the way",
            };
            context.button(ui, text, "review", requests);
            if let Some(n) = seen.current()
                && ui.button("Finding").on_hover_text("mark a finding at the chosen patch").clicked()
            {
                requests.ask(Intent::Finding(FindingOf::Missed(n)));
            }
            if ui.button("List again").on_hover_text("the patches not seen so far").clicked() {
                requests.ask(Intent::ListMissed);
            }
        });
        let Some(list) = seen.list() else { return };
        let cm2: f64 = list.iter().map(|m| m.area_mm2 / 100.0).sum();
        ui.label(RichText::new(format!("{} patches of 3 cm² or more, {cm2:.0} cm²", list.len())).color(SOFT));
        let here = seen.count_here(context.flight);
        if here < list.len() {
            let next = context.actions.hint("next", "flies to the next");
            let told = format!("{here} of {} in this segment, where the review flies{next}", list.len());
            ui.label(RichText::new(told).color(SOFT));
        }
        ui.separator();
        self.list(list, coverage, seen.current(), ui, requests);
    }
}

impl MissedPanel {
    fn list(
        &mut self,
        list: &[Missed],
        coverage: &LiveCoverage,
        current: Option<usize>,
        ui: &mut Ui,
        requests: &mut Requests,
    ) {
        let step = ROW + ui.spacing().item_spacing.y;
        let mut area = ScrollArea::vertical().auto_shrink(false);
        if let Some(n) = current.filter(|_| current != self.scrolled_to) {
            self.scrolled_to = Some(n);
            area = area.vertical_scroll_offset((n as f32 - 1.0).max(0.0) * step);
        }
        area.show_rows(ui, ROW, list.len(), |ui, rows| {
            for n in rows {
                let Some(patch) = list.get(n) else { continue };
                let name = format!("missed patch {}", n + 1);
                let (rect, row) = rows::row(ui, ROW, n, &name, current == Some(n));
                let p = ui.painter_at(rect);
                let at = rect.left_top() + vec2(6.0, 2.0);
                let head = format!("{}   {:.1} cm²", n + 1, patch.area_mm2 / 100.0);
                let head = text(&p, at, Align2::LEFT_TOP, &head, TEXT, INK);
                let share = coverage.share_of(&patch.triangles);
                if share > 0.01 {
                    let at = head.right_top() + vec2(10.0, 0.0);
                    let colour = if share > 0.5 { DONE } else { SOFT };
                    text(&p, at, Align2::LEFT_TOP, &format!("{:.0} % seen", 100.0 * share), TEXT, colour);
                }
                text(&p, head.left_bottom(), Align2::LEFT_TOP, &place(patch), TEXT, SOFT);
                if row.clicked() {
                    requests.ask(Intent::VisitMissed(n));
                }
            }
        });
    }
}

/// Returns where a patch is along the colon, and whether a camera fits in front of it.
pub(super) fn place(patch: &Missed) -> String {
    let place = patch.along.map_or_else(String::new, |along| along.text());
    match (patch.look_from, place.is_empty()) {
        (Some(_), _) => place,
        (None, true) => "too narrow to look at".to_owned(),
        (None, false) => format!("{place}, too narrow to look at"),
    }
}
