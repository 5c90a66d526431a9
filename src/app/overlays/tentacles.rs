//! The tentacles: where each of them meets the wall, and at which distance.
//!
//! A tentacle begins at the eye, so in the picture it is a point: the point of the wall that it touches, drawn larger the nearer it
//! is. Nothing can hide that point, since the ray that found it went there. The views of the surroundings show tentacles as lines.

use super::surroundings::surroundings;
use super::{GREY, ORANGE, SKY, WHITE, dot, legend_row, legend_text, ring};
use crate::components::guide::Tentacles;
use crate::overlay::{Canvas, Colour};
use crate::{FlightApp, Overlay};

/// The overlay.
pub const OVERLAY: Overlay = Overlay {
    name: "tentacles",
    summary: "tentacles: where they touch the wall",
    shown: false,
    draw,
    ..Overlay::PLAIN
};

/// Tentacles of at least this length have the colour of far ones, mm.
const FAR_MM: f64 = 60.0;
/// Length at which tentacles are white, mm.
const MIDDLE_MM: f64 = 25.0;
/// Tentacles that leave a view's plane by more than this (as a sine) are not drawn in it.
const LEAVES: f64 = 0.25;

/// Returns the colour of a length: orange near, white between, blue far.
fn colour(length: f64) -> Colour {
    let (from, to, share) = if length < MIDDLE_MM {
        (ORANGE, WHITE, length / MIDDLE_MM)
    } else {
        (WHITE, SKY, (length - MIDDLE_MM) / (FAR_MM - MIDDLE_MM))
    };
    let share = share.clamp(0.0, 1.0);
    std::array::from_fn(|c| (f64::from(from[c]) + (f64::from(to[c]) - f64::from(from[c])) * share).round() as u8)
}

fn draw(flight: &FlightApp, canvas: &mut Canvas) {
    let Some(t) = flight.camera::<Tentacles>() else {
        if let Some(row) = legend_row(canvas) {
            legend_text(
                canvas,
                row,
                0.0,
                format!("the guide {} has no tentacles", flight.setup().scene.guide_name()),
                GREY,
            );
        }
        return;
    };
    let pt = canvas.scale();
    let at = flight.pose().position;
    let [width, height] = canvas.size();
    for (&direction, &length) in t.directions.iter().zip(&t.lengths) {
        let Some([x, y]) = canvas.find(at + direction * length) else { continue };
        if !(-9.0 * pt..width + 9.0 * pt).contains(&x) || !(-9.0 * pt..height + 9.0 * pt).contains(&y) {
            continue;
        }
        let radius = (2.0 + 60.0 / length.max(1.0)).min(8.0) as f32 * pt;
        if length < t.settings.reach_mm {
            dot(canvas, [x, y], radius, colour(length));
        } else {
            ring(canvas, [x, y], 4.0 * pt, SKY);
        }
        if length < t.settings.wall_mm {
            ring(canvas, [x, y], radius + 3.0 * pt, ORANGE);
        }
    }
    for pane in surroundings(flight, canvas).into_iter().flatten() {
        for (&direction, &length) in t.directions.iter().zip(&t.lengths) {
            if pane.leaves(direction) < LEAVES {
                let tip = pane.find(at + direction * length);
                if pane.stroke(canvas, pane.find(at), tip, 1.0, colour(length)) {
                    canvas.disc(tip, 1.8 * pt, colour(length));
                }
            }
        }
    }
    legend(t, canvas);
}

fn legend(t: &Tentacles, canvas: &mut Canvas) {
    let pt = canvas.scale();
    if let Some(row) = legend_row(canvas) {
        dot(canvas, [row[0] + 5.0 * pt, row[1]], 3.0 * pt, ORANGE);
        ring(canvas, [row[0] + 5.0 * pt, row[1]], 6.0 * pt, ORANGE);
        legend_text(canvas, row, 16.0, format!("repels, within {:.0} mm", t.settings.wall_mm), WHITE);
        ring(canvas, [row[0] + 155.0 * pt, row[1]], 4.0 * pt, SKY);
        legend_text(canvas, row, 166.0, format!("no wall in {:.0} mm", t.settings.reach_mm), WHITE);
    }
    if let Some(row) = legend_row(canvas) {
        let shortest = t.lengths.iter().copied().fold(f64::INFINITY, f64::min);
        legend_text(canvas, row, 0.0, format!("{} tentacles, from {shortest:.1} mm", t.lengths.len()), WHITE);
        for n in 0..40 {
            let x = row[0] + (162.0 + 1.2 * n as f32) * pt;
            let ink = colour(FAR_MM * f64::from(n) / 40.0);
            canvas.stroke([x, row[1] - 4.0 * pt], [x, row[1] + 4.0 * pt], 2.2, ink);
        }
        legend_text(canvas, row, 215.0, format!("to {FAR_MM:.0} mm"), WHITE);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scene;
    use crate::overlay::Mark;
    use crate::overlays::tests::{drawn, flight_in_a_room, texts};

    #[test]
    fn near_is_orange_and_far_is_blue() {
        assert_eq!((colour(0.0), colour(MIDDLE_MM), colour(FAR_MM)), (ORANGE, WHITE, SKY));
        assert_eq!(colour(1e9), SKY);
    }

    #[test]
    fn tentacles_are_counted_and_drawn_where_they_touch() {
        let mut flight = flight_in_a_room(Scene::guided_by("tentacles"));
        flight.step().unwrap();
        let count = flight.camera::<Tentacles>().unwrap().lengths.len();
        let marks = drawn(&OVERLAY, &flight, [800, 600], 1.0);
        let count = format!("{count} tentacles, from ");
        assert!(texts(&marks).iter().any(|t| t.starts_with(&count)), "{:?}", texts(&marks));
        // The legend has a dot of two discs. The others are tips of tentacles.
        assert!(marks.iter().filter(|m| matches!(m, Mark::Disc { .. })).count() > 2);
        let without = drawn(&OVERLAY, &flight_in_a_room(Scene::guided_by("manual")), [800, 600], 1.0);
        assert_eq!(texts(&without), ["the guide manual has no tentacles"]);
    }

    /// A tip beyond the picture's edge by more than its mark is not drawn, on each side.
    #[test]
    fn tips_outside_the_picture_are_left_out() {
        let mut flight = flight_in_a_room(Scene::guided_by("tentacles"));
        flight.step().unwrap();
        let discs = |size: [usize; 2]| -> Vec<[f32; 2]> {
            let marks = drawn(&OVERLAY, &flight, size, 2.0);
            marks.iter().filter_map(|m| if let Mark::Disc { centre, .. } = m { Some(*centre) } else { None }).collect()
        };
        for size in [[800, 600], [400, 600], [800, 300]] {
            let all = discs(size);
            assert!(!all.is_empty());
            let [w, h] = size.map(|n| n as f32);
            for c in &all {
                assert!(c[0] >= -18.0 && c[0] <= w + 18.0 && c[1] >= -18.0 && c[1] <= h + 18.0, "{c:?} in {size:?}");
            }
            // Some are beyond the edge by less than that, and some near it within.
            let near = |x: f32, edge: f32| (x - edge).abs() < 60.0;
            assert!(
                all.iter().any(|c| near(c[0], 0.0) || near(c[0], w) || near(c[1], 0.0) || near(c[1], h)),
                "{size:?}"
            );
        }
    }

    /// A mark reaches at most 9 points from its tip, which are 18 pixels on this screen.
    #[test]
    fn a_tip_beside_the_picture_is_drawn_while_its_mark_reaches_in() {
        let mut flight = flight_in_a_room(Scene::guided_by("tentacles"));
        let attitude = flight.pose().attitude;
        let mut is_drawn = |x: f64, y: f64| {
            // 300 pixels are the tangent of 45°.
            let aside = attitude.right() * ((x - 400.0) / 300.0) - attitude.up * ((y - 300.0) / 300.0);
            let mut tentacles = flight.camera_mut::<Tentacles>().unwrap();
            tentacles.directions = vec![(attitude.forward + aside).normalize()];
            tentacles.lengths = vec![20.0];
            let marks = drawn(&OVERLAY, &flight, [800, 600], 2.0);
            marks.iter().any(|m| {
                matches!(m, Mark::Disc { centre, .. }
                    if (f64::from(centre[0]) - x).abs() < 0.5 && (f64::from(centre[1]) - y).abs() < 0.5)
            })
        };
        for (beside, expected) in [(-8.0, true), (14.0, true), (22.0, false)] {
            for (x, y) in [(-beside, 300.0), (800.0 + beside, 300.0), (400.0, -beside), (400.0, 600.0 + beside)] {
                assert_eq!(is_drawn(x, y), expected, "{x}, {y}");
            }
        }
    }
}
