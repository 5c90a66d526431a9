//! The flight: its picture with what there is to say over it, and the mouse that looks around in it.

use egui::{Event, MouseWheelUnit, PointerButton, Pos2, Rect, Sense, Ui};

use super::{Context, FlightRequest, Panel, PanelEntry, Requests};
use crate::host::window::overlay;

/// Its entry in the table.
pub const PANEL: PanelEntry = PanelEntry {
    name: "flight",
    title: "Flight",
    shown: true,
    picture: true,
    make: || Box::<FlightPanel>::default(),
    ..PanelEntry::NONE
};

/// Pixels of a smooth scroll that count as a notch.
const NOTCH: f64 = 40.0;

/// What a mouse does that is dragged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Drag {
    /// Looks around.
    Look,
    /// Rolls the view.
    Roll,
}

/// The flight's panel.
#[derive(Debug, Default)]
pub struct FlightPanel {
    drag: Option<Drag>,
    pointer: Option<Pos2>,
}

impl Panel for FlightPanel {
    fn ui(&mut self, context: &Context<'_>, ui: &mut Ui, requests: &mut Requests) {
        let rect = ui.available_rect_before_wrap();
        // Not to be reached by Tab: its keys are the flight's.
        ui.allocate_rect(rect, Sense::CLICK | Sense::DRAG);
        self.mouse(ui, rect, requests);
        requests.show_flight(rect);
        overlay::flight(&ui.painter_at(rect), rect, context.readings);
    }
}

impl FlightPanel {
    /// Event by event: a button may go down and up again between two layouts.
    fn mouse(&mut self, ui: &Ui, rect: Rect, requests: &mut Requests) {
        let scale = f64::from(ui.pixels_per_point());
        let here = |at: Pos2| rect.contains(at) && ui.ctx().layer_id_at(at).is_none_or(|l| l == ui.layer_id());
        for event in ui.input(|i| i.events.clone()) {
            match event {
                Event::PointerMoved(at) => {
                    if let (Some(drag), Some(last)) = (self.drag, self.pointer) {
                        let [right, down] = [at.x - last.x, at.y - last.y].map(|d| f64::from(d) * scale);
                        requests.fly(match drag {
                            Drag::Look => FlightRequest::Look([right, down]),
                            Drag::Roll => FlightRequest::Roll(right),
                        });
                    }
                    self.pointer = Some(at);
                }
                Event::PointerButton { pos, button, pressed: true, modifiers } if here(pos) => {
                    self.pointer = Some(pos);
                    match (button, overlay::on_bar(rect, pos)) {
                        (PointerButton::Primary, Some(share)) => requests.fly(FlightRequest::Seek(share)),
                        (PointerButton::Primary, None) if !modifiers.shift => self.drag = Some(Drag::Look),
                        (PointerButton::Primary | PointerButton::Secondary, _) => self.drag = Some(Drag::Roll),
                        (PointerButton::Middle | PointerButton::Extra1 | PointerButton::Extra2, _) => {}
                    }
                }
                Event::PointerButton { pressed: false, .. } | Event::WindowFocused(false) => self.drag = None,
                Event::MouseWheel { unit, delta, modifiers, .. } if self.pointer.is_some_and(here) => {
                    let notches = match unit {
                        MouseWheelUnit::Line | MouseWheelUnit::Page => f64::from(delta.y),
                        MouseWheelUnit::Point => f64::from(delta.y) * scale / NOTCH,
                    };
                    let zooms = modifiers.command || modifiers.ctrl;
                    requests.fly(if zooms { FlightRequest::Zoom(notches) } else { FlightRequest::Hurry(notches) });
                }
                _ => {}
            }
        }
    }
}
