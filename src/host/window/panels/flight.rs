//! The flight panel: the picture with its text overlays, and mouse control of the view.

use egui::{Color32, Event, Painter, PointerButton, Pos2, Rect, Sense, Stroke, StrokeKind, Ui, vec2};
use glam::DVec3;

use super::candidates::Marking;
use super::{Context, Panel, PanelEntry, Requests, candidates, expected, findings, measures, notches};
use crate::components::output::Picture;
use crate::components::translucent::Translucent;
use crate::host::window::contract::Beside;
use crate::host::window::intent::{EndAt, Intent};
use crate::host::window::overlay::{self, Content, HudState};
use crate::host::window::style::{ACCENT, Severity};
use crate::render::wall_paint::PaintedArea;
use crate::space::first_crossing;

/// Its entry in the table.
pub const PANEL: PanelEntry = PanelEntry {
    name: "flight",
    title: "Flight",
    shown: true,
    picture: true,
    make: || Box::<FlightPanel>::default(),
    ..PanelEntry::NONE
};

/// Largest distance, points, and longest time, s, between press and release of a click.
pub(super) const CLICK: f32 = 4.0;
const PRESS_S: f64 = 0.5;
/// Longest time between the two clicks of a double click, s.
pub(super) const TWICE_S: f64 = 0.45;
/// A place is visible if the wall is at most this far in front of it, mm.
const SEEN_MM: f64 = 1.0;

/// Effect of a mouse drag.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Drag {
    /// Looks around.
    Look,
    /// Rolls the view.
    Roll,
    /// Moves an end of a finding's diameter: the finding's number, and 0 or 1.
    End(usize, usize),
}

/// The flight's panel.
#[derive(Debug, Default)]
pub struct FlightPanel {
    drag: Option<Drag>,
    pointer: Option<Pos2>,
    /// Position and time of the press, while the pointer has not moved away.
    pressed: Option<(Pos2, f64)>,
    /// The last click.
    clicked: Option<(Pos2, f64)>,
}

impl Panel for FlightPanel {
    fn ui(&mut self, context: &Context<'_>, ui: &mut Ui, requests: &mut Requests) {
        // Side by side, each position stays on its side.
        if context.shows_both && context.is_second() {
            return other(context, ui, requests);
        }
        self.worked_in(context, ui, requests);
    }
}

impl FlightPanel {
    /// Lays out the flight that is worked in.
    pub(super) fn worked_in(&mut self, context: &Context<'_>, ui: &mut Ui, requests: &mut Requests) {
        let rect = ui.available_rect_before_wrap();
        if let Some(why) = context.view.unflown() {
            return overlay::unflown(&ui.painter_at(rect), rect, why, context.hud.message.as_deref());
        }
        // Tab must not reach it: its keys belong to the flight.
        ui.allocate_rect(rect, Sense::CLICK | Sense::DRAG);
        self.mouse(context, ui, rect, requests);
        requests.show_flight(rect);
        let p = ui.painter_at(rect);
        marks(context, &p, rect);
        overlay::flight(&p, rect, context.hud, context.is_headed);
        if context.shows_both && context.other.is_some() {
            p.rect_stroke(rect.shrink(1.0), 0.0, Stroke::new(2.0, ACCENT), StrokeKind::Inside);
        }
    }

    /// Processes event by event, since a button may be pressed and released between two layouts.
    fn mouse(&mut self, context: &Context<'_>, ui: &Ui, rect: Rect, requests: &mut Requests) {
        let scale = f64::from(ui.pixels_per_point());
        let here = |at: Pos2| rect.contains(at) && ui.ctx().layer_id_at(at).is_none_or(|l| l == ui.layer_id());
        let (events, time, down) = ui.input(|i| (i.events.clone(), i.time, i.pointer.any_down()));
        if !down && !events.iter().any(|e| matches!(e, Event::PointerButton { .. })) {
            // The button was released while this panel was not shown.
            (self.drag, self.pressed) = (None, None);
        }
        // A press outside an open menu closes it, and does nothing else.
        let menu = egui::Popup::is_any_open(ui.ctx());
        for event in events {
            match event {
                Event::PointerMoved(at) => {
                    if let (Some(drag), Some(last)) = (self.drag, self.pointer) {
                        let [right, down] = [at.x - last.x, at.y - last.y].map(|d| f64::from(d) * scale);
                        let pixel = [at.x - rect.min.x, at.y - rect.min.y].map(|d| f64::from(d) * scale);
                        requests.ask(match drag {
                            Drag::Look => Intent::Look([right, down]),
                            Drag::Roll => Intent::Roll(right),
                            Drag::End(n, which) => Intent::MoveEnd(n, which, EndAt::Pixel(pixel)),
                        });
                    }
                    let has_lens = context.flight.camera::<Translucent>().is_some_and(|t| t.area != PaintedArea::Whole);
                    if has_lens && here(at) {
                        let to = [at.x - rect.min.x, at.y - rect.min.y].map(|d| f64::from(d) * scale);
                        requests.ask(Intent::MoveLens(to));
                    }
                    self.pointer = Some(at);
                }
                Event::PointerButton { pos, button, pressed: true, modifiers } if here(pos) && !menu => {
                    self.pointer = Some(pos);
                    match (button, overlay::on_bar(rect, pos)) {
                        (PointerButton::Primary, Some(share)) => requests.ask(Intent::Seek(share)),
                        (PointerButton::Primary, None) if !modifiers.shift => {
                            let end =
                                seen(context, rect, ui.pixels_per_point(), |view| findings::end_at(context, pos, view));
                            self.drag = Some(end.flatten().map_or(Drag::Look, |(n, which)| Drag::End(n, which)));
                            self.pressed = Some((pos, time)).filter(|_| self.drag == Some(Drag::Look));
                        }
                        (PointerButton::Primary | PointerButton::Secondary, _) => self.drag = Some(Drag::Roll),
                        (PointerButton::Middle | PointerButton::Extra1 | PointerButton::Extra2, _) => {}
                    }
                }
                Event::PointerButton { pos, pressed: false, .. } => {
                    self.drag = None;
                    let near = |p: &(Pos2, f64), within: f64| p.0.distance(pos) <= CLICK && time - p.1 <= within;
                    if self.pressed.take().is_some_and(|p| near(&p, PRESS_S)) {
                        let at = (pos - rect.min) * ui.pixels_per_point();
                        let at = [at.x, at.y].map(f64::from);
                        let twice = self.clicked.take().is_some_and(|c| near(&c, TWICE_S));
                        requests.ask(if twice { Intent::LookAt(at) } else { Intent::Click(at) });
                        self.clicked = (!twice).then_some((pos, time));
                    }
                }
                Event::WindowFocused(false) => (self.drag, self.pressed) = (None, None),
                Event::MouseWheel { unit, delta, modifiers, .. } if self.pointer.is_some_and(here) => {
                    let notches = notches(unit, delta, ui.pixels_per_point());
                    let zooms = modifiers.command || modifiers.ctrl;
                    requests.ask(if zooms { Intent::Zoom(notches) } else { Intent::Speed(notches) });
                }
                _ => {}
            }
        }
    }
}

/// Lays out the position that is not worked in. A press into its picture is to work there.
pub(super) fn other(context: &Context<'_>, ui: &mut Ui, requests: &mut Requests) {
    let rect = ui.available_rect_before_wrap();
    ui.allocate_rect(rect, Sense::CLICK);
    let Some(content) = context.other.map(|other| other.content) else { return };
    let p = ui.painter_at(rect);
    match (content, context.of_other()) {
        (Content::Loading { stage, share }, _) => overlay::loading(&p, rect, stage, *share, ""),
        (Content::Failed { text }, _) => overlay::unflown(&p, rect, text, None),
        (Content::Flight(_), Some(own)) => {
            if own.view.unflown().is_none() {
                requests.show_beside(Beside::Other, rect);
            }
            draw_alone(&own, ui, rect, own.hud);
            let is_here = |at| rect.contains(at) && ui.ctx().layer_id_at(at).is_none_or(|l| l == ui.layer_id());
            // Outside the lock that egui holds on its input.
            let events = ui.input(|i| i.events.clone());
            let is_pressed = events.iter().any(|e| match e {
                Event::PointerButton { pos, button: PointerButton::Primary, pressed: true, .. } => is_here(*pos),
                _ => false,
            });
            if is_pressed && !egui::Popup::is_any_open(ui.ctx()) {
                requests.ask(Intent::OtherPosition);
            }
        }
        (Content::Flight(_), None) => {}
    }
}

/// Draws what is over the flight's picture in a rectangle of the window, without a panel.
pub(in crate::host::window) fn draw_alone(context: &Context<'_>, ui: &Ui, rect: Rect, hud: &HudState) {
    let p = ui.painter_at(rect);
    match context.view.unflown() {
        Some(why) => overlay::unflown(&p, rect, why, None),
        None => {
            marks(context, &p, rect);
            overlay::flight(&p, rect, hud, false);
        }
    }
}

/// Draws the place pointed at and the measures where they are visible in the picture.
fn marks(context: &Context<'_>, p: &Painter, rect: Rect) {
    let cursor = context.cursor();
    if !context.view.has_marks() && context.expected().is_empty() {
        return;
    }
    seen(context, rect, p.pixels_per_point(), |view| {
        measures::draw(context, p, view.find);
        candidates::draw(context, p, view);
        findings::draw(context, p, view);
        expected::draw(context, p, view);
        if let Some(at) = cursor.and_then(view.find) {
            for (colour, width) in [(Color32::BLACK, 3.5), (Severity::Notice.colour(), 1.5)] {
                p.circle_stroke(at, 7.0, Stroke::new(width, colour));
                for d in [vec2(1.0, 0.0), vec2(-1.0, 0.0), vec2(0.0, 1.0), vec2(0.0, -1.0)] {
                    p.line_segment([at + d * 7.0, at + d * 13.0], Stroke::new(width, colour));
                }
            }
        }
    });
}

/// Calls a function with where points are seen in the picture, in a rectangle of the window; `None` if there is no picture.
fn seen<T>(context: &Context<'_>, rect: Rect, scale: f32, then: impl FnOnce(&Marking<'_>) -> T) -> Option<T> {
    let view = context.flight.camera::<Picture>().and_then(|picture| picture.view.as_ref())?;
    let volume = context.flight.shown_scan();
    let project = |place: DVec3| {
        let [x, y] = view.project(place)?;
        Some(rect.min + vec2(x as f32, y as f32) / scale)
    };
    let find = |place: DVec3| {
        let [x, y] = view.project(place)?;
        let ray = view.ray_at(x, y)?;
        let distance = ray.origin.distance(place);
        let hidden =
            first_crossing(volume, ray.origin, ray.direction, distance).is_some_and(|d| d < distance - SEEN_MM);
        let within = x >= 0.0 && y >= 0.0 && x < view.width() as f64 && y < view.height() as f64;
        (within && !hidden).then(|| rect.min + vec2(x as f32, y as f32) / scale)
    };
    Some(then(&Marking { project: &project, find: &find }))
}
