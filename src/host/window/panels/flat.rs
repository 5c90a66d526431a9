//! The colon laid flat: the rectum on top, cut open along the back, seen from inside. A click looks at a place in all views, the wheel scrolls.

use egui::{Align2, Color32, Event, Painter, PointerButton, Pos2, Rect, Sense, Stroke, Ui, pos2, vec2};
use glam::DVec3;

use super::{Context, Panel, PanelEntry, Requests, notches};
use crate::components::camera::Pose;
use crate::host::window::contract::Beside;
use crate::host::window::flat::{Flat, FlatInput};
use crate::host::window::intent::Intent;
use crate::host::window::style::{ACCENT, INK, SOFT, Severity, TEXT, text};
use crate::polyps::answers::Answer;

/// Its entry in the table.
pub const PANEL: PanelEntry = PanelEntry {
    name: "flat",
    title: "Colon laid flat",
    picture: true,
    make: || Box::new(FlatPanel::default()),
    ..PanelEntry::NONE
};

/// Share of the height that a notch of the wheel scrolls by.
const NOTCH: f64 = 0.12;
/// Radius of the ring about the pointer, mm on the wall, and its corners.
const RING_MM: f64 = 5.0;
const CORNERS: usize = 32;
const MARGIN: f32 = 8.0;
/// Radius of a mark, points.
const MARK: f32 = 8.0;
/// Colour of findings, as elsewhere.
const FINDING: Color32 = Color32::from_rgb(255, 120, 200);

#[derive(Default)]
struct FlatPanel {
    pointer: Option<Pos2>,
}

impl Panel for FlatPanel {
    fn ui(&mut self, context: &Context<'_>, ui: &mut Ui, requests: &mut Requests) {
        let rect = ui.available_rect_before_wrap();
        ui.allocate_rect(rect, Sense::CLICK);
        // To show the panel is to ask for the map.
        requests.ask(Intent::Flat(FlatInput::Show));
        requests.show_beside(Beside::Flat, rect);
        self.mouse(ui, rect, requests);
        draw_alone(context, ui, rect);
        if let Some(at) = self.pointer.filter(|at| rect.contains(*at)) {
            ring(context.view.flat(), &ui.painter_at(rect), rect, at);
        }
    }
}

impl FlatPanel {
    fn mouse(&mut self, ui: &Ui, rect: Rect, requests: &mut Requests) {
        let here = |at: Pos2| rect.contains(at) && ui.ctx().layer_id_at(at).is_none_or(|l| l == ui.layer_id());
        let menu = egui::Popup::is_any_open(ui.ctx());
        let scale = ui.pixels_per_point();
        for event in ui.input(|i| i.events.clone()) {
            match event {
                Event::PointerMoved(at) => self.pointer = Some(at),
                Event::PointerGone => self.pointer = None,
                Event::PointerButton { pos, button: PointerButton::Primary, pressed: true, .. }
                    if here(pos) && !menu =>
                {
                    let at = (pos - rect.min) * scale;
                    requests.ask(Intent::Flat(FlatInput::Visit([at.x, at.y].map(f64::from))));
                }
                Event::MouseWheel { unit, delta, .. } if self.pointer.is_some_and(here) => {
                    requests.ask(Intent::Flat(FlatInput::Scroll(-NOTCH * notches(unit, delta, scale))));
                }
                _ => {}
            }
        }
    }
}

/// Returns the point of a rectangle where a place (world, mm) is shown; `None` if it is not.
fn at(flat: &Flat, rect: Rect, scale: f32, place: DVec3) -> Option<Pos2> {
    let [x, y] = flat.pixel_of(place, (rect.width() * scale).round() as usize)?;
    let at = rect.min + vec2(x as f32, y as f32) / scale;
    rect.expand(MARK).contains(at).then_some(at)
}

/// Draws what is over the map in a rectangle of the window: marks, the camera, and what is still done.
pub(in crate::host::window) fn draw_alone(context: &Context<'_>, ui: &Ui, rect: Rect) {
    let (p, flat) = (ui.painter_at(rect), context.view.flat());
    let scale = ui.pixels_per_point();
    let of = |place: DVec3| at(flat, rect, scale, place);
    if flat.map().is_some() {
        if let Some(assistant) = context.assistant() {
            let reading = assistant.reading();
            for (n, entry) in assistant.found().iter().flat_map(|f| f.list.iter().enumerate()) {
                let is_refused = reading.said(n).is_some_and(|s| s.answer == Some(Answer::No));
                if let Some(at) = of(entry.candidate.position).filter(|_| !is_refused) {
                    mark(&p, at, &format!("{}", n + 1), ACCENT, reading.current() == Some(n));
                }
            }
        }
        for (n, finding) in context.found().findings.iter().enumerate() {
            if let Some(at) = of(finding.place) {
                mark(&p, at, &finding.id, FINDING, context.current_finding() == Some(n));
            }
        }
        if let Some(at) = context.cursor().and_then(of) {
            for (colour, width) in [(Color32::BLACK, 3.5), (Severity::Notice.colour(), 1.5)] {
                for d in [vec2(1.0, 0.0), vec2(-1.0, 0.0), vec2(0.0, 1.0), vec2(0.0, -1.0)] {
                    p.line_segment([at + d * 4.0, at + d * 11.0], Stroke::new(width, colour));
                }
            }
        }
        camera(context, &p, rect, &of);
    }
    let head = [("rectum above", rect.left_top() + vec2(MARGIN, MARGIN), Align2::LEFT_TOP)];
    for (words, at, align) in head {
        text(&p, at, align, words, TEXT, SOFT);
    }
    if let Some(told) = flat.told() {
        let at = if flat.map().is_some() { rect.center_top() + vec2(0.0, MARGIN) } else { rect.center() };
        text(&p, at, Align2::CENTER_TOP, &told, TEXT, INK);
    }
}

/// Draws where the camera is, and in which direction it looks along the colon: at the wall below it and in front of it.
fn camera(context: &Context<'_>, p: &Painter, rect: Rect, of: &dyn Fn(DVec3) -> Option<Pos2>) {
    let pose: Pose = context.flight.pose();
    let volume = context.flight.shown_scan();
    let hit = |direction: DVec3| {
        let mm = crate::space::first_crossing(volume, pose.position, direction, 80.0)?;
        of(pose.position + direction * mm)
    };
    // The wall on four sides shows the row; the wall ahead is farther along.
    let (up, right) = (pose.attitude.up, pose.attitude.forward.cross(pose.attitude.up));
    let rows: Vec<f32> = [up, -up, right, -right].into_iter().filter_map(hit).map(|at| at.y).collect();
    if rows.is_empty() {
        return;
    }
    let y = rows.iter().sum::<f32>() / rows.len() as f32;
    for (colour, width) in [(Color32::BLACK, 3.0), (ACCENT, 1.5)] {
        p.line_segment([pos2(rect.min.x, y), pos2(rect.min.x + 14.0, y)], Stroke::new(width, colour));
        p.line_segment([pos2(rect.max.x - 14.0, y), pos2(rect.max.x, y)], Stroke::new(width, colour));
    }
    if let Some(ahead) = hit(pose.attitude.forward) {
        p.circle_filled(ahead, 4.5, ACCENT);
        p.circle_stroke(ahead, 4.5, Stroke::new(1.0, Color32::BLACK));
    }
}

fn mark(p: &Painter, at: Pos2, name: &str, ink: Color32, is_chosen: bool) {
    let width = if is_chosen { 2.5 } else { 1.5 };
    for (colour, width) in [(Color32::BLACK, width + 2.0), (ink, width)] {
        p.circle_stroke(at, MARK, Stroke::new(width, colour));
    }
    let beside = at + vec2(MARK * 0.8, -MARK * 0.8);
    let size = p.layout_no_wrap(name.to_owned(), egui::FontId::proportional(TEXT), ink).size();
    let ground = Align2::LEFT_BOTTOM.anchor_size(beside, size).expand(2.0);
    p.rect_filled(ground, 3.0, Color32::from_black_alpha(170));
    text(p, beside, Align2::LEFT_BOTTOM, name, TEXT, ink);
}

/// Draws a ring of 10 mm on the wall about the pointer, as the map distorts it.
fn ring(flat: &Flat, p: &Painter, rect: Rect, pointer: Pos2) {
    let scale = p.pixels_per_point();
    let width = (rect.width() * scale).round() as usize;
    let pixel = (pointer - rect.min) * scale;
    let Some([place, middle]) = flat.place([pixel.x, pixel.y].map(f64::from), width) else { return };
    let Some(inwards) = (place - middle).try_normalize() else { return };
    let (a, b) = inwards.any_orthonormal_pair();
    let corner = |n: usize| {
        let angle = std::f64::consts::TAU * n as f64 / CORNERS as f64;
        at(flat, rect, scale, place + (a * angle.cos() + b * angle.sin()) * RING_MM)
    };
    let corners: Vec<Option<Pos2>> = (0..=CORNERS).map(corner).collect();
    for pair in corners.windows(2) {
        // The cut parts it.
        if let [Some(from), Some(to)] = pair
            && from.distance(*to) < 0.3 * rect.width()
        {
            for (colour, width) in [(Color32::BLACK, 3.0), (INK, 1.2)] {
                p.line_segment([*from, *to], Stroke::new(width, colour));
            }
        }
    }
    text(p, pointer + vec2(14.0, 10.0), Align2::LEFT_TOP, "10 mm", TEXT, INK);
}
