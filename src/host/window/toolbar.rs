//! The row of buttons for what a reader does all the time.

use egui::{Align, Button, FontId, Label, Layout, RichText, TextStyle, Ui};
use egui_phosphor::regular as icon;

use super::contract::{Context, Requests};
use super::style::SOFT;

/// Width beside the buttons that is left for the state, the name of the scan and the choice of the layout, points.
const STATE: f32 = 230.0;
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
    // Names are left out where the state would cover them.
    let is_named = width_named(ui) + STATE <= ui.available_width();
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

/// Returns the width of all buttons with their names, points.
fn width_named(ui: &Ui) -> f32 {
    let (space, style) = (ui.spacing(), TextStyle::Button.resolve(ui.style()));
    let width = |text: &str, font: FontId| ui.painter().layout_no_wrap(text.to_owned(), font, SOFT).size().x;
    let tool = |&(icon, name, _): &Tool| {
        let icon = width(icon, FontId::new(ICON, style.family.clone()));
        let name = if name.is_empty() { 0.0 } else { space.icon_spacing + width(name, style.clone()) };
        icon + name + 2.0 * space.button_padding.x + space.item_spacing.x
    };
    let separators = TOOLS.len().saturating_sub(1) as f32 * (6.0 + space.item_spacing.x);
    TOOLS.iter().copied().flatten().map(tool).sum::<f32>() + separators
}

fn button(context: &Context<'_>, ui: &mut Ui, requests: &mut Requests, &(icon, name, id): &Tool, is_named: bool) {
    let Some(action) = context.actions.named(id) else { return };
    let is_on = context.view.is_on(&action.intent);
    let icon = if id == "pause" && is_on { icon::PLAY } else { icon };
    let name = if id == "pause" && is_on { "Go on" } else { name };
    let icon = RichText::new(icon).size(ICON);
    let shown = if is_named && !name.is_empty() { Button::new((icon, name)) } else { Button::new(icon) };
    let shown = shown.selected(is_on);
    let why_not = context.why_not(action);
    let response = ui.add_enabled(why_not.is_none(), shown);
    if response.on_hover_text(context.tip(id)).on_disabled_hover_text(why_not.unwrap_or_default()).clicked() {
        requests.action(id);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::host::settings::KeySettings;
    use crate::host::window::action::Actions;

    #[test]
    fn names_are_left_out_where_the_state_would_cover_them() {
        let egui = crate::host::window::interface::Interface::new();
        let mut widths = [0.0; 2];
        let _ = egui.egui().run_ui(egui::RawInput::default(), |ui| {
            let named = width_named(ui);
            let shown = ui.horizontal(|ui| {
                for (n, group) in TOOLS.iter().enumerate() {
                    if n > 0 {
                        ui.separator();
                    }
                    for &(icon, name, _) in *group {
                        let icon = RichText::new(icon).size(ICON);
                        ui.add(if name.is_empty() { Button::new(icon) } else { Button::new((icon, name)) });
                    }
                }
            });
            widths = [named, shown.response.rect.width()];
        });
        // The last one has no space after it.
        assert!((widths[0] - widths[1]).abs() < 20.0 && widths[0] >= widths[1], "{widths:?}");
    }

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
