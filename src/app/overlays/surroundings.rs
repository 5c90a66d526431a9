//! Two small views of the camera's surroundings, from its right side and from above. They are orthographic and turn with the
//! camera, which flies to the right in both.

use glam::DVec3;
use rayon::prelude::*;

use super::{EDGE, GREY, MARGIN, SMALL, WHITE, arrow, bottom};
use crate::FlightApp;
use crate::overlay::{Align, Canvas, Colour, Place2};
use crate::space::first_crossing;

/// Width that a view shows, mm; its height is two thirds of that.
const SPAN_MM: f64 = 110.0;
/// Position of the camera in it, as a share of its width. More is visible behind the camera than in front of it.
const CAMERA: f32 = 0.6;
/// Largest width of a view, points.
const WIDEST: f32 = 250.0;
/// Smallest useful width of a view, points.
const NARROWEST: f32 = 90.0;
/// Number of rays that look for the wall, and their length, mm.
const RAYS: usize = 240;
const REACH_MM: f64 = 100.0;
/// Neighbouring points of the wall are joined if their distances from the camera differ by less than this share.
const JOINED: f64 = 0.25;
/// Height of the title above a view, points.
const TITLE: f32 = 17.0;
/// Length of the scale bar, mm.
const BAR_MM: f64 = 20.0;
/// The wall's outline.
const WALL: Colour = [226, 176, 160];

/// One of the views.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pane {
    low: Place2,
    high: Place2,
    camera: Place2,
    /// Pixels per mm.
    per_mm: f64,
    /// The camera's position, world mm.
    at: DVec3,
    /// The view's right and up directions, world, unit vectors.
    axes: [DVec3; 2],
}

impl Pane {
    /// Projects a point (world, mm) into the view. The result may be outside its edges.
    pub fn find(&self, place: DVec3) -> Place2 {
        let away = (place - self.at) * self.per_mm;
        [self.camera[0] + away.dot(self.axes[0]) as f32, self.camera[1] - away.dot(self.axes[1]) as f32]
    }

    /// True if a point of the picture is in the view.
    pub fn holds(&self, [x, y]: Place2) -> bool {
        (self.low[0]..=self.high[0]).contains(&x) && (self.low[1]..=self.high[1]).contains(&y)
    }

    /// Returns the component of a unit direction (world) perpendicular to the view's plane, 0 to 1.
    pub fn leaves(&self, direction: DVec3) -> f64 {
        direction.dot(self.axes[0].cross(self.axes[1])).abs()
    }

    /// Draws the part of a line (pixels) that is in the view. Returns true if all of it is.
    pub fn stroke(&self, canvas: &mut Canvas, from: Place2, to: Place2, width: f32, colour: Colour) -> bool {
        let Some([a, b]) = self.clip(from, to) else { return false };
        canvas.stroke(a, b, width, colour);
        b == to && a == from
    }

    /// Draws an arrow from the camera along `direction` (world, mm). An arrow that leaves the view has no head. Returns its tip,
    /// if that is in the view.
    pub fn arrow(&self, canvas: &mut Canvas, direction: DVec3, colour: Colour) -> Option<Place2> {
        let tip = self.find(self.at + direction);
        if self.holds(tip) {
            arrow(canvas, self.camera, tip, colour);
            return Some(tip);
        }
        for (width, colour) in [(4.0, EDGE), (2.2, colour)] {
            self.stroke(canvas, self.camera, tip, width, colour);
        }
        None
    }

    /// Returns the part of a line that is in the view (Liang and Barsky, *A new concept and method for line clipping*, 1984).
    fn clip(&self, from: Place2, to: Place2) -> Option<[Place2; 2]> {
        let (mut enters, mut leaves) = (0f32, 1f32);
        for a in 0..2 {
            let along = to[a] - from[a];
            for (inside, rate) in [(from[a] - self.low[a], -along), (self.high[a] - from[a], along)] {
                if rate == 0.0 && inside < 0.0 {
                    return None;
                } else if rate < 0.0 {
                    enters = enters.max(inside / rate);
                } else if rate > 0.0 {
                    leaves = leaves.min(inside / rate);
                }
            }
        }
        let place = |t: f32, end: Place2| match t {
            0.0 | 1.0 => end,
            t => [from[0] + (to[0] - from[0]) * t, from[1] + (to[1] - from[1]) * t],
        };
        (enters <= leaves).then(|| [place(enters, from), place(leaves, to)])
    }

    /// Draws the intersection of the wall with the view's plane through the camera, as far as it is visible from the camera.
    fn outline(&self, flight: &FlightApp, canvas: &mut Canvas) {
        let step = std::f64::consts::TAU / RAYS as f64;
        let lengths: Vec<Option<(f64, DVec3)>> = (0..RAYS)
            .into_par_iter()
            .with_min_len(30)
            .map(|n| {
                let (sine, cosine) = (step * n as f64).sin_cos();
                let direction = self.axes[0] * cosine + self.axes[1] * sine;
                let length = first_crossing(&flight.setup().volume, self.at, direction, REACH_MM)?;
                Some((length, self.at + direction * length))
            })
            .collect();
        for n in 0..RAYS {
            if let (Some((a, from)), Some((b, to))) = (lengths[n], lengths[(n + 1) % RAYS])
                && (a - b).abs() < JOINED * a.min(b)
            {
                self.stroke(canvas, self.find(from), self.find(to), 1.5, WALL);
            }
        }
    }
}

/// Returns the two views in the picture's lower right corner, from the camera's right side and from above. The first call draws
/// the wall, the camera and the scale in them. `None` if the picture has no room for them.
pub fn surroundings(flight: &FlightApp, canvas: &mut Canvas) -> Option<[Pane; 2]> {
    let pt = canvas.scale();
    let [width, height] = canvas.size();
    let wide = (0.25 * width - 16.0 * pt).min(WIDEST * pt).min(0.6 * height);
    if wide < NARROWEST * pt {
        return None;
    }
    let high = wide * 2.0 / 3.0;
    let bottom = bottom(canvas);
    let pose = flight.pose();
    let (forward, up, left) = (pose.attitude.forward, pose.attitude.up, -pose.attitude.right());
    let pane = |right_edge: f32, axes: [DVec3; 2]| Pane {
        low: [right_edge - wide, bottom - high],
        high: [right_edge, bottom],
        camera: [right_edge - wide * (1.0 - CAMERA), bottom - 0.5 * high],
        per_mm: f64::from(wide) / SPAN_MM,
        at: pose.position,
        axes,
    };
    let edge = width - MARGIN * pt;
    let panes = [pane(edge - wide - 4.0 * pt, [forward, up]), pane(edge, [forward, left])];
    if canvas.take("surroundings", 1) == 0 {
        for (pane, title) in panes.iter().zip(["from right", "from above"]) {
            let top = pane.low[1] - TITLE * pt;
            canvas.panel([pane.low[0].round(), top], pane.high, EDGE, 0.82);
            canvas.label([pane.low[0] + 6.0 * pt, top + 0.5 * TITLE * pt], Align::Left, SMALL, title, GREY);
            scale_bar(pane, canvas);
            pane.outline(flight, canvas);
            let [x, y] = pane.camera;
            let tip = [x + 5.0 * pt, y];
            for side in [-3.5 * pt, 3.5 * pt] {
                canvas.stroke([x - 4.0 * pt, y + side], tip, 1.8, WHITE);
            }
            canvas.stroke([x - 4.0 * pt, y - 3.5 * pt], [x - 4.0 * pt, y + 3.5 * pt], 1.8, WHITE);
        }
    }
    Some(panes)
}

/// Draws the scale bar in the right half of the title.
fn scale_bar(pane: &Pane, canvas: &mut Canvas) {
    let pt = canvas.scale();
    let middle = pane.low[1] - 0.5 * TITLE * pt;
    let to = [pane.high[0] - 48.0 * pt, middle];
    let from = [to[0] - (BAR_MM * pane.per_mm) as f32, middle];
    canvas.stroke(from, to, 2.0, GREY);
    for [x, y] in [from, to] {
        canvas.stroke([x, y - 3.0 * pt], [x, y + 3.0 * pt], 1.5, GREY);
    }
    canvas.label([to[0] + 5.0 * pt, to[1]], Align::Left, SMALL, format!("{BAR_MM:.0} mm"), GREY);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_end_at_the_views_edge() {
        let pane = Pane {
            low: [10.0, 20.0],
            high: [110.0, 80.0],
            camera: [60.0, 50.0],
            per_mm: 2.0,
            at: DVec3::ZERO,
            axes: [DVec3::X, DVec3::Z],
        };
        assert_eq!(pane.find(DVec3::new(5.0, 9.0, 10.0)), [70.0, 30.0]);
        assert_eq!(pane.clip([20.0, 30.0], [100.0, 70.0]), Some([[20.0, 30.0], [100.0, 70.0]]));
        assert_eq!(pane.clip([60.0, 50.0], [260.0, 50.0]), Some([[60.0, 50.0], [110.0, 50.0]]));
        assert_eq!(pane.clip([60.0, 0.0], [60.0, 200.0]), Some([[60.0, 20.0], [60.0, 80.0]]));
        assert_eq!(pane.clip([0.0, 0.0], [200.0, 10.0]), None);
        assert_eq!(pane.clip([0.0, 30.0], [5.0, 90.0]), None);
        // Beside it on each side, straight down or across.
        for x in [0.0, 120.0] {
            assert_eq!(pane.clip([x, 0.0], [x, 200.0]), None, "{x}");
        }
        for y in [10.0, 90.0] {
            assert_eq!(pane.clip([200.0, y], [0.0, y]), None, "{y}");
        }
        assert!((pane.leaves(DVec3::Y) - 1.0).abs() < 1e-12 && pane.leaves(DVec3::X) < 1e-12);
    }
}
