//! The quality panel: how well each segment of the colon can be read, what was seen of it, and how long it was looked at.

use egui::{Grid, RichText, ScrollArea, Ui};

use super::{Context, Panel, PanelEntry, Requests};
use crate::app::findings::{Quality, SegmentFacts};
use crate::host::window::intent::Intent;
use crate::host::window::quality::time_text;
use crate::host::window::style::{SOFT, Severity};

/// Its entry in the table.
pub const PANEL: PanelEntry =
    PanelEntry { name: "quality", title: "Quality", make: || Box::new(QualityPanel), ..PanelEntry::NONE };

struct QualityPanel;

impl Panel for QualityPanel {
    fn ui(&mut self, context: &Context<'_>, ui: &mut Ui, requests: &mut Requests) {
        let tool = context.view.quality();
        let Some(list) = tool.list(context.flight) else {
            match tool.failed() {
                Some(why) => ui.label(RichText::new(why).color(Severity::Alert.colour())),
                None => ui.label("measuring the segments of the colon ..."),
            };
            if tool.is_clock_alone() {
                requests.ask(Intent::Quality);
            }
            return;
        };
        if list.is_empty() {
            ui.label("The segments of the colon are not known, because no line leads from the rectum to the cecum.");
            return;
        }
        let here = context.view.segment_here();
        ScrollArea::both().auto_shrink([false, true]).show(ui, |ui| {
            Grid::new("quality").striped(true).min_col_width(24.0).spacing([6.0, 4.0]).show(ui, |ui| {
                let tips = [
                    ("", ""),
                    ("time", "how long it was looked at"),
                    ("seen", "share of the wall that was seen, once that is watched"),
                    ("distended", "share of the length with a caliber of 10 mm or more"),
                    ("least", "least caliber, mm; 0 where it is collapsed"),
                    ("tag", "share of the wall under tagged fluid or stool"),
                    ("residue", "tissue or untagged stool that touches no wall, ml"),
                    ("mm", "length along the colon, mm"),
                ];
                for (name, tip) in tips {
                    ui.label(RichText::new(name).color(SOFT)).on_hover_text(tip);
                }
                ui.end_row();
                for (quality, facts) in &list {
                    row(quality, facts, here == Some(quality.segment.as_str()), ui);
                }
            });
            ui.separator();
            for (_, facts) in list.iter().filter(|(q, _)| !q.adequate) {
                ui.label(RichText::new(format!("{}.", facts.why)).color(Severity::Notice.colour()));
            }
            let seconds: f64 = list.iter().map(|(q, _)| q.seconds).sum();
            ui.label(RichText::new(format!("{} in all", time_text(seconds))).color(SOFT));
        });
    }
}

/// Lays out a segment.
fn row(quality: &Quality, facts: &SegmentFacts, is_here: bool, ui: &mut Ui) {
    let name = RichText::new(&quality.segment);
    let name = if is_here { name.strong() } else { name };
    ui.label(if quality.adequate { name } else { name.color(Severity::Notice.colour()) });
    let percent = |share: f64| format!("{:.0} %", 100.0 * share);
    ui.label(time_text(quality.seconds));
    ui.label(quality.coverage.map_or_else(String::new, percent));
    ui.label(percent(quality.distended));
    ui.label(format!("{:.0}", quality.least_caliber_mm));
    ui.label(percent(quality.fluid));
    ui.label(facts.residue_ml.map_or_else(String::new, |ml| format!("{ml:.1}")));
    ui.label(format!("{:.0}", quality.length_mm));
    ui.end_row();
}
