//! The forces on the camera (paper, figure 4): those that push, pull and slow it, and their sum.
//!
//! They act at the eye. In the picture they are drawn on a cross in its middle, some distance ahead: components across the view
//! appear at full length, components along it are foreshortened. In the views of the surroundings they begin at the camera.

use glam::DVec3;

use super::surroundings::surroundings;
use super::{EDGE, GREEN, GREY, SKY, SMALL, VERMILION, VIOLET, WHITE, YELLOW, arrow, legend_row, legend_text};
use crate::components::camera::Velocity;
use crate::components::flight::State;
use crate::components::guide::{GuideThrust, MinePush, PotentialField};
use crate::components::input::Hand;
use crate::dynamics::Potential;
use crate::overlay::{Align, Canvas, Colour, Place2};
use crate::systems::motion::acting;
use crate::{FlightApp, Overlay};

/// The overlay.
pub const OVERLAY: Overlay =
    Overlay { name: "forces", summary: "forces on the camera (vectors)", shown: false, draw, ..Overlay::PLAIN };

/// Length of an arrow in the views of the surroundings, and in the picture, mm for each mm/s².
const MM_A_FORCE: f64 = 0.16;
const IN_PICTURE: f64 = 0.12;
/// Smallest distance of the arrows' origin in the picture, mm. They begin at the distance at which this length spans twice as much.
const AHEAD_MM: f64 = 30.0;
/// Longest arrow in the picture, mm: it must not reach behind the camera.
const LONGEST_MM: f64 = 26.0;
/// Weaker forces than this are not drawn, mm/s².
const WEAK: f64 = 2.0;

/// A force on the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Force {
    /// Its name.
    pub name: &'static str,
    /// The letter at its arrow.
    pub letter: &'static str,
    /// Force divided by the camera's mass, world mm/s².
    pub acceleration: DVec3,
    colour: Colour,
}

/// Returns all forces that act on a flight's camera now, with their sum last. Empty if nothing moves the camera, or a log does.
pub fn forces(flight: &FlightApp) -> Vec<Force> {
    if !flight.setup().scene.moves() || flight.setup().scene.play().is_some() {
        return Vec::new();
    }
    let body = flight.setup().scene.body;
    let (hand, guide) = (flight.camera::<Hand>(), flight.camera::<GuideThrust>());
    let timed_commands = acting(&flight.flight(), hand, guide, flight.camera::<MinePush>());
    let [field_wall, field_target] = by_field(flight, hand);
    let velocity = flight.camera::<Velocity>().map_or(DVec3::ZERO, |v| v.0);
    let pull = if flight.camera::<PotentialField>().is_some() { "target's pull" } else { "guide's thrust" };
    let force = |name, letter, acceleration, colour| Force { name, letter, acceleration, colour };
    let mut all = vec![
        force("wall's push", "W", timed_commands.wall + field_wall, VERMILION),
        force("mines' push", "M", timed_commands.mines, YELLOW),
        force(pull, "G", timed_commands.drive - timed_commands.mines + field_target, GREEN),
        force("operator's push", "H", timed_commands.hand, VIOLET),
        force("drag", "D", velocity * -body.drag_per_s, SKY),
    ];
    let sum = all.iter().map(|f| f.acceleration).sum();
    all.push(force("sum", "S", sum, WHITE));
    all
}

/// Returns the accelerations by the wall and the target of a potential, world mm/s², as in the step of the body.
fn by_field(flight: &FlightApp, hand: Option<&Hand>) -> [DVec3; 2] {
    let stopped = hand.is_some_and(|h| h.paused && h.push == DVec3::ZERO);
    let Some(field) = flight.camera::<PotentialField>().filter(|_| !stopped) else { return [DVec3::ZERO; 2] };
    let (at, mass) = (flight.pose().position, flight.setup().scene.body.mass_g);
    let pace = if flight.flight().state == State::Flying { hand.map_or(1.0, Hand::pace) } else { 0.0 };
    let target = field.target.as_ref().filter(|_| pace > 0.0).and_then(|t| t.sample(at));
    let pull = Potential { target_force: field.potential.target_force * pace, ..field.potential };
    [field.potential.at(field.wall.sample(at), None).gradient / -mass, pull.at(None, target).gradient / -mass]
}

fn draw(flight: &FlightApp, canvas: &mut Canvas) {
    let all = forces(flight);
    if all.is_empty() {
        if let Some(row) = legend_row(canvas) {
            legend_text(canvas, row, 0.0, "no forces: the camera is where the log says", GREY);
        }
        return;
    }
    let pose = flight.pose();
    let view = canvas.view();
    let tangent = view.pixel().map_or(1.0, |pixel| 0.5 * pixel * view.width().min(view.height()) as f64);
    let origin = pose.position + pose.attitude.forward * (AHEAD_MM / tangent.min(1.0));
    if let Some(from) = canvas.find(origin) {
        let arm = 5.0 * canvas.scale();
        for (width, colour) in [(3.0, EDGE), (1.2, WHITE)] {
            canvas.stroke([from[0] - arm, from[1]], [from[0] + arm, from[1]], width, colour);
            canvas.stroke([from[0], from[1] - arm], [from[0], from[1] + arm], width, colour);
        }
        for force in strong(&all) {
            let direction = (force.acceleration * IN_PICTURE).clamp_length_max(LONGEST_MM);
            if let Some(tip) = canvas.find(origin + direction) {
                arrow(canvas, from, tip, force.colour);
                letter(canvas, from, tip, force);
            }
        }
    }
    for pane in surroundings(flight, canvas).into_iter().flatten() {
        for force in strong(&all) {
            if let Some(tip) = pane.arrow(canvas, force.acceleration * MM_A_FORCE, force.colour) {
                letter(canvas, pane.find(pose.position), tip, force);
            }
        }
    }
    // The legend grows upwards.
    for force in all.iter().rev() {
        if let Some(row) = legend_row(canvas) {
            let (size, pt) = (force.acceleration.length(), canvas.scale());
            let ink = if size < WEAK { GREY } else { force.colour };
            canvas.label(row, Align::Left, SMALL, force.letter, ink);
            legend_text(canvas, row, 18.0, force.name, if size < WEAK { GREY } else { WHITE });
            canvas.label([row[0] + 190.0 * pt, row[1]], Align::Right, SMALL, format!("{size:.0} mm/s²"), ink);
            let bar = (size * 0.2).min(80.0) as f32;
            if bar >= 1.0 {
                canvas.stroke([row[0] + 200.0 * pt, row[1]], [row[0] + (200.0 + bar) * pt, row[1]], 5.0, ink);
            }
        }
    }
}

fn strong(all: &[Force]) -> impl Iterator<Item = &Force> {
    all.iter().filter(|f| f.acceleration.length() >= WEAK)
}

/// Draws the letter of a force beyond its tip; nothing at an arrow that points at the eye.
fn letter(canvas: &mut Canvas, from: Place2, tip: Place2, force: &Force) {
    let pt = canvas.scale();
    let [x, y] = [tip[0] - from[0], tip[1] - from[1]];
    let length = x.hypot(y);
    if length < 10.0 * pt {
        return;
    }
    let at = [tip[0] + x / length * 8.0 * pt, tip[1] + y / length * 8.0 * pt];
    canvas.label([at[0] + pt, at[1] + pt], Align::Centre, SMALL, force.letter, EDGE);
    canvas.label(at, Align::Centre, SMALL, force.letter, force.colour);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scene;
    use crate::overlay::Mark;
    use crate::overlays::tests::{drawn, flight_in_a_room};

    #[test]
    fn the_legend_lists_every_force_with_its_size_in_a_column() {
        let mut flight = flight_in_a_room(Scene::guided_by("tentacles"));
        flight.step().unwrap();
        let all = forces(&flight);
        assert_eq!(all.iter().map(|f| f.letter).collect::<String>(), "WMGHDS");
        let marks = drawn(&OVERLAY, &flight, [1600, 800], 2.0);
        let sizes: Vec<_> = marks
            .iter()
            .filter_map(|m| match m {
                Mark::Text { at, text, align: Align::Right, .. } if text.ends_with(" mm/s²") => {
                    Some((*at, text.as_str()))
                }
                _ => None,
            })
            .collect();
        // At two pixels a point, rows are 34 pixels high, and the last force is the lowest. The column ends 190 points right of
        // a row's beginning, which is 36 pixels from the picture's edge.
        assert_eq!(sizes.len(), all.len());
        for (n, (force, (at, text))) in all.iter().rev().zip(sizes).enumerate() {
            assert_eq!(at, [36.0 + 380.0, 763.0 - 34.0 * n as f32], "{}", force.name);
            assert_eq!(text, format!("{:.0} mm/s²", force.acceleration.length()), "{}", force.name);
        }
    }

    /// The point that the arrows start at is a cross of 10 points.
    #[test]
    fn a_cross_marks_where_the_forces_act() {
        use crate::overlay::Mark;
        let mut flight = flight_in_a_room(Scene::guided_by("tentacles"));
        flight.step().unwrap();
        let marks = drawn(&OVERLAY, &flight, [800, 600], 1.0);
        let lines: Vec<_> = marks
            .iter()
            .filter_map(|m| if let Mark::Line { from, to, .. } = m { Some((*from, *to)) } else { None })
            .collect();
        let level = lines.iter().find(|(f, t)| f[1] == t[1] && (t[0] - f[0] - 10.0).abs() < 1e-3);
        let (from, to) = level.expect("a line of 10 points across");
        let middle = [0.5 * (from[0] + to[0]), from[1]];
        let upright = lines.iter().any(|(f, t)| {
            f[0] == middle[0]
                && t[0] == middle[0]
                && (f[1] - middle[1] + 5.0).abs() < 1e-3
                && (t[1] - middle[1] - 5.0).abs() < 1e-3
        });
        assert!(upright, "and one upright through its middle: {lines:?}");
    }
}
