//! Where the points of one frame are in another.

use glam::DVec3;

use super::Subject;
use super::band::{Band, Eyes, set};
use crate::render::View;
use crate::render::leap::{Crossings, RaysFrom};

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
                    self.flow_to(k, to, eye);
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

    fn flow_to(&mut self, which: usize, to: &Neighbour<'_>, eye: &RaysFrom<'_>) {
        // A deformed scan is interpolated twice.
        let same_mm = if to.moved.is_some() { DEFORMED_MM } else { SAME_MM };
        let size = [to.view.width() as f64, to.view.height() as f64];
        for square in self.squares() {
            let (mut directions, mut ends) = ([[0.0; 16]; 3], [0.0; 16]);
            for (k, n) in square.iter().enumerate() {
                let Some((n, crossing)) = n.and_then(|n| Some((n, self.crossings[n]?))) else { continue };
                let place = to.moved.map_or(crossing.place, |moved| moved(crossing.place));
                let Some([u, v]) = to.view.project(place) else { continue };
                let (own_u, own_v) = ((n % self.width) as f64 + 0.5, (self.top + n / self.width) as f64 + 0.5);
                let is_inside = (0.0..size[0]).contains(&u) && (0.0..size[1]).contains(&v);
                // The polynomial of a calibration means nothing beyond its picture.
                if is_inside || to.view.pixel().is_some() {
                    self.flow[which][n] = [(u - own_u) as f32, (v - own_v) as f32];
                }
                // Within the picture of a pinhole every point has a ray.
                if !is_inside || (to.view.pixel().is_none() && to.view.ray_at(u, v).is_none()) {
                    continue;
                }
                let way = place - to.view.position();
                let mm = way.length();
                // A wall that is rigid and seen from behind is hidden by itself.
                if to.moved.is_none() && self.facing[n].as_dvec3().dot(way) >= 0.0 {
                    self.unseen[which][n] = HIDDEN;
                    continue;
                }
                self.unseen[which][n] = 0;
                (directions[0][k], directions[1][k], directions[2][k]) = (way.x / mm, way.y / mm, way.z / mm);
                ends[k] = mm - same_mm;
            }
            let met = eye.sixteen(&directions, &ends);
            for (k, n) in square.into_iter().enumerate() {
                if let Some(n) = n.filter(|_| met[k] < ends[k]) {
                    self.unseen[which][n] = HIDDEN;
                }
            }
        }
    }
}
