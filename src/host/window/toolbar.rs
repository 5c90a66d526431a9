//! The row of buttons for what a reader does all the time.

use egui::{Align, Button, Label, Layout, RichText, Ui};
use egui_phosphor::regular as icon;

use super::actions::{Effect, WindowRequest};
use super::overlay::SOFT;
use super::panels::{Context, Requests};

/// Below this width of the window the buttons have no names, points.
const NAMED: f32 = 940.0;
/// Size of icons, points.
const ICON: f32 = 18.0;

/// A button: its icon, its name and the id of its action.
type Tool = (&'static str, &'static str, &'static str);

/// The buttons, in groups.
const TOOLS: &[&[Tool]] = &[
    &[
        (icon::PAUSE, "Pause", "pause"),
        (icon::PATH, "Whole colon", "whole"),
        (icon::ARROW_U_UP_LEFT, "Turn round", "reverse"),
        (icon::REWIND, "", "slower"),
        (icon::FAST_FORWARD, "", "faster"),
    ],
    &[
        (icon::DROP, "Tag", "tag"),
        (icon::PAINT_BRUSH, "Not seen", "unseen"),
        (icon::SKIP_FORWARD, "Next missed", "missed-next"),
    ],
    &[
        (icon::TARGET, "Next candidate", "candidate-next"),
        (icon::CROSSHAIR, "Lesion", "measure-lesion"),
        (icon::RULER, "Distance", "measure"),
    ],
];

/// Lays the buttons out in a row, and the choice of the layout at its end.
pub(crate) fn ui(context: &Context<'_>, ui: &mut Ui, requests: &mut Requests) {
    let is_named = ui.available_width() >= NAMED;
    ui.horizontal(|ui| {
        for (n, group) in TOOLS.iter().enumerate() {
            if n > 0 {
                ui.separator();
            }
            for tool in *group {
                button(context, ui, requests, tool, is_named);
            }
        }
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            button(context, ui, requests, &(icon::QUESTION, "", "help"), is_named);
            ui.menu_button(RichText::new(icon::LAYOUT).size(ICON), |ui| {
                for action in context.actions.of_menu("layout-") {
                    if ui.add(Button::new(action.title()).shortcut_text(action.key_text())).clicked() {
                        requests.action(&action.id);
                    }
                }
            });
            ui.separator();
            let hud = context.hud;
            ui.label(RichText::new(&hud.state).color(hud.severity.colour()).strong());
            // The rest of the row: a long name is cut off, and whole in its tooltip.
            let name = context.scan_name();
            ui.add(Label::new(RichText::new(name.as_ref()).color(SOFT)).truncate()).on_hover_text(name.as_ref());
        });
    });
}

fn button(context: &Context<'_>, ui: &mut Ui, requests: &mut Requests, &(icon, name, id): &Tool, is_named: bool) {
    let Some(action) = context.actions.named(id) else { return };
    let is_on = context.controller.is_on(id);
    let icon = if id == "pause" && is_on { icon::PLAY } else { icon };
    let name = if id == "pause" && is_on { "Go on" } else { name };
    let icon = RichText::new(icon).size(ICON);
    let shown = if is_named && !name.is_empty() { Button::new((icon, name)) } else { Button::new(icon) };
    // Painting the wall and the like stay on until they are pressed again.
    let is_window = matches!(action.effect, Effect::Window(WindowRequest::Seen));
    let shown = shown.selected(is_on || is_window && context.seen().is_painted());
    let why_not = context.why_not(action);
    let response = ui.add_enabled(why_not.is_none(), shown);
    if response.on_hover_text(context.tip(id)).on_disabled_hover_text(why_not.unwrap_or_default()).clicked() {
        requests.action(id);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::host::window::actions::{Actions, KeySettings};

    #[test]
    fn every_button_is_that_of_an_action() {
        let catalog = crate::app::Catalog::default();
        let (guides, panels) = (crate::systems::guides(), crate::host::window::panels::BUILT_IN);
        let actions = Actions::of(&guides, &catalog.overlays, panels, &[], &KeySettings::new()).unwrap();
        for (_, _, id) in TOOLS.concat() {
            assert!(actions.named(id).is_some(), "{id}");
        }
    }
}
