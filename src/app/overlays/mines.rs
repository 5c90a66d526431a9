//! The mines: in the picture, filled if visible and hollow if behind a wall. Mines behind the camera appear in the views of the
//! surroundings.

use super::surroundings::surroundings;
use super::{EDGE, GREY, SMALL, WHITE, YELLOW, dot, legend_row, legend_text, ring};
use crate::components::guide::MineField;
use crate::overlay::{Align, Canvas, Place2};
use crate::space::first_crossing;
use crate::{FlightApp, Overlay};

/// The overlay.
pub const OVERLAY: Overlay =
    Overlay { name: "mines", summary: "mines: laid behind the camera", shown: false, draw, ..Overlay::PLAIN };

/// A mine is drawn at the apparent size of a ball of this radius, mm.
const RADIUS_MM: f64 = 1.2;

fn draw(flight: &FlightApp, canvas: &mut Canvas) {
    let Some(field) = flight.camera::<MineField>() else {
        if let Some(row) = legend_row(canvas) {
            legend_text(canvas, row, 0.0, "this flight has no mines", GREY);
        }
        return;
    };
    let pt = canvas.scale();
    let at = flight.pose().position;
    let right = flight.pose().attitude.right();
    let panes = surroundings(flight, canvas);
    let mut pushing = 0;
    // From the last mine to the first, back along the path.
    let mut last = at;
    for mine in field.mines.iter().collect::<Vec<_>>().into_iter().rev() {
        let distance = at.distance(mine);
        pushing += usize::from(distance < field.settings.reach_mm);
        let direction = (mine - at).normalize_or_zero();
        let in_sight = first_crossing(flight.shown_scan(), at, direction, distance).is_none();
        if let (Some(place), Some(edge)) = (canvas.find(mine), canvas.find(mine + right * RADIUS_MM)) {
            let radius = (edge[0] - place[0]).hypot(edge[1] - place[1]).clamp(4.0 * pt, 16.0 * pt);
            marker(canvas, place, radius, in_sight);
            if in_sight {
                let below = [place[0], place[1] + radius + 9.0 * pt];
                canvas.label([below[0] + pt, below[1] + pt], Align::Centre, SMALL, format!("{distance:.0} mm"), EDGE);
                canvas.label(below, Align::Centre, SMALL, format!("{distance:.0} mm"), WHITE);
            }
        }
        for pane in panes.iter().flatten() {
            let place = pane.find(mine);
            pane.stroke(canvas, pane.find(last), place, 1.0, YELLOW);
            if pane.holds(place) {
                marker(canvas, place, 4.0 * pt, in_sight);
            }
        }
        last = mine;
    }
    if let Some(row) = legend_row(canvas) {
        legend_text(canvas, row, 0.0, "mines", WHITE);
        for (right, in_sight, text) in [(42.0, true, "in view"), (106.0, false, "hidden")] {
            marker(canvas, [row[0] + (right + 5.0) * pt, row[1]], 4.5 * pt, in_sight);
            legend_text(canvas, row, right + 16.0, text, WHITE);
        }
        let (count, kept) = (field.mines.len(), field.settings.kept);
        legend_text(canvas, row, 170.0, format!("{count} of {kept}, {pushing} push"), WHITE);
    }
}

/// Draws a disc with a cross if the mine is visible, otherwise a ring with a cross.
fn marker(canvas: &mut Canvas, at: Place2, radius: f32, in_sight: bool) {
    let ink = if in_sight { EDGE } else { YELLOW };
    if in_sight {
        dot(canvas, at, radius, YELLOW);
    } else {
        ring(canvas, at, radius, YELLOW);
    }
    let arm = 0.55 * radius;
    canvas.stroke([at[0] - arm, at[1] - arm], [at[0] + arm, at[1] + arm], 1.4, ink);
    canvas.stroke([at[0] - arm, at[1] + arm], [at[0] + arm, at[1] - arm], 1.4, ink);
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::Scene;
    use crate::dynamics::mines::MineSettings;
    use crate::overlays::tests::{drawn, flight_in_a_room, texts};

    #[test]
    fn the_legend_counts_the_mines_and_those_that_push() {
        let mut flight = flight_in_a_room(Scene::guided_by("tentacles"));
        let at = flight.pose().position;
        let mut field = flight.camera_mut::<MineField>().unwrap();
        let settings = MineSettings { kept: 12, spacing_mm: 8.0, reach_mm: 25.0, push: 60.0 };
        field.settings = settings;
        field.mines.clear();
        // A mine is laid 3 mm behind the position: 40, 26, 24 and 10 mm from the camera.
        for behind in [37.0, 23.0, 21.0, 7.0] {
            field.mines.lay_behind(at - DVec3::Y * behind, DVec3::Y, &settings);
        }
        let marks = drawn(&OVERLAY, &flight, [800, 600], 1.0);
        assert!(texts(&marks).contains(&"4 of 12, 2 push"), "{:?}", texts(&marks));
        let without = flight_in_a_room(Scene { mines: None, ..Scene::guided_by("tentacles") });
        assert_eq!(texts(&drawn(&OVERLAY, &without, [800, 600], 1.0)), ["this flight has no mines"]);
    }

    /// A mine far behind, seen by a camera that looks back.
    #[test]
    fn a_mine_in_sight_is_as_large_as_it_appears() {
        let mut flight = flight_in_a_room(Scene::guided_by("tentacles"));
        let at = flight.pose().position;
        let settings = flight.camera::<MineField>().unwrap().settings;
        let mut field = flight.camera_mut::<MineField>().unwrap();
        field.mines.clear();
        field.mines.lay_behind(at - DVec3::Y * 32.0, DVec3::Y, &settings);
        let mine = flight.camera::<MineField>().unwrap().mines.iter().next().unwrap();
        assert!(flight.place(at, DVec3::NEG_Y, DVec3::Z));
        let marks = drawn(&OVERLAY, &flight, [800, 600], 1.0);
        // 300 pixels are the tangent of 45°.
        let wanted = (300.0 * RADIUS_MM / at.distance(mine)) as f32;
        let middle = |c: &[f32; 2]| (c[0] - 400.0).abs() < 1.0 && (c[1] - 300.0).abs() < 1.0;
        let radii: Vec<f32> = marks
            .iter()
            .filter_map(|m| {
                if let crate::overlay::Mark::Disc { centre, radius, .. } = m {
                    middle(centre).then_some(*radius)
                } else {
                    None
                }
            })
            .collect();
        assert!(wanted > 4.0 && wanted < 16.0, "{wanted}");
        assert!(radii.iter().any(|r| (r - wanted).abs() < 1.6), "{radii:?}, not {wanted}");
    }

    #[test]
    fn a_near_mine_has_the_largest_mark_at_any_density() {
        let mut flight = flight_in_a_room(Scene::guided_by("tentacles"));
        let at = flight.pose().position;
        let settings = flight.camera::<MineField>().unwrap().settings;
        let mut field = flight.camera_mut::<MineField>().unwrap();
        field.mines.clear();
        field.mines.lay_behind(at - DVec3::Y * 3.0, DVec3::Y, &settings);
        assert!(flight.place(at, DVec3::NEG_Y, DVec3::Z));
        for scale in [1.0, 2.0] {
            let marks = drawn(&OVERLAY, &flight, [800, 600], scale);
            let discs = marks.iter().filter_map(|m| {
                if let crate::overlay::Mark::Disc { centre, radius, .. } = m { Some((*centre, *radius)) } else { None }
            });
            let most = discs
                .filter(|(c, _)| (c[0] - 400.0).abs() < 2.0 && (c[1] - 300.0).abs() < 2.0)
                .map(|d| d.1)
                .fold(0.0, f32::max);
            assert!((most - 16.0 * scale).abs() <= 2.0 * scale, "{most} pixels at {scale}");
        }
    }
}
