//! The second position's panel: the same patient, lying otherwise, beside the flight through the first one.

use egui::{RichText, Ui};

use super::flight::{self, FlightPanel};
use super::open::FileList;
use super::{Context, Panel, PanelEntry, Requests};
use crate::host::window::intent::Intent;
use crate::host::window::style::SOFT;

/// Its entry in the table.
pub const PANEL: PanelEntry = PanelEntry {
    name: "second",
    title: "Second position",
    picture: true,
    make: || Box::<SecondPanel>::default(),
    ..PanelEntry::NONE
};

/// The panel.
#[derive(Debug, Default)]
pub struct SecondPanel {
    flight: FlightPanel,
    files: FileList,
}

impl Panel for SecondPanel {
    fn ui(&mut self, context: &Context<'_>, ui: &mut Ui, requests: &mut Requests) {
        if context.is_second() {
            self.flight.worked_in(context, ui, requests);
        } else if context.other.is_some() {
            flight::other(context, ui, requests);
        } else {
            self.choose(context, ui, requests);
        }
    }
}

impl SecondPanel {
    /// Creates a panel with a known list of scans.
    #[cfg(test)]
    pub(super) fn of(files: FileList) -> Self {
        Self { files, ..Self::default() }
    }

    /// Lays out the scans that can be opened as the second position.
    fn choose(&mut self, context: &Context<'_>, ui: &mut Ui, requests: &mut Requests) {
        let rect = ui.available_rect_before_wrap();
        ui.painter().rect_filled(rect, 0.0, ui.visuals().panel_fill);
        ui.scope_builder(egui::UiBuilder::new().max_rect(rect.shrink(8.0)), |ui| {
            ui.heading("Second position");
            ui.label(
                RichText::new("Open the scan of the same patient in another position beside this one.").color(SOFT),
            );
            ui.separator();
            if let Some((path, series)) = self.files.choose(context, ui) {
                requests.ask(Intent::OpenSecond(path, series));
            }
        });
    }
}
