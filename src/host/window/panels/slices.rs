//! Slice panels: cross-sections that follow the flight or a place pointed at.
//!
//! A click points at a place, and a double click sets out there. A right drag adjusts the grey-level window. A middle drag (or Shift and a drag) moves the image.
//! The wheel scrolls through the layers, and with Ctrl it magnifies about the pointer.

use egui::{Align2, Color32, Event, Painter, PointerButton, Pos2, Rect, Sense, Stroke, Ui, Vec2, pos2, vec2};
use glam::DVec3;

use super::candidates::Marking;
use super::flight::{CLICK, TWICE_S};
use super::{Context, Panel, PanelEntry, Requests, candidates, expected, findings, measures, notches};
use crate::components::slices::{Orientation, SliceView};
use crate::host::window::intent::{EndAt, Intent, SliceInput};
use crate::host::window::style::{ACCENT, INK, SOFT, Severity, TEXT, label, text};
use crate::render::slice::{SlabKind, Slice};

/// The axial slice.
pub const AXIAL: PanelEntry = PanelEntry {
    name: "axial",
    title: "Axial slice",
    picture: true,
    make: || panel(Orientation::Axial),
    ..PanelEntry::NONE
};
/// The coronal slice.
pub const CORONAL: PanelEntry = PanelEntry {
    name: "coronal",
    title: "Coronal slice",
    picture: true,
    make: || panel(Orientation::Coronal),
    ..PanelEntry::NONE
};
/// The sagittal slice.
pub const SAGITTAL: PanelEntry = PanelEntry {
    name: "sagittal",
    title: "Sagittal slice",
    picture: true,
    make: || panel(Orientation::Sagittal),
    ..PanelEntry::NONE
};
/// The slice across the path.
pub const ACROSS: PanelEntry = PanelEntry {
    name: "across",
    title: "Slice across the path",
    picture: true,
    make: || panel(Orientation::Across),
    ..PanelEntry::NONE
};

/// The axial slice of the patient's other position.
pub const OTHER_AXIAL: PanelEntry = PanelEntry {
    name: "other-axial",
    title: "Axial slice, other position",
    picture: true,
    make: || Box::new(OtherSlicePanel(SlicePanel::new(Orientation::Axial))),
    ..PanelEntry::NONE
};
/// The coronal slice of the patient's other position.
pub const OTHER_CORONAL: PanelEntry = PanelEntry {
    name: "other-coronal",
    title: "Coronal slice, other position",
    picture: true,
    make: || Box::new(OtherSlicePanel(SlicePanel::new(Orientation::Coronal))),
    ..PanelEntry::NONE
};
/// The sagittal slice of the patient's other position.
pub const OTHER_SAGITTAL: PanelEntry = PanelEntry {
    name: "other-sagittal",
    title: "Sagittal slice, other position",
    picture: true,
    make: || Box::new(OtherSlicePanel(SlicePanel::new(Orientation::Sagittal))),
    ..PanelEntry::NONE
};

/// The camera is drawn within this distance of the plane, mm.
const NEAR_MM: f64 = 12.0;
/// Ends of measures are drawn within this distance of the plane, mm.
const NEAR_PLANE_MM: f64 = 2.0;
/// Half the side of the gap at the centre of the crosshair, points.
const GAP: f32 = 9.0;
const MARGIN: f32 = 6.0;
/// Lengths of scale bars, mm.
const BARS: [f64; 9] = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0];

fn panel(orientation: Orientation) -> Box<dyn Panel> {
    Box::new(SlicePanel::new(orientation))
}

/// Effect of a mouse drag.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Drag {
    Point,
    Window,
    Pan,
    /// Moves an end of a finding's diameter: the finding's number, and 0 or 1.
    End(usize, usize),
}

struct SlicePanel {
    orientation: Orientation,
    drag: Option<Drag>,
    pointer: Option<Pos2>,
    /// The last press, and its time, s.
    pressed: Option<(Pos2, f64)>,
}

/// A slice in a rectangle of the window.
#[derive(Clone, Copy)]
struct Placed {
    slice: Slice,
    rect: Rect,
    /// Pixels per point.
    scale: f32,
}

impl Placed {
    fn world(&self, at: Pos2) -> DVec3 {
        let pixel = (at - self.rect.min) * self.scale;
        self.slice.world([f64::from(pixel.x), f64::from(pixel.y)])
    }

    /// Calls a function with where points are seen in the image: those near its plane, or within its slab.
    fn seen<T>(&self, view: &SliceView, then: impl FnOnce(&Marking<'_>) -> T) -> T {
        let near = (view.slab.mm() * 0.5).max(NEAR_PLANE_MM);
        let find = |place: DVec3| {
            let (at, before) = self.point(place);
            (before.abs() <= near).then_some(at)
        };
        then(&Marking { project: &|place| Some(self.point(place).0), find: &find })
    }

    /// Projects a point (world, mm) into the window. Also returns its signed distance in front of the plane, mm.
    fn point(&self, world: DVec3) -> (Pos2, f64) {
        let ([x, y], before) = self.slice.pixel(world);
        (self.rect.min + vec2(x as f32, y as f32) / self.scale, before)
    }
}

impl Panel for SlicePanel {
    fn ui(&mut self, context: &Context<'_>, ui: &mut Ui, requests: &mut Requests) {
        let rect = ui.available_rect_before_wrap();
        ui.allocate_rect(rect, Sense::CLICK | Sense::DRAG);
        requests.show_slice(self.orientation, rect);
        let view = context.slice(self.orientation);
        let placed = view.and_then(SliceView::shown).map(|slice| Placed { slice, rect, scale: ui.pixels_per_point() });
        self.mouse(context, ui, rect, placed, requests);
        if let (Some(view), Some(placed)) = (view, placed) {
            self.draw(context, &ui.painter_at(rect), view, placed, ui);
        }
    }
}

/// A slice of the position that is not worked in.
struct OtherSlicePanel(SlicePanel);

impl Panel for OtherSlicePanel {
    fn ui(&mut self, context: &Context<'_>, ui: &mut Ui, requests: &mut Requests) {
        let Some(other) = context.of_other() else {
            ui.painter().rect_filled(ui.available_rect_before_wrap(), 0.0, ui.visuals().panel_fill);
            ui.label(if context.other.is_some() {
                "The other position is not ready."
            } else {
                "No other position is open."
            });
            return;
        };
        let mut own = Requests::default();
        self.0.ui(&other, ui, &mut own);
        requests.of_other(&mut own);
    }
}

/// Draws what is over a slice in a rectangle of the window, without a panel.
pub(in crate::host::window) fn draw_alone(context: &Context<'_>, ui: &Ui, orientation: Orientation, rect: Rect) {
    if let Some((view, slice)) = context.slice(orientation).and_then(|view| Some((view, view.shown()?))) {
        let placed = Placed { slice, rect, scale: ui.pixels_per_point() };
        SlicePanel::new(orientation).draw(context, &ui.painter_at(rect), view, placed, ui);
    }
}

impl SlicePanel {
    fn new(orientation: Orientation) -> Self {
        Self { orientation, drag: None, pointer: None, pressed: None }
    }

    fn mouse(&mut self, context: &Context<'_>, ui: &Ui, rect: Rect, placed: Option<Placed>, requests: &mut Requests) {
        let here = |at: Pos2| rect.contains(at) && ui.ctx().layer_id_at(at).is_none_or(|l| l == ui.layer_id());
        // A press outside an open menu closes it, and does nothing else.
        let menu = egui::Popup::is_any_open(ui.ctx());
        let scale = ui.pixels_per_point();
        let point = |at: Pos2, requests: &mut Requests| {
            if let Some(placed) = placed {
                requests.slice(SliceInput::Point(placed.world(at)));
            }
        };
        let (events, time, down) = ui.input(|i| (i.events.clone(), i.time, i.pointer.any_down()));
        if !down && !events.iter().any(|e| matches!(e, Event::PointerButton { .. })) {
            // The button was released while this panel was not shown.
            self.drag = None;
        }
        for event in events {
            match event {
                Event::PointerMoved(at) => {
                    let moved = self.pointer.map_or(Vec2::ZERO, |last| (at - last) * scale);
                    let [right, down] = [moved.x, moved.y].map(f64::from);
                    let mm = placed.map_or(0.0, |p| p.slice.mm_per_pixel);
                    match self.drag {
                        Some(Drag::Point) => point(at.clamp(rect.min, rect.max), requests),
                        Some(Drag::Window) => requests.slice(SliceInput::Window([right, -down])),
                        Some(Drag::Pan) => {
                            requests.slice(SliceInput::Pan(self.orientation, [right * mm, down * mm]));
                        }
                        Some(Drag::End(n, which)) => {
                            let end = context.found().findings.get(n).and_then(|f| Some(f.ends?[which]));
                            if let (Some(end), Some(placed)) = (end, placed) {
                                // In the plane of the image alone: the end may lie before or behind it.
                                let (_, before) = placed.point(end);
                                let to = placed.world(at) + placed.slice.frame.normal() * before;
                                requests.ask(Intent::MoveEnd(n, which, EndAt::World(to)));
                            }
                        }
                        None => {}
                    }
                    self.pointer = Some(at);
                }
                Event::PointerButton { pos, button, pressed: true, modifiers } if here(pos) && !menu => {
                    self.pointer = Some(pos);
                    self.drag = match button {
                        PointerButton::Primary if !modifiers.shift => Some(Drag::Point),
                        PointerButton::Primary | PointerButton::Middle => Some(Drag::Pan),
                        PointerButton::Secondary => Some(Drag::Window),
                        PointerButton::Extra1 | PointerButton::Extra2 => None,
                    };
                    let view = context.slice(self.orientation);
                    if let (Some(Drag::Point), Some(placed), Some(view)) = (self.drag, placed, view)
                        && let Some((n, which)) = placed.seen(view, |view| findings::end_at(context, pos, view))
                    {
                        self.drag = Some(Drag::End(n, which));
                    }
                    if let Some(placed) = placed.filter(|_| self.drag == Some(Drag::Point)) {
                        let near = |p: (Pos2, f64)| p.0.distance(pos) <= CLICK && time - p.1 <= TWICE_S;
                        let twice = self.pressed.take().is_some_and(near);
                        let place = placed.world(pos);
                        requests.slice(if twice { SliceInput::SetOut(place) } else { SliceInput::Click(place) });
                        self.pressed = (!twice).then_some((pos, time));
                    }
                }
                Event::PointerButton { pressed: false, .. } | Event::WindowFocused(false) => self.drag = None,
                Event::PointerGone => self.pointer = None,
                Event::MouseWheel { unit, delta, modifiers, .. } if self.pointer.is_some_and(here) => {
                    let notches = notches(unit, delta, scale);
                    let zooms = modifiers.command || modifiers.ctrl;
                    let about = self.pointer.zip(placed).map(|(at, placed)| placed.world(at));
                    match about.filter(|_| zooms) {
                        Some(about) => requests.slice(SliceInput::Zoom(self.orientation, notches, about)),
                        None if zooms => {}
                        None => requests.slice(SliceInput::Scroll(self.orientation, notches)),
                    }
                }
                _ => {}
            }
        }
    }

    fn draw(&self, context: &Context<'_>, p: &Painter, view: &SliceView, placed: Placed, ui: &Ui) {
        let inner = placed.rect.shrink(MARGIN);
        crosshair(p, placed, placed.point(context.place()).0);
        camera(context, p, placed);
        placed.seen(view, |view| {
            measures::draw(context, p, view.find);
            candidates::draw(context, p, view);
            findings::draw(context, p, view);
            expected::draw(context, p, view);
        });
        let edges = placed.slice.frame.edges();
        label(p, inner.left_center(), Align2::LEFT_CENTER, &edges[0]);
        label(p, inner.right_center(), Align2::RIGHT_CENTER, &edges[1]);
        label(p, inner.center_top(), Align2::CENTER_TOP, &edges[2]);
        // Above the scale bar if that extends to the middle.
        let up = if inner.width() < 320.0 { 26.0 } else { 0.0 };
        label(p, inner.center_bottom() - vec2(0.0, up), Align2::CENTER_BOTTOM, &edges[3]);
        words(p, inner.left_top(), Align2::LEFT_TOP, self.orientation.name(), INK);
        let (windowing, slab) = (view.windowing, view.slab);
        let kind = match slab.kind() {
            SlabKind::Mean => "mean",
            SlabKind::Max => "max",
            SlabKind::Min => "min",
        };
        if inner.width() > 220.0 {
            let greys = format!("W {:.0}  L {:.0}", windowing.width(), windowing.level());
            words(p, inner.right_top(), Align2::RIGHT_TOP, &greys, SOFT);
            if slab.mm() > 0.0 {
                // Beside the letter, or below its row in a narrow image.
                let below = inner.right_top() + vec2(0.0, 22.0);
                words(p, below, Align2::RIGHT_TOP, &format!("{kind} of {:.0} mm", slab.mm()), SOFT);
            }
        }
        scale_bar(p, inner, placed);
        let pointer = ui.input(|i| i.pointer.latest_pos()).filter(|at| placed.rect.contains(*at));
        if let Some(at) = pointer.filter(|_| inner.width() > 220.0) {
            // Below the letter at the top, and away from the scale bar.
            let below = inner.left_top() + vec2(0.0, 28.0);
            words(p, below, Align2::LEFT_TOP, &readout(context, view, placed, at), INK);
        }
    }
}

/// Formats value (HU), voxel and position under the pointer.
fn readout(context: &Context<'_>, view: &SliceView, placed: Placed, at: Pos2) -> String {
    let world = placed.world(at);
    let grid = context.flight.setup().volume.voxels().grid();
    let pixel = (at - placed.rect.min) * placed.scale;
    let hu = view.hu_at([pixel.x, pixel.y].map(|c| c.max(0.0) as usize)).unwrap_or(f32::NAN);
    let voxel = grid.voxel(world).round();
    let dims = DVec3::from_array(grid.dims().map(|d| d as f64));
    let place = format!("{:.1}, {:.1}, {:.1} mm", world.x, world.y, world.z);
    if voxel.cmplt(DVec3::ZERO).any() || voxel.cmpge(dims).any() {
        return format!("outside the scan\n{place}");
    }
    format!("{hu:.0} HU  voxel {:.0}, {:.0}, {:.0}\n{place}", voxel.x, voxel.y, voxel.z)
}

/// Draws text that is legible on any grey.
fn words(p: &Painter, at: Pos2, align: Align2, words: &str, colour: Color32) {
    if words.is_empty() {
        return;
    }
    let size = p.layout_no_wrap(words.to_owned(), egui::FontId::proportional(TEXT), colour).size();
    p.rect_filled(align.anchor_size(at, size).expand(2.0), 3.0, Color32::from_black_alpha(130));
    text(p, at, align, words, TEXT, colour);
}

fn crosshair(p: &Painter, placed: Placed, at: Pos2) {
    let rect = placed.rect;
    let [r, g, b, _] = Severity::Notice.colour().to_array();
    let stroke = Stroke::new(1.0, Color32::from_rgba_unmultiplied(r, g, b, 150));
    for [from, to] in [
        [pos2(rect.min.x, at.y), pos2(at.x - GAP, at.y)],
        [pos2(at.x + GAP, at.y), pos2(rect.max.x, at.y)],
        [pos2(at.x, rect.min.y), pos2(at.x, at.y - GAP)],
        [pos2(at.x, at.y + GAP), pos2(at.x, rect.max.y)],
    ] {
        p.line_segment([from, to], stroke);
    }
}

/// Draws the camera: a dot, and an arrow for the component of its view direction in the plane. It becomes smaller with the
/// distance from the plane, and is finally hidden.
fn camera(context: &Context<'_>, p: &Painter, placed: Placed) {
    let pose = context.flight.pose();
    let (at, before) = placed.point(pose.position);
    if before.abs() > NEAR_MM {
        return;
    }
    let size = 1.0 - 0.6 * (before.abs() / NEAR_MM) as f32;
    let frame = placed.slice.frame;
    let along = [frame.right(), frame.down()].map(|a| pose.attitude.forward.dot(a) as f32);
    let ahead = vec2(along[0], along[1]);
    if ahead.length() > 0.2 {
        let (tip, side) = (at + ahead * 26.0 * size, ahead.normalized().rot90() * 4.0 * size);
        let back = tip - ahead.normalized() * 8.0 * size;
        p.line_segment([at, back], Stroke::new(2.5 * size, ACCENT));
        p.add(egui::Shape::convex_polygon(vec![tip, back + side, back - side], ACCENT, Stroke::NONE));
    }
    p.circle_filled(at, 4.5 * size, ACCENT);
    p.circle_stroke(at, 4.5 * size, Stroke::new(1.0, Color32::BLACK));
}

/// Draws the longest round length that fits in a quarter of the image.
fn scale_bar(p: &Painter, inner: Rect, placed: Placed) {
    let points = |mm: f64| (mm / placed.slice.mm_per_pixel) as f32 / placed.scale;
    let Some(mm) = BARS.into_iter().rfind(|mm| points(*mm) <= inner.width() * 0.25) else { return };
    let right = inner.right_bottom() - vec2(0.0, 2.0);
    let left = right - vec2(points(mm), 0.0);
    for (colour, width) in [(Color32::BLACK, 4.0), (INK, 2.0)] {
        let stroke = Stroke::new(width, colour);
        p.line_segment([left, right], stroke);
        for end in [left, right] {
            p.line_segment([end - vec2(0.0, 4.0), end + vec2(0.0, 1.0)], stroke);
        }
    }
    text(p, pos2(right.x, right.y - 6.0), Align2::RIGHT_BOTTOM, &format!("{mm:.0} mm"), TEXT, INK);
}

#[cfg(test)]
mod tests {
    use egui::{LayerId, RawInput, Shape};

    use super::*;

    #[test]
    fn words_lie_on_a_dark_ground() {
        let area = Rect::from_min_size(Pos2::ZERO, vec2(300.0, 200.0));
        let drawn = |text: &str| {
            let input = RawInput { screen_rect: Some(area), ..RawInput::default() };
            let output = egui::Context::default().run_ui(input, |ui| {
                let p = ui.ctx().layer_painter(LayerId::background());
                words(&p, pos2(290.0, 10.0), Align2::RIGHT_TOP, text, SOFT);
            });
            output.shapes.into_iter().map(|s| s.shape).filter(|s| *s != Shape::Noop).collect::<Vec<_>>()
        };
        let [Shape::Rect(ground), Shape::Text(text)] = &drawn("W 400  L 40")[..] else { panic!("not two shapes") };
        assert_eq!(text.galley.text(), "W 400  L 40");
        let at = Rect::from_min_size(text.pos, text.galley.size());
        assert!((at.right_top() - pos2(290.0, 10.0)).length() < 1.0, "{at}");
        assert!(ground.rect.contains_rect(at) && ground.fill == Color32::from_black_alpha(130), "{}", ground.rect);
        assert!(drawn("").is_empty());
    }
}
