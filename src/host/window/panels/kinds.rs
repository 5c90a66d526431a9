//! The panel of the kinds of gas: the legend of the colours in the slices, and the choices for the body that was clicked on.

use egui::{Button, Color32, RichText, ScrollArea, Sense, Ui, vec2};

use super::{Context, Panel, PanelEntry, Requests};
use crate::fields::lumen::GasKind;
use crate::host::window::intent::Intent;
use crate::host::window::kinds::{CHOICES, Kinds, LEGEND, colour, name};
use crate::host::window::style::{SOFT, Severity};

/// Its entry in the table.
pub const PANEL: PanelEntry =
    PanelEntry { name: "kinds", title: "Kinds of gas", make: || Box::new(KindsPanel), ..PanelEntry::NONE };

/// Side of a colour of the legend, points.
const SWATCH: f32 = 14.0;

struct KindsPanel;

impl Panel for KindsPanel {
    fn ui(&mut self, context: &Context<'_>, ui: &mut Ui, requests: &mut Requests) {
        let kinds = context.kinds();
        ScrollArea::vertical().show(ui, |ui| {
            context.button(
                ui,
                if kinds.is_shown() { "Hide the colours" } else { "Show in the slices" },
                "kinds",
                requests,
            );
            if !kinds.is_shown() {
                ui.label(RichText::new("Each body of gas gets the colour of its kind.").color(SOFT));
            }
            match kinds.state() {
                Some(Ok(stage)) => {
                    let stage = if stage.is_empty() { "finding the kinds of gas" } else { &stage };
                    ui.label(format!("{stage} ..."));
                }
                Some(Err(why)) => {
                    ui.label(RichText::new(why).color(Severity::Alert.colour()));
                }
                None => {}
            }
            if kinds.is_shown() {
                legend(kinds, ui);
                ui.separator();
                chosen(context, kinds, ui, requests);
            }
        });
    }
}

/// Lays out a colour with words beside it.
fn swatch(kind: GasKind, words: &str, ui: &mut Ui) {
    ui.horizontal_wrapped(|ui| {
        let (rect, _) = ui.allocate_exact_size(vec2(SWATCH, SWATCH), Sense::hover());
        let [r, g, b] = colour(kind).unwrap_or_default();
        ui.painter().rect_filled(rect, 2.0, Color32::from_rgb(r, g, b));
        ui.label(words);
    });
}

fn legend(kinds: &Kinds, ui: &mut Ui) {
    let volumes = kinds.volumes();
    for (kind, _) in LEGEND {
        let ml = volumes.map(|ml| ml[kind.number()]);
        // A volume of less than a millilitre is noise.
        let ml = ml.map_or_else(String::new, |ml| if ml < 0.5 { "  none".to_owned() } else { format!("  {ml:.0} ml") });
        swatch(kind, &format!("{}{ml}", name(kind)), ui);
    }
}

fn chosen(context: &Context<'_>, kinds: &Kinds, ui: &mut Ui, requests: &mut Requests) {
    let Some((_, body)) = kinds.chosen_body() else {
        ui.label(RichText::new("Click on a body of gas in a slice to see why, and to change its kind.").color(SOFT));
        return;
    };
    swatch(body.kind, &format!("{}, {:.0} ml", name(body.kind), body.ml), ui);
    ui.label(RichText::new(body.why).color(SOFT));
    ui.label("Change its kind:");
    ui.horizontal_wrapped(|ui| {
        for (kind, text, id) in CHOICES {
            let action = context.actions.named(id);
            let tip = action.map_or_else(String::new, |a| format!("{} ({})", a.title(), a.key_text()));
            let is_so = kind == Some(body.kind) && body.is_told;
            let is_possible = kind.is_some() || body.is_told;
            if ui.add_enabled(is_possible, Button::new(text).selected(is_so)).on_hover_text(tip).clicked() {
                requests.ask(Intent::Kind(kind));
            }
        }
    });
}
