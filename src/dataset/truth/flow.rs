//! Where the points of one frame are in another.

use fearless_simd::Level;
use glam::DVec3;

use super::Subject;
use super::band::{Band, Eyes, set};
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
            if !self.flow[k].is_empty() {
                self.flow[k].fill([f32::NAN; 2]);
                self.unseen[k].fill(OUTSIDE);
                if let (Some(to), Some(eye)) = (&subject.neighbours[k], &eyes.near[k]) {
                    self.flow_to(k, to, (eye, eyes.level));
                }
            }
        }
        let moved = subject.neighbours[1].and_then(|n| n.moved);
        for (n, found) in self.crossings.iter().enumerate() {
            set(self.scene, n, || {
                found.zip(moved).map_or([f32::NAN; 3], |(c, moved)| (moved(c.place) - c.place).as_vec3().to_array())
            });
        }
    }

    fn flow_to(&mut self, which: usize, to: &Neighbour<'_>, (eye, level): (&RaysFrom<'_>, Level)) {
        // A deformed scan is interpolated twice.
        let same_mm = if to.moved.is_some() { DEFORMED_MM } else { SAME_MM };
        for square in 0..self.squares() {
            let square = self.square(square);
            let (mut place, mut facing) = ([[f64::NAN; 16]; 3], [[0.0; 16]; 3]);
            for (k, n) in square.pixels.into_iter().enumerate() {
                let Some((n, crossing)) = n.and_then(|n| Some((n, self.crossings[n].as_ref()?))) else { continue };
                let at = to.moved.map_or(crossing.place, |moved| moved(crossing.place));
                (place[0][k], place[1][k], place[2][k]) = at.into();
                (facing[0][k], facing[1][k], facing[2][k]) = self.facing[n].as_dvec3().into();
            }
            let sight = fearless_simd::dispatch!(level, _simd => Sight::new(to.view, &place, &facing));
            let mut ends = [0.0; 16];
            for (k, n) in square.pixels.into_iter().enumerate() {
                let Some(n) = n.filter(|_| sight.at[0][k].is_finite()) else { continue };
                let [u, v] = [sight.at[0][k], sight.at[1][k]];
                // The polynomial of a calibration means nothing beyond its picture.
                if sight.is_inside[k] || to.view.pixel().is_some() {
                    self.flow[which][n] = [(u - square.at[0][k]) as f32, (v - square.at[1][k]) as f32];
                }
                // Within the picture of a pinhole every point has a ray.
                if !sight.is_inside[k] || (to.view.pixel().is_none() && to.view.ray_at(u, v).is_none()) {
                    continue;
                }
                // A wall that is rigid and seen from behind is hidden by itself.
                let is_behind = to.moved.is_none() && sight.is_away[k];
                self.unseen[which][n] = if is_behind { HIDDEN } else { 0 };
                ends[k] = if is_behind { 0.0 } else { sight.mm[k] - same_mm };
            }
            let met = eye.sixteen(&sight.directions, &ends);
            for (k, n) in square.pixels.into_iter().enumerate() {
                if let Some(n) = n.filter(|_| met[k] < ends[k]) {
                    self.unseen[which][n] = HIDDEN;
                }
            }
        }
    }
}

/// How a camera sees sixteen places.
struct Sight {
    /// Where, pixels from the top left corner of its picture; NaN where it cannot.
    at: [[f64; 16]; 2],
    is_inside: [bool; 16],
    /// The ways from the camera, world, of unit length.
    directions: Sixteen,
    mm: [f64; 16],
    /// True where a wall at the place faces away.
    is_away: [bool; 16],
}

impl Sight {
    #[inline(always)]
    fn new(view: &View, place: &Sixteen, facing: &Sixteen) -> Self {
        let (eye, width, height) = (view.position(), view.width() as f64, view.height() as f64);
        let at = view.places(place);
        let (mut is_inside, mut is_away) = ([false; 16], [false; 16]);
        let (mut directions, mut mm) = ([[0.0; 16]; 3], [0.0; 16]);
        for k in 0..16 {
            is_inside[k] = at[0][k] >= 0.0 && at[0][k] < width && at[1][k] >= 0.0 && at[1][k] < height;
            let (x, y, z) = (place[0][k] - eye.x, place[1][k] - eye.y, place[2][k] - eye.z);
            is_away[k] = x * facing[0][k] + y * facing[1][k] + z * facing[2][k] >= 0.0;
            mm[k] = (x * x + y * y + z * z).sqrt();
            (directions[0][k], directions[1][k], directions[2][k]) = (x / mm[k], y / mm[k], z / mm[k]);
        }
        Self { at, is_inside, directions, mm, is_away }
    }
}
