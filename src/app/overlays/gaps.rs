//! How the colon continues beyond the gas: dashed lines through fluid, and where the lumen is collapsed.
//!
//! A line through collapsed lumen is a guess, and labelled as one. Lines are drawn over walls, because they begin behind one.

use glam::DVec3;

use super::surroundings::surroundings;
use super::{EDGE, GREY, SKY, SMALL, VERMILION, WHITE, legend_row, legend_text};
use crate::fields::connection::{Stretch, StretchKind};
use crate::overlay::{Align, Canvas, Colour};
use crate::{FlightApp, Overlay};

/// The overlay.
pub const OVERLAY: Overlay = Overlay {
    name: "gaps",
    summary: "gaps: how the colon continues where gas ends",
    shown: false,
    draw,
    ..Overlay::PLAIN
};

/// Length of a dash, and of the space behind it, mm.
const DASH_MM: f64 = 3.0;
/// Distance from the camera within which a stretch is drawn, mm. Others would only confuse.
const NEAR_MM: f64 = 150.0;

fn draw(flight: &FlightApp, canvas: &mut Canvas) {
    let searching = flight.seek_connection();
    let gaps: Vec<&Stretch> = flight
        .found_connection()
        .into_iter()
        .flat_map(|way| &way.stretches)
        .filter(|s| s.kind != StretchKind::Gas)
        .collect();
    let at = flight.pose().position;
    let near =
        |s: &&Stretch| [s.points.first(), s.points.last()].into_iter().flatten().any(|p| p.distance(at) < NEAR_MM);
    let drawn: Vec<&Stretch> = gaps.iter().copied().filter(near).collect();
    let panes = if drawn.is_empty() { None } else { surroundings(flight, canvas) };
    for stretch in drawn {
        let colour = colour(stretch.kind);
        for [a, b] in dashes(&stretch.points) {
            if let (Some(from), Some(to)) = (canvas.find(a), canvas.find(b)) {
                for (width, colour) in [(4.0, EDGE), (2.2, colour)] {
                    canvas.stroke(from, to, width, colour);
                }
            }
            for pane in panes.iter().flatten() {
                pane.stroke(canvas, pane.find(a), pane.find(b), 1.8, colour);
            }
        }
        if let Some(place) = stretch.points.get(stretch.points.len() / 2).and_then(|&p| canvas.find(p)) {
            let (text, below) = (text(stretch), [place[0], place[1] + 14.0 * canvas.scale()]);
            canvas.label(below.map(|x| x + canvas.scale()), Align::Centre, SMALL, text.clone(), EDGE);
            canvas.label(below, Align::Centre, SMALL, text, colour);
        }
    }
    if let Some(row) = legend_row(canvas) {
        let guessed: f64 = gaps.iter().filter(|s| s.kind == StretchKind::Collapsed).map(|s| s.length_mm).sum();
        let (text, colour) = match (searching, gaps.len()) {
            (true, _) => ("connecting the segments".to_owned(), GREY),
            (false, 0) => ("no gaps along the path".to_owned(), GREY),
            (false, n) => (format!("{n} gaps, {guessed:.0} mm of them a guess"), WHITE),
        };
        legend_text(canvas, row, 0.0, text, colour);
    }
}

fn colour(kind: StretchKind) -> Colour {
    if kind == StretchKind::Fluid { SKY } else { VERMILION }
}

fn text(stretch: &Stretch) -> String {
    match stretch.kind {
        StretchKind::Collapsed => format!("collapsed, {:.0} mm: a guess", stretch.length_mm),
        StretchKind::Fluid => format!("fluid, {:.0} mm", stretch.length_mm),
        _ => String::new(),
    }
}

/// Returns the parts of a line that are drawn, world, mm: of twice [`DASH_MM`] the first half.
fn dashes(points: &[DVec3]) -> Vec<[DVec3; 2]> {
    let mut along = 0.0;
    let mut out = Vec::new();
    for w in points.windows(2) {
        if along % (2.0 * DASH_MM) < DASH_MM {
            out.push([w[0], w[1]]);
        }
        along += w[0].distance(w[1]);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scene;
    use crate::overlays::tests::{drawn, flight_in_a_room, texts};

    #[test]
    fn a_line_is_dashed_by_its_length() {
        let line: Vec<DVec3> = (0..12).map(|n| DVec3::X * f64::from(n)).collect();
        let begins: Vec<f64> = dashes(&line).iter().map(|d| d[0].x).collect();
        assert_eq!(begins, [0.0, 1.0, 2.0, 6.0, 7.0, 8.0]);
        assert!(dashes(&[]).is_empty() && dashes(&[DVec3::NAN; 3]).len() <= 2);
    }

    #[test]
    fn without_a_gap_that_is_said() {
        let flight = flight_in_a_room(Scene::guided_by("tentacles"));
        assert!(flight.connection().unwrap().is_none());
        assert_eq!(texts(&drawn(&OVERLAY, &flight, [800, 600], 1.0)), ["no gaps along the path"]);
    }

    #[test]
    fn a_guess_says_that_it_is_one() {
        let stretch = |kind| Stretch { kind, length_mm: 44.6, from: 0, to: 1, points: Vec::new() };
        assert_eq!(text(&stretch(StretchKind::Collapsed)), "collapsed, 45 mm: a guess");
        assert_eq!(text(&stretch(StretchKind::Fluid)), "fluid, 45 mm");
        assert_ne!(colour(StretchKind::Collapsed), colour(StretchKind::Fluid));
    }
}
