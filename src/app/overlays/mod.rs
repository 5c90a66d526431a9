//! Built-in overlays: the camera's tentacles, the mines and forces that act on it (paper, figures 4 and 5), and how the colon
//! continues beyond the gas, drawn over the picture, and what lies behind and on the wall, as its colour.
//!
//! Each is one file, with its entry in [`BUILT_IN`]. All are hidden at first, and nothing is computed for a hidden one. What a
//! picture cannot show, because it begins at the eye or is behind the camera, is drawn in two small views of the surroundings
//! ([`surroundings`]), which the overlays share.
//!
//! The colours are close to those of Okabe and Ito (*Color Universal Design*, 2008), which colour-blind people can distinguish.
//! None is close to the pink of the wall, and no information is conveyed by colour alone.

mod built_in;
pub mod coats;
pub mod forces;
pub mod gaps;
pub mod mines;
pub mod surroundings;
pub mod tentacles;
pub mod translucency;

pub use built_in::BUILT_IN;

use crate::overlay::{Align, Canvas, Colour, Place2};

/// Outline of the marks, so that they stand out on every background.
const EDGE: Colour = [0, 0, 0];
const WHITE: Colour = [240, 240, 240];
const GREY: Colour = [170, 176, 184];
const ORANGE: Colour = [230, 159, 0];
const SKY: Colour = [86, 180, 233];
const GREEN: Colour = [0, 190, 140];
const YELLOW: Colour = [240, 228, 66];
const VERMILION: Colour = [240, 110, 30];
const VIOLET: Colour = [186, 150, 255];

/// Distance from the picture's edge, points.
const MARGIN: f32 = 10.0;
/// Height of the legend's text and of its rows, points.
const SMALL: f32 = 12.0;
const ROW: f32 = 17.0;

/// Draws a disc that stands out on every background.
fn dot(canvas: &mut Canvas, at: Place2, radius: f32, colour: Colour) {
    canvas.disc(at, radius + canvas.scale(), EDGE);
    canvas.disc(at, radius, colour);
}

/// Draws a ring that stands out on every background.
fn ring(canvas: &mut Canvas, at: Place2, radius: f32, colour: Colour) {
    for beside in [-1.0, 1.0] {
        canvas.circle(at, radius + beside * canvas.scale(), EDGE);
    }
    canvas.circle(at, radius, colour);
}

/// Draws an arrow that stands out on every background; a point if its length is zero.
fn arrow(canvas: &mut Canvas, from: Place2, to: Place2, colour: Colour) {
    let pt = canvas.scale();
    let [x, y] = [to[0] - from[0], to[1] - from[1]];
    let length = x.hypot(y);
    if length < 2.0 * pt {
        dot(canvas, to, 2.0 * pt, colour);
        return;
    }
    let [x, y] = [x / length, y / length];
    let head = (0.4 * length).min(8.0 * pt);
    let side = |s: f32| [to[0] - head * (x - s * 0.5 * y), to[1] - head * (y + s * 0.5 * x)];
    for (width, colour) in [(4.0, EDGE), (2.2, colour)] {
        canvas.stroke(from, to, width, colour);
        canvas.stroke(side(1.0), to, width, colour);
        canvas.stroke(side(-1.0), to, width, colour);
    }
}

/// Returns the lower edge of the area that is free for legends and views, pixels.
fn bottom(canvas: &Canvas) -> f32 {
    canvas.size()[1] - canvas.foot().max(MARGIN * canvas.scale())
}

/// Adds a row to the legend, which grows upwards from the picture's lower left corner, and draws its background. Returns the left
/// end of the row's middle line; `None` if the picture has no room for it.
fn legend_row(canvas: &mut Canvas) -> Option<Place2> {
    let pt = canvas.scale();
    let [width, height] = canvas.size();
    let (row, bottom) = (canvas.take("legend", 1) as f32, bottom(canvas));
    let wide = (0.5 * width - 48.0 * pt).min(310.0 * pt);
    // Whole pixels, so that rows meet without a seam.
    let [low, high] = [row + 1.0, row].map(|n| (bottom - ROW * n * pt).round());
    if wide < 120.0 * pt || low < 0.5 * height {
        return None;
    }
    let left = (MARGIN * pt).round();
    canvas.panel([left, low], [(left + wide).round(), high], EDGE, 0.82);
    Some([left + 8.0 * pt, 0.5 * (low + high)])
}

/// Writes into a row of the legend, `right` points from its left end.
fn legend_text(canvas: &mut Canvas, row: Place2, right: f32, text: impl Into<String>, colour: Colour) {
    let at = [row[0] + right * canvas.scale(), row[1]];
    canvas.label(at, Align::Left, SMALL, text, colour);
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DVec3;

    use super::*;
    use crate::fields::Lumen;
    use crate::overlay::Mark;
    use crate::render::View;
    use crate::testing::Room;
    use crate::{FlightApp, Overlay, Plan, Scene};

    /// Returns a flight along +y through a room of 20 × 80 × 20 mm, 60 mm from its beginning.
    pub(super) fn flight_in_a_room(scene: Scene) -> FlightApp {
        let volume = Room::new([20, 80, 20]).scan();
        let lumen = Arc::new(Lumen::none(volume.voxels().grid()));
        let [start, goal] = [60.0, 75.0].map(|y| DVec3::new(10.0, y, 10.0));
        FlightApp::new(volume, lumen, Plan::between(start, goal, 15.0), scene).unwrap()
    }

    /// Returns what an overlay draws over a picture of the flight, on a screen of `scale` pixels per point.
    pub(super) fn drawn(overlay: &Overlay, flight: &FlightApp, [width, height]: [usize; 2], scale: f32) -> Vec<Mark> {
        let pose = flight.pose();
        let view = View::new(pose.position, pose.attitude.forward, pose.attitude.up, 90.0, width, height).unwrap();
        let mut canvas = Canvas::at_scale(view, scale);
        canvas.draw(overlay, flight).unwrap();
        canvas.into_marks()
    }

    /// Returns the texts among marks.
    pub(super) fn texts(marks: &[Mark]) -> Vec<&str> {
        marks.iter().filter_map(|m| if let Mark::Text { text, .. } = m { Some(text.as_str()) } else { None }).collect()
    }

    fn canvas([width, height]: [usize; 2], scale: f32) -> Canvas {
        Canvas::at_scale(View::new(DVec3::ZERO, DVec3::Y, DVec3::Z, 90.0, width, height).unwrap(), scale)
    }

    #[test]
    fn a_dot_lies_over_its_edge() {
        let mut canvas = canvas([200, 100], 2.0);
        dot(&mut canvas, [50.0, 40.0], 6.0, ORANGE);
        let disc = |radius, colour| Mark::Disc { centre: [50.0, 40.0], radius, colour };
        assert_eq!(canvas.into_marks(), [disc(8.0, EDGE), disc(6.0, ORANGE)], "the last one is on top");
    }

    #[test]
    fn the_legend_grows_upwards_and_is_as_wide_as_half_the_picture_allows() {
        let panel = |row: Option<Place2>, canvas: Canvas| match (row, canvas.into_marks().pop()) {
            (Some(at), Some(Mark::Panel { low, high, .. })) => Some((at, low, high)),
            (None, None) => None,
            other => panic!("{other:?}"),
        };
        // At two pixels a point the lower edge is at 780 and a row 34 pixels high. Half the width less 96 pixels is 704, but
        // a row has at most 620.
        let mut wide = canvas([1600, 800], 2.0);
        let first = legend_row(&mut wide);
        assert_eq!(panel(first, wide.clone()), Some(([36.0, 763.0], [20.0, 746.0], [640.0, 780.0])));
        let second = legend_row(&mut wide);
        assert_eq!(panel(second, wide), Some(([36.0, 729.0], [20.0, 712.0], [640.0, 746.0])));
        // 800 / 2 - 96 = 304 pixels.
        let mut narrow = canvas([800, 800], 2.0);
        let row = legend_row(&mut narrow);
        assert_eq!(panel(row, narrow), Some(([36.0, 763.0], [20.0, 746.0], [324.0, 780.0])));
        // 600 / 2 - 96 = 204 pixels are less than the 240 that a row needs.
        let mut too_narrow = canvas([600, 800], 2.0);
        let row = legend_row(&mut too_narrow);
        assert_eq!(panel(row, too_narrow), None);
        // The upper half of a picture stays free.
        let mut low = canvas([1600, 80], 2.0);
        let rows = [legend_row(&mut low), legend_row(&mut low)];
        assert_eq!(rows, [None, None], "60 - 34 pixels are above the middle");
    }

    #[test]
    fn an_arrow_has_a_head_at_its_tip_and_is_a_dot_if_it_is_short() {
        let drawn = |to: Place2| {
            let mut canvas = canvas([200, 100], 1.0);
            arrow(&mut canvas, [50.0, 40.0], to, ORANGE);
            canvas.into_marks()
        };
        for to in [[51.9, 40.0], [50.0, 40.0], [50.0, 38.5]] {
            assert!(drawn(to).iter().all(|m| matches!(m, Mark::Disc { .. })), "{to:?}");
        }
        let marks = drawn([70.0, 40.0]);
        let ends: Vec<_> = marks
            .iter()
            .filter_map(|m| if let Mark::Line { from, to, .. } = m { Some((*from, *to)) } else { None })
            .collect();
        // The shaft and both sides of the head, 8 points long, each on its edge.
        assert_eq!(ends.len(), 6);
        assert_eq!(ends[3], ([50.0, 40.0], [70.0, 40.0]));
        assert_eq!([ends[4], ends[5]], [([62.0, 36.0], [70.0, 40.0]), ([62.0, 44.0], [70.0, 40.0])]);
    }

    #[test]
    fn a_ring_has_an_edge_within_and_around_it() {
        let mut canvas = canvas([200, 100], 2.0);
        ring(&mut canvas, [50.0, 40.0], 10.0, ORANGE);
        let circle = |radius, colour| Mark::Circle { centre: [50.0, 40.0], radius, colour };
        assert_eq!(canvas.into_marks(), [circle(8.0, EDGE), circle(12.0, EDGE), circle(10.0, ORANGE)]);
    }

    #[test]
    fn the_camera_stands_in_the_middle_of_the_height_of_its_surroundings() {
        let flight = flight_in_a_room(Scene::guided_by("tentacles"));
        let at = flight.pose().position;
        let pose = flight.pose();
        let view = View::new(at, pose.attitude.forward, pose.attitude.up, 90.0, 800, 600).unwrap();
        let mut canvas = Canvas::at_scale(view, 1.0);
        let panes = surroundings::surroundings(&flight, &mut canvas).unwrap();
        let panels: Vec<_> = canvas
            .into_marks()
            .into_iter()
            .filter_map(|m| if let Mark::Panel { low, high, .. } = m { Some((low, high)) } else { None })
            .collect();
        for (pane, (low, high)) in panes.iter().zip(panels) {
            let [x, y] = pane.find(at);
            // The title is above the view.
            let top = low[1] + 17.0;
            assert!((y - 0.5 * (top + high[1])).abs() < 1.0, "{y} between {top} and {}", high[1]);
            assert!(x > low[0] && x < high[0], "{x}");
            assert!(pane.holds(pane.find(at + pose.attitude.forward * 5.0)));
        }
    }
}
