//! Where the points of one frame are in another.

use std::array::from_fn;

use fearless_simd::Level;
use glam::DVec3;

use super::Subject;
use super::band::{Band, Eyes};
use crate::render::leap::{Crossings, RaysFrom};
use crate::render::{Sixteen, View};

/// Something lies before the point in the other frame, or its wall is seen from behind there.
pub const HIDDEN: u8 = 1;
/// The point is beyond the other frame's edges, or where its camera shows nothing.
pub const OUTSIDE: u8 = 2;

/// A point is seen if its ray meets the wall at most this much before it, mm. The crossing is exact to far less; where a ray grazes the
/// wall, rounding moves it along the ray.
const SAME_MM: f64 = 0.01;
/// The same between moments of a deformed scan, mm.
const DEFORMED_MM: f64 = 0.4;

/// The frame before or after.
#[derive(Clone, Copy)]
pub struct Neighbour<'a> {
    /// Rays through the scan at its moment.
    pub rays: &'a Crossings,
    /// Its camera and pixels.
    pub view: &'a View,
    /// Where a point of the frame is at its moment, world, mm; where it was if nothing moves.
    pub moved: Option<&'a (dyn Fn(DVec3) -> DVec3 + Sync)>,
}

impl Band<'_> {
    /// Measures the flow of the pixels to the frames before and after, what of them is not seen there, and how far the tissue has moved.
    pub(super) fn flow(&mut self, subject: &Subject<'_>, eyes: &Eyes<'_>) {
        for k in 0..2 {
            if self.flow[k].is_empty() {
                continue;
            }
            if let (Some(to), Some(eye)) = (&subject.neighbours[k], &eyes.near[k]) {
                self.flow_to(k, to, (eye, eyes.level));
            } else {
                self.flow[k].fill([f32::NAN; 2]);
                self.unseen[k].fill(OUTSIDE);
            }
        }
        let moved = subject.neighbours[1].and_then(|n| n.moved);
        for (scene, found) in self.scene.iter_mut().zip(self.crossings.iter()) {
            *scene = match (found, moved) {
                (Some(c), Some(moved)) => (moved(c.place) - c.place).as_vec3().to_array(),
                _ => [f32::NAN; 3],
            };
        }
    }

    fn flow_to(&mut self, which: usize, to: &Neighbour<'_>, (eye, level): (&RaysFrom<'_>, Level)) {
        // A deformed scan is interpolated twice.
        let same_mm = if to.moved.is_some() { DEFORMED_MM } else { SAME_MM };
        for number in 0..self.squares() {
            let square = self.square(number);
            let (mut place, mut facing) = ([[f64::NAN; 16]; 3], [[0.0; 16]; 3]);
            let mut own = [f64::INFINITY; 16];
            for (k, n) in square.pixels() {
                let Some(crossing) = &self.crossings[n] else { continue };
                let at = to.moved.map_or(crossing.place, |moved| moved(crossing.place));
                (place[0][k], place[1][k], place[2][k]) = at.into();
                [facing[0][k], facing[1][k], facing[2][k]] = self.facing[n].map(f64::from);
                own[k] = crossing.mm;
            }
            let clear = self.clear[which][number];
            let sight = fearless_simd::dispatch!(level, _simd => {
                Sight::new((to.view, &square.at), (&place, &facing), (clear, &own))
            });
            let (mut ends, mut unseen) = ([0.0; 16], [OUTSIDE; 16]);
            let is_pinhole = to.view.pixel().is_some();
            for k in 0..16 {
                // Within the picture of a pinhole every point has a ray.
                let has_ray = is_pinhole || to.view.ray_at(sight.at[0][k], sight.at[1][k]).is_some();
                if sight.is_inside[k] && has_ray {
                    // A wall that is rigid and seen from behind is hidden by itself.
                    let is_behind = to.moved.is_none() && sight.is_away[k];
                    unseen[k] = if is_behind { HIDDEN } else { 0 };
                    ends[k] = if is_behind { 0.0 } else { sight.mm[k] - same_mm };
                }
            }
            let met = eye.sixteen(&sight.directions, &sight.begins, &ends);
            let unseen = from_fn(|k| if met[k] < ends[k] { HIDDEN } else { unseen[k] });
            // The polynomial of a calibration means nothing beyond its picture.
            let known = |k: usize| if is_pinhole || sight.is_inside[k] { sight.flow[k] } else { [f32::NAN; 2] };
            square.store(self.flow[which], &from_fn(known));
            square.store(self.unseen[which], &unseen);
        }
    }
}

/// How a camera sees sixteen places.
struct Sight {
    /// Where, pixels from the top left corner of its picture; NaN where it cannot.
    at: [[f64; 16]; 2],
    is_inside: [bool; 16],
    /// By how many pixels that is elsewhere.
    flow: [[f32; 2]; 16],
    /// The ways from the camera, world, of unit length.
    directions: Sixteen,
    mm: [f64; 16],
    /// How far they have no wall before them for certain, mm.
    begins: [f64; 16],
    /// True where a wall at the place faces away.
    is_away: [bool; 16],
}

impl Sight {
    /// Of the places it is known where they are seen elsewhere, how they face, and how far away they are there, mm; and how much of that
    /// way has no wall near it.
    #[inline(always)]
    fn new(
        (view, from): (&View, &[[f64; 16]; 2]),
        (place, facing): (&Sixteen, &Sixteen),
        (clear, own): (f64, &[f64; 16]),
    ) -> Self {
        let (eye, width, height) = (view.position(), view.width() as f64, view.height() as f64);
        let at = view.places(place);
        let (mut is_inside, mut is_away) = ([false; 16], [false; 16]);
        let (mut directions, mut mm, mut begins) = ([[0.0; 16]; 3], [0.0; 16], [0.0; 16]);
        let mut flow = [[0.0; 2]; 16];
        for k in 0..16 {
            is_inside[k] = at[0][k] >= 0.0 && at[0][k] < width && at[1][k] >= 0.0 && at[1][k] < height;
            flow[k] = [(at[0][k] - from[0][k]) as f32, (at[1][k] - from[1][k]) as f32];
            let (x, y, z) = (place[0][k] - eye.x, place[1][k] - eye.y, place[2][k] - eye.z);
            is_away[k] = x * facing[0][k] + y * facing[1][k] + z * facing[2][k] >= 0.0;
            mm[k] = (x * x + y * y + z * z).sqrt();
            (directions[0][k], directions[1][k], directions[2][k]) = (x / mm[k], y / mm[k], z / mm[k]);
            begins[k] = if clear > 0.0 { clear * mm[k] / own[k] } else { 0.0 };
        }
        Self { at, is_inside, flow, directions, mm, begins, is_away }
    }
}
