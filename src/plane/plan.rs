//! The start and the goal of a flight through a drawing.

use std::collections::VecDeque;

use glam::{DVec3, IVec3};

use super::drawing::{MM_PER_PIXEL, pixel_centre};
use super::walls::Walls;
use crate::error::{Error, Result};
use crate::fields::Clearances;
use crate::math::lattice::nearest_first;

/// If the body does not fit at the start, the start moves to the nearest place with room within this distance, mm.
const SNAP_MM: f64 = 5.0;
/// Distance within which a drawn goal counts as reached, mm.
const ARRIVED_MM: f64 = 3.0;
/// Clearance beyond the body's radius that a start needs, mm.
const ROOM_MM: f64 = 0.1;

/// The plan of a flight.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Start, mm.
    pub start: DVec3,
    /// Goal, mm.
    pub goal: DVec3,
    /// Distance from the goal within which the flight has arrived, mm.
    pub within_mm: f64,
    /// Notes for the user.
    pub notes: Vec<String>,
}

/// Plans a flight from the red mark to the green one.
///
/// If the drawing lacks a mark, that end is the place farthest from the other, along paths wide enough for the body. Fails with
/// status 4 if the body fits nowhere, or not at the start.
pub(crate) fn plan(walls: &Walls, radius_mm: f64) -> Result<Plan> {
    let drawing = walls.drawing();
    let mut notes = Vec::new();
    // A search range no larger than the body needs keeps the sweeps fast.
    let near = Walls::new(drawing.clone(), radius_mm + 1.0);
    let fits = |p: DVec3| near.clearance(p).mm > radius_mm + ROOM_MM;
    // Two sweeps: the place farthest from any point of a path is one of its ends.
    let furthest = |from: DVec3| reach(walls, from, &fits);
    let start = match drawing.start {
        Some(start) => roomy(start, &fits, &mut notes).ok_or_else(|| {
            Error::incomplete(
                format!("start {}", pair(start)),
                format!("the lumen there is narrower than the camera ({radius_mm} mm)"),
                format!("draw the start (red) in a wider place, within {SNAP_MM} mm"),
            )
        })?,
        None => {
            let roomiest = roomiest(walls).filter(|p| fits(*p)).ok_or_else(|| {
                Error::incomplete(
                    "start",
                    format!("the lumen is everywhere narrower than the camera ({radius_mm} mm)"),
                    format!("draw it wider: a pixel is {MM_PER_PIXEL} mm"),
                )
            })?;
            furthest(drawing.goal.filter(|g| fits(*g)).unwrap_or(roomiest))
        }
    };
    let (goal, within_mm) = match drawing.goal {
        Some(goal) => (goal, ARRIVED_MM),
        None => {
            let goal = furthest(start);
            (goal, (0.5 * walls.clearance(goal).mm).max(ARRIVED_MM))
        }
    };
    Ok(Plan { start, goal, within_mm, notes })
}

/// Returns a start near another position (mm): the nearest place with room within 5 mm. Fails with status 4 if there is none.
pub(crate) fn start_at(walls: &Walls, at: DVec3, radius_mm: f64) -> Result<DVec3> {
    let fits = |p: DVec3| walls.clearance(p).mm > radius_mm + ROOM_MM;
    roomy(at, &fits, &mut Vec::new()).ok_or_else(|| {
        Error::incomplete(
            format!("start {}", pair(at)),
            format!("no room for the camera ({radius_mm} mm) within {SNAP_MM} mm"),
            "choose a place in the lumen",
        )
    })
}

/// Returns the place in the drawing with the most clearance (on a tie, the first).
fn roomiest(walls: &Walls) -> Option<DVec3> {
    let drawing = walls.drawing();
    let mut best = (0.0, None);
    // Every fourth pixel is enough, as this only starts a search.
    let step = if drawing.width().max(drawing.height()) < 64 { 1 } else { 4 };
    for j in (0..drawing.height()).step_by(step) {
        for i in (0..drawing.width()).step_by(step) {
            let at = pixel_centre(i, j);
            let c = walls.clearance(at).mm;
            if c > best.0 {
                best = (c, Some(at));
            }
        }
    }
    best.1
}

/// Returns the place farthest from `from` that can be reached pixel by pixel through places where `fits` is true.
fn reach(walls: &Walls, from: DVec3, fits: &impl Fn(DVec3) -> bool) -> DVec3 {
    let (w, h) = (walls.drawing().width(), walls.drawing().height());
    let mut seen = vec![false; w * h];
    let pixel = |x: f64, n: usize| ((x / MM_PER_PIXEL).max(0.0) as usize).min(n - 1);
    let first = (pixel(from.x, w), pixel(from.y, h));
    let mut queue = VecDeque::from([first]);
    seen[first.0 + w * first.1] = true;
    let mut last = first;
    while let Some((i, j)) = queue.pop_front() {
        last = (i, j);
        for (x, y) in [(i.wrapping_sub(1), j), (i + 1, j), (i, j.wrapping_sub(1)), (i, j + 1)] {
            if x < w && y < h && !seen[x + w * y] && fits(pixel_centre(x, y)) {
                seen[x + w * y] = true;
                queue.push_back((x, y));
            }
        }
    }
    if last == first { from } else { pixel_centre(last.0, last.1) }
}

/// Returns the nearest place with room within [`SNAP_MM`], searching a lattice in order of distance.
fn roomy(at: DVec3, fits: &impl Fn(DVec3) -> bool, notes: &mut Vec<String>) -> Option<DVec3> {
    let offsets = nearest_first(SNAP_MM, MM_PER_PIXEL, IVec3::new(1, 1, 0));
    let found = offsets.into_iter().map(|o| at + o).find(|p| fits(*p))?;
    if found != at {
        notes.push(format!("the start {} has no room for the camera; moved to {}", pair(at), pair(found)));
    }
    Some(found)
}

/// Formats a position in the drawing as text.
#[doc(hidden)]
pub fn pair(p: DVec3) -> String {
    format!("{:.1},{:.1}", p.x, p.y)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drawing::Drawing;
    use crate::error::Kind;
    use crate::render::ImageSize;

    /// A drawing of `w` × `h` pixels, lumen where `inside` is true.
    fn drawn(w: usize, h: usize, inside: impl Fn(usize, usize) -> bool) -> Drawing {
        Drawing::new("d", ImageSize::new(w, h), (0..w * h).map(|n| inside(n % w, n / w)).collect()).unwrap()
    }

    /// A corridor from 1 to 49 mm along x and from 2 to 8 mm along y.
    fn corridor() -> Drawing {
        drawn(100, 20, |i, j| (2..98).contains(&i) && (4..16).contains(&j))
    }

    #[test]
    fn a_start_close_to_a_wall_moves_away_and_one_without_room_is_refused() {
        // The room spans 1 to 19 mm. On the right a slit, too narrow for a camera of 2 mm.
        let room =
            |i, j| (2..38).contains(&i) && (2..38).contains(&j) || (38..80).contains(&i) && (18..21).contains(&j);
        let walls = Walls::new(drawn(90, 40, room), 40.0);
        let free = DVec3::new(6.0, 10.0, 0.0);
        assert_eq!(start_at(&walls, free, 2.0).unwrap(), free);
        // 0.3 mm from the wall. Steps of half a millimetre lead to 2.3 mm.
        let moved = start_at(&walls, DVec3::new(1.3, 10.0, 0.0), 2.0).unwrap();
        assert!(moved.distance(DVec3::new(3.3, 10.0, 0.0)) < 1e-9, "{moved}");
        for at in [DVec3::new(35.0, 9.75, 0.0), DVec3::new(35.0, 2.0, 0.0)] {
            assert_eq!(start_at(&walls, at, 2.0).unwrap_err().kind, Kind::Incomplete, "{at}");
        }
    }

    #[test]
    fn a_missing_goal_is_the_place_farthest_from_the_start() {
        let mut drawing = corridor();
        // Nearer to the right end.
        drawing.start = Some(DVec3::new(30.0, 5.0, 0.0));
        let plan = plan(&Walls::new(drawing, 40.0), 1.0).unwrap();
        assert_eq!(plan.start, DVec3::new(30.0, 5.0, 0.0));
        assert_eq!(plan.goal, DVec3::new(2.25, 3.25, 0.0), "the farthest corner with room for the camera");
        assert_eq!(plan.within_mm, ARRIVED_MM);
    }

    #[test]
    fn without_marks_the_flight_leads_from_end_to_end() {
        let plan = plan(&Walls::new(corridor(), 40.0), 1.0).unwrap();
        assert!((plan.start.x - plan.goal.x).abs() > 45.0, "{plan:?}");
    }

    /// The only room is farther to the right than the drawing is high.
    #[test]
    fn room_is_found_everywhere_in_a_wide_drawing() {
        for w in [60, 100] {
            let room = |i: usize, j: usize| (w - 38..w - 2).contains(&i) && (2..18).contains(&j);
            let plan = plan(&Walls::new(drawn(w, 20, room), 40.0), 1.0).unwrap();
            let x = (w - 38) as f64 * MM_PER_PIXEL;
            assert!(plan.start.x > x && plan.goal.x > x, "{plan:?}");
            assert!((plan.start.x - plan.goal.x).abs() > 14.0, "{plan:?}");
        }
    }
}
