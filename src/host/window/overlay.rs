//! Text and symbols that a window shows over its image, and their layout.

use egui::{Align2, Color32, Painter, Pos2, Rect, Stroke, StrokeKind, Vec2, pos2, vec2};

use super::directions::Directions;
use super::place::Bar;
use super::style::{ACCENT, DISCLAIMER, EXPECTED, INK, LABEL, SOFT, Severity, TEXT, font, label, text};
use crate::app::overlay::{Align, Colour, Mark, Place2};

const MARGIN: f32 = 10.0;
const BACKING: Color32 = Color32::from_black_alpha(165);

/// Content of a window.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Content {
    /// The scan is being read.
    Loading {
        /// The current stage.
        stage: String,
        /// Share done, 0 to 1; `None` if unknown.
        share: Option<f64>,
    },
    /// The scan could not be read.
    Failed {
        /// Why it cannot be flown.
        text: String,
    },
    /// The flight.
    Flight(Box<HudState>),
}

/// The state of a flight for display.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct HudState {
    /// The state of the flight in words.
    pub state: String,
    /// Urgency of the state.
    pub severity: Severity,
    /// More about the state: why the operator is called, what is left to fly.
    pub more: Vec<String>,
    /// Frame time, speed, clearance and other figures, one per line.
    pub figures: Vec<String>,
    /// The patient's directions.
    pub directions: Directions,
    /// The bar.
    pub bar: Bar,
    /// Position in words.
    pub place: String,
    /// Message about a recent event.
    pub message: Option<String>,
    /// The most needed keys in one line, always shown.
    pub keys: String,
    /// Marks drawn by overlays.
    pub marks_drawn: Vec<Mark>,
}

/// Returns the rectangle of the path's progress bar, in an area given in points.
fn track(area: Rect) -> Rect {
    let inner = area.shrink(MARGIN);
    Rect::from_min_size(pos2(inner.min.x, area.max.y - 14.0), vec2(inner.width(), 8.0))
}

/// Returns the share of the path, 0 to 1, for a point on its bar; `None` off the bar.
pub(crate) fn on_bar(area: Rect, at: Pos2) -> Option<f64> {
    let track = track(area);
    // The bar is thin, so a click may be slightly off.
    track.expand(5.0).contains(at).then(|| f64::from(((at.x - track.min.x) / track.width()).clamp(0.0, 1.0)))
}

fn bar(p: &Painter, rect: Rect, share: f64) {
    p.rect_filled(rect, 3.0, Color32::from_black_alpha(190));
    let width = rect.width() * share.clamp(0.0, 1.0) as f32;
    p.rect_filled(Rect::from_min_size(rect.min, vec2(width, rect.height())), 3.0, ACCENT);
}

/// Draws lines in a box. `at` is the corner of the box that `align` names.
fn lines(p: &Painter, at: Pos2, align: Align2, wrap: f32, list: &[(&str, f32, Color32)]) -> Rect {
    let pad = vec2(8.0, 6.0);
    let galleys: Vec<_> =
        list.iter().map(|&(t, size, colour)| p.layout(t.to_owned(), font(size), colour, wrap.max(40.0))).collect();
    let width = galleys.iter().map(|g| g.size().x).fold(0.0, f32::max);
    let height: f32 = galleys.iter().map(|g| g.size().y).sum();
    let rect = align.anchor_size(at, vec2(width, height) + pad * 2.0);
    p.rect_filled(rect, 5.0, BACKING);
    let mut y = rect.min.y + pad.y;
    for (galley, &(_, _, colour)) in galleys.into_iter().zip(list) {
        let down = galley.size().y;
        p.galley(pos2(rect.min.x + pad.x, y), galley, colour);
        y += down;
    }
    rect
}

/// Draws the progress of loading over an area given in points. `quit` is the key that cancels it, empty if there is none.
pub(crate) fn loading(p: &Painter, area: Rect, stage: &str, share: Option<f64>, quit: &str) {
    let centre = area.center();
    let stage = if stage.is_empty() { "starting" } else { stage };
    let percent = share.map_or_else(String::new, |s| format!("   {:.0} %", s * 100.0));
    text(p, centre - vec2(0.0, 24.0), Align2::CENTER_CENTER, &format!("{stage}{percent}"), 18.0, INK);
    let size = vec2((area.width() * 0.6).min(480.0), 10.0);
    let rect = Rect::from_center_size(centre + vec2(0.0, 4.0), size);
    p.rect_filled(rect, 3.0, Color32::from_gray(50));
    if let Some(s) = share {
        bar(p, rect, s);
    }
    if !quit.is_empty() {
        text(p, centre + vec2(0.0, 34.0), Align2::CENTER_CENTER, &format!("{quit} cancels"), TEXT, SOFT);
    }
    text(p, area.center_bottom() - vec2(0.0, MARGIN), Align2::CENTER_BOTTOM, DISCLAIMER, TEXT, SOFT);
}

/// Draws, in place of a flight's picture, why there is none, and a message, in an area given in points.
pub(crate) fn unflown(p: &Painter, area: Rect, why: &str, message: Option<&str>) {
    p.rect_filled(area, 0.0, Color32::from_gray(24));
    let list = [(why, 16.0, INK)].into_iter().chain(message.map(|m| (m, 16.0, Severity::Notice.colour())));
    lines(p, area.center(), Align2::CENTER_CENTER, area.width() * 0.8, &list.collect::<Vec<_>>());
}

/// Returns as many of the keys, which three spaces part, as fit in a width, points.
fn fitting<'a>(p: &Painter, keys: &'a str, width: f32) -> &'a str {
    let ends = keys.match_indices("   ").map(|(n, _)| n).chain([keys.len()]);
    let fits = |end: &usize| p.layout_no_wrap(keys[..*end].to_owned(), font(TEXT), SOFT).size().x <= width;
    ends.filter(fits).last().map_or("", |end| &keys[..end])
}

/// Positions of marks are clamped to this distance, pixels: anything farther out is in no window.
const FAR_PIXELS: f32 = 3e4;
/// Limits of a mark's font size, points, and of its number of characters.
const TEXT_SIZES: [f32; 2] = [4.0, 96.0];
const LONGEST_TEXT: usize = 400;

/// Returns a mark with values that can be painted, whatever an overlay has supplied; `None` if a coordinate is not a number.
fn sanitized(mark: &Mark) -> Option<Mark> {
    let place =
        |[x, y]: Place2| (x.is_finite() && y.is_finite()).then(|| [x, y].map(|c| c.clamp(-FAR_PIXELS, FAR_PIXELS)));
    let within = |x: f32, low: f32, high: f32| if x.is_nan() { low } else { x.clamp(low, high) };
    Some(match mark {
        Mark::Line { from, to, colour, width } => {
            Mark::Line { from: place(*from)?, to: place(*to)?, colour: *colour, width: within(*width, 0.0, 100.0) }
        }
        Mark::Circle { centre, radius, colour } => {
            Mark::Circle { centre: place(*centre)?, radius: within(*radius, 0.0, FAR_PIXELS), colour: *colour }
        }
        Mark::Disc { centre, radius, colour } => {
            Mark::Disc { centre: place(*centre)?, radius: within(*radius, 0.0, FAR_PIXELS), colour: *colour }
        }
        Mark::Panel { low, high, colour, opacity } => {
            Mark::Panel { low: place(*low)?, high: place(*high)?, colour: *colour, opacity: within(*opacity, 0.0, 1.0) }
        }
        Mark::Text { at, text, colour, align, size } => Mark::Text {
            at: place(*at)?,
            text: text.chars().take(LONGEST_TEXT).collect(),
            colour: *colour,
            align: *align,
            size: within(*size, TEXT_SIZES[0], TEXT_SIZES[1]),
        },
        // One that this painter does not know yet.
        _ => return None,
    })
}

/// Draws the marks of overlays, given in pixels of a picture that covers an area given in points.
pub(crate) fn marks(p: &Painter, area: Rect, marks: &[Mark]) {
    let scale = p.ctx().pixels_per_point();
    let at = |[x, y]: Place2| area.min + vec2(x, y) / scale;
    let ink = |[r, g, b]: Colour| Color32::from_rgb(r, g, b);
    for mark in marks.iter().filter_map(sanitized) {
        match &mark {
            Mark::Line { from, to, colour, width } => {
                p.line_segment([at(*from), at(*to)], (*width, ink(*colour)));
            }
            Mark::Circle { centre, radius, colour } => {
                p.circle_stroke(at(*centre), radius / scale, (1.5, ink(*colour)));
            }
            Mark::Disc { centre, radius, colour } => {
                p.circle_filled(at(*centre), radius / scale, ink(*colour));
            }
            Mark::Panel { low, high, colour: [r, g, b], opacity } => {
                let alpha = (opacity.clamp(0.0, 1.0) * 255.0).round() as u8;
                let rect = Rect::from_min_max(at(*low), at(*high));
                p.rect_filled(rect, 0.0, Color32::from_rgba_unmultiplied(*r, *g, *b, alpha));
            }
            Mark::Text { at: place, text: words, colour, align, size } => {
                let align = match align {
                    Align::Left => Align2::LEFT_CENTER,
                    Align::Centre => Align2::CENTER_CENTER,
                    Align::Right => Align2::RIGHT_CENTER,
                };
                text(p, at(*place), align, words, *size, ink(*colour));
            }
            _ => {}
        }
    }
}

/// Draws the state of a flight over its picture, in an area given in points. What is shown above all panels is left out if `is_headed`.
pub(crate) fn flight(p: &Painter, area: Rect, r: &HudState, is_headed: bool) {
    marks(p, area, &r.marks_drawn);
    let inner = area.shrink(MARGIN);
    // A small window shows the bar and the directions first, and omits large parts.
    let roomy = inner.width() > 380.0 && inner.height() > 260.0;
    // The foot: the keys, the mandatory disclaimer, and the path's progress bar.
    let row = p.layout_no_wrap(DISCLAIMER.to_owned(), font(TEXT), SOFT).size();
    let fits_beside = inner.width() > row.x * 2.0;
    // What is left to read may be long: it is wrapped, and beside the disclaimer.
    let beside = if fits_beside && !is_headed { row.x + MARGIN } else { 0.0 };
    let place = p.layout(r.place.clone(), font(TEXT), INK, inner.width() - beside);
    let below = place.rows.len().saturating_sub(1) as f32;
    let rows = 1.0 + below + f32::from(u8::from(roomy)) + f32::from(u8::from(!fits_beside && !is_headed));
    let track = track(area);
    let foot = track.min.y - 4.0 - rows * row.y;
    p.rect_filled(Rect::from_min_max(pos2(area.min.x, foot - 4.0), area.max), 0.0, BACKING);
    along(p, track, &r.bar);
    let low = track.min.y - 3.0;
    for (n, line) in place.rows.iter().rev().enumerate() {
        text(p, pos2(inner.min.x, low - n as f32 * row.y), Align2::LEFT_BOTTOM, line.text().trim_end(), TEXT, INK);
    }
    if is_headed {
        // It stands in the header.
    } else if fits_beside {
        text(p, pos2(inner.max.x, low), Align2::RIGHT_BOTTOM, DISCLAIMER, TEXT, SOFT);
    } else {
        text(p, pos2(inner.min.x, low - (1.0 + below) * row.y), Align2::LEFT_BOTTOM, DISCLAIMER, TEXT, SOFT);
    }
    if roomy {
        text(p, pos2(inner.min.x, foot), Align2::LEFT_TOP, fitting(p, &r.keys, inner.width()), TEXT, SOFT);
    }
    let foot = foot - 8.0;
    let mut head: Vec<(&str, f32, Color32)> = Vec::new();
    if !is_headed {
        head.push((&r.state, 17.0, r.severity.colour()));
    }
    head.extend(r.more.iter().map(|l| (l.as_str(), TEXT, INK)));
    let figures = r.figures.iter().take(if roomy { usize::MAX } else { 1 });
    head.extend(figures.map(|l| (l.as_str(), TEXT, INK)));
    let wrap = (inner.width() * if roomy { 0.42 } else { 0.6 }).min(340.0);
    let panel = if head.is_empty() {
        Rect::from_min_size(inner.min, Vec2::ZERO)
    } else {
        lines(p, inner.min, Align2::LEFT_TOP, wrap, &head)
    };

    let d = &r.directions;
    // Beside the panel and above the foot, so that neither covers a label.
    let middle = pos2(area.center().x, (area.min.y + foot) * 0.5);
    let left_y = middle.y.max(panel.max.y + LABEL);
    label(p, pos2(inner.min.x, left_y), Align2::LEFT_CENTER, &d.left);
    label(p, pos2(inner.max.x, middle.y), Align2::RIGHT_CENTER, &d.right);
    label(p, pos2(middle.x.max(panel.max.x + LABEL), inner.min.y), Align2::CENTER_TOP, &d.top);
    label(p, pos2(middle.x, foot), Align2::CENTER_BOTTOM, &d.bottom);
    if roomy {
        label(p, inner.right_top(), Align2::RIGHT_TOP, &format!("ahead {}", d.ahead));
    }

    if let Some(m) = &r.message {
        let wrap = inner.width() * 0.8;
        lines(
            p,
            pos2(area.center().x, area.min.y + area.height() * 0.3),
            Align2::CENTER_CENTER,
            wrap,
            &[(m, 16.0, INK)],
        );
    }
}

/// Draws the bar: what was flown, what is a guess, the ends of the parts, where the operator was called, and the camera.
fn along(p: &Painter, track: Rect, bar: &Bar) {
    let at = |per_mille: u32| track.min.x + track.width() * per_mille.min(1000) as f32 / 1000.0;
    let stretch = |[from, to]: [u32; 2]| Rect::from_x_y_ranges(at(from)..=at(to).max(at(from) + 1.0), track.y_range());
    p.rect_filled(track, 3.0, Color32::from_black_alpha(190));
    for &guessed in &bar.guessed {
        p.rect_filled(stretch(guessed), 0.0, Color32::from_gray(90));
    }
    for &read in &bar.read {
        p.rect_filled(stretch(read), 3.0, ACCENT);
    }
    if let Some(expected) = bar.expected {
        let rect = stretch(expected).expand2(vec2(0.0, 2.0));
        p.rect_stroke(rect, 2.0, Stroke::new(1.5, EXPECTED), StrokeKind::Outside);
    }
    let tick = |per_mille: u32, size: Vec2, colour: Color32| {
        p.rect_filled(Rect::from_center_size(pos2(at(per_mille), track.center().y), size), 0.0, colour);
    };
    for &(end, _) in bar.parts.iter().filter(|p| p.0 < 1000) {
        tick(end, vec2(1.0, 8.0), SOFT);
    }
    for &call in &bar.calls {
        tick(call, vec2(4.0, 12.0), Severity::Alert.colour());
    }
    tick(bar.camera, vec2(4.0, 12.0), INK);
}

#[cfg(test)]
mod tests {
    use egui::{Context, LayerId, RawInput, Shape};

    use super::*;

    /// Returns what is drawn over a picture of 800 × 600 points.
    fn drawn(hud: &HudState) -> Vec<Shape> {
        let area = Rect::from_min_size(Pos2::ZERO, vec2(800.0, 600.0));
        let input = RawInput { screen_rect: Some(area), ..RawInput::default() };
        let output = Context::default().run_ui(input, |ui| {
            flight(&ui.ctx().layer_painter(LayerId::background()), area, hud, false);
        });
        output.shapes.into_iter().map(|s| s.shape).collect()
    }

    /// Returns the rectangle of a text.
    fn of_text(shapes: &[Shape], text: &str) -> Rect {
        let at = shapes.iter().find_map(|s| match s {
            Shape::Text(t) if t.galley.text() == text => Some(Rect::from_min_size(t.pos, t.galley.size())),
            _ => None,
        });
        at.unwrap_or_else(|| panic!("no text {text}"))
    }

    #[test]
    fn the_bar_shows_the_camera_and_the_calls_along_the_path() {
        let shapes = drawn(&HudState {
            bar: Bar { camera: 250, read: vec![[0, 250]], calls: vec![500, 1000], ..Bar::default() },
            ..HudState::default()
        });
        let places = |colour: Color32, size: Vec2| -> Vec<Pos2> {
            let rects = shapes.iter().filter_map(|s| if let Shape::Rect(r) = s { Some(r) } else { None });
            let alike = rects.filter(|r| r.fill == colour && (r.rect.size() - size).length() < 0.01);
            alike.map(|r| pos2(r.rect.center().x.round(), r.rect.center().y.round())).collect()
        };
        // The bar extends from 10 to 790, 8 points high, 6 above the lower edge.
        assert_eq!(places(INK, vec2(4.0, 12.0)), [pos2(205.0, 590.0)]);
        assert_eq!(places(Severity::Alert.colour(), vec2(4.0, 12.0)), [pos2(400.0, 590.0), pos2(790.0, 590.0)]);
        assert_eq!(places(ACCENT, vec2(195.0, 8.0)).len(), 1);
    }

    #[test]
    fn the_state_is_listed_in_the_corner_line_by_line() {
        let hud = HudState {
            state: "flying".to_owned(),
            more: vec!["on the way".to_owned()],
            figures: vec!["20 mm/s".to_owned()],
            ..HudState::default()
        };
        let shapes = drawn(&hud);
        let [state, more, figures] = ["flying", "on the way", "20 mm/s"].map(|t| of_text(&shapes, t));
        assert_eq!(state.min, pos2(18.0, 16.0), "8 and 6 points inside the box, which is 10 from the corner");
        for (line, above) in [(more, state), (figures, more)] {
            assert!((line.min - above.left_bottom()).length() < 1.0, "{line} below {above}");
        }
    }

    #[test]
    fn a_long_place_is_wrapped_and_covers_nothing() {
        let place = "cecum, 2050 of 2050 mm; not read: rectum, sigmoid, descending, splenic flexure (720 mm); sigmoid without \
                     gas for 42 mm: read it in slices";
        let shapes = drawn(&HudState { place: place.to_owned(), keys: "H keys".to_owned(), ..HudState::default() });
        let (keys, told) = (of_text(&shapes, "H keys"), of_text(&shapes, DISCLAIMER));
        let lines = ["cecum, 2050", "slices"].map(|part| {
            let line = shapes.iter().find_map(|s| match s {
                Shape::Text(t) if t.galley.text().contains(part) => Some(Rect::from_min_size(t.pos, t.galley.size())),
                _ => None,
            });
            line.unwrap_or_else(|| panic!("no line with {part}"))
        });
        assert!(lines[0].max.y <= lines[1].min.y + 2.0 && lines[0].min.y >= keys.max.y - 2.0, "{lines:?} {keys}");
        assert!(lines.iter().all(|l| l.min.x >= 0.0 && l.max.x <= told.min.x), "{lines:?} beside {told}");
    }

    #[test]
    fn directions_are_in_the_middle_of_the_edges() {
        let [left, right, top, bottom, ahead] = ["R", "L", "A", "P", "S"].map(str::to_owned);
        let directions = Directions { left, right, top, bottom, ahead };
        let shapes = drawn(&HudState { directions, ..HudState::default() });
        // The foot covers the whole width of the lower edge.
        let spans = |s: &Shape| match s {
            Shape::Rect(r) if r.rect.width() == 800.0 && r.rect.max.y == 600.0 => Some(r.rect.min.y),
            _ => None,
        };
        let foot = shapes.iter().find_map(spans).expect("a foot");
        let [left, right, top, bottom] = ["R", "L", "A", "P"].map(|t| of_text(&shapes, t));
        for side in [left, right] {
            assert!((side.center().y - 0.5 * foot).abs() < 4.0, "{side} above {foot}");
        }
        assert!(left.max.x < 40.0 && right.min.x > 760.0, "{left} {right}");
        for end in [top, bottom] {
            assert!((end.center().x - 400.0).abs() < 1.0, "{end}");
        }
        assert!(top.max.y < 50.0 && (foot - 40.0..foot).contains(&bottom.max.y), "{top} {bottom}");
    }
}
