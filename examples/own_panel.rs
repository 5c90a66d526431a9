//! Adds a panel to colvis: the distance to the wall over the last seconds.
//!
//! `cargo run --release --example own_panel` (key Q)

use std::collections::VecDeque;

use colvis::cli::Program;
use colvis::components::camera::Contact;
use colvis::egui::{Color32, Sense, Shape, Stroke, Ui, pos2, vec2};
use colvis::panel::{Context, Panel, PanelEntry, Requests};

/// Number of frames plotted.
const LENGTH: usize = 600;
/// Distance at the top of the plot, mm.
const TOP: f64 = 20.0;

#[derive(Default)]
struct WallDistance {
    last_tick: u64,
    mm: VecDeque<f64>,
}

impl Panel for WallDistance {
    fn ui(&mut self, context: &Context<'_>, ui: &mut Ui, requests: &mut Requests) {
        let tick = context.flight.clock().tick;
        if let Some(contact) = context.flight.camera::<Contact>().filter(|_| tick != self.last_tick) {
            self.last_tick = tick;
            self.mm.push_back(contact.clearance_mm.min(TOP));
            self.mm.drain(..self.mm.len().saturating_sub(LENGTH));
        }
        ui.horizontal(|ui| {
            context.button(ui, "Stop", "pause", requests);
            context.button(ui, "Turn round", "reverse", requests);
            ui.label(format!("{:.1} mm to the wall", self.mm.back().copied().unwrap_or_default()));
        });
        let (rect, _) = ui.allocate_exact_size(ui.available_size().max(vec2(10.0, 10.0)), Sense::hover());
        let line = self.mm.iter().enumerate().map(|(n, mm)| {
            let x = rect.left() + rect.width() * n as f32 / LENGTH as f32;
            pos2(x, rect.bottom() - rect.height() * (mm / TOP) as f32)
        });
        let stroke = Stroke::new(1.5, Color32::from_rgb(96, 190, 255));
        ui.painter_at(rect).add(Shape::line(line.collect(), stroke));
    }
}

const PANEL: PanelEntry = PanelEntry {
    name: "wall_distance",
    title: "Distance to the wall",
    key: Some('q'),
    shown: true,
    make: || Box::<WallDistance>::default(),
    ..PanelEntry::NONE
};

fn main() -> std::process::ExitCode {
    Program::default().panel(PANEL).run()
}

#[test]
fn its_key_is_free() -> colvis::error::Result<()> {
    Program::default().panel(PANEL).check()
}
