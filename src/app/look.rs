//! Viewpoints for a polyp candidate: a camera in the lumen that sees it, and the planes of its slices.

use std::f64::consts::TAU;
use std::sync::Arc;

use glam::DVec3;

use crate::error::Result;
use crate::fields::ClearanceFinder;
use crate::polyps::{Candidate, Wall};
use crate::render::View;
use crate::render::slice::{PlaneFrame, Slice, SlicePlane};
use crate::space::{PreparedVolume, first_crossing};

/// Side of a slice, pixels and mm.
#[doc(hidden)]
pub const SLICE: usize = 240;
/// Edge of the slice across the path, mm.
#[doc(hidden)]
pub const SLICE_MM: f64 = 60.0;

/// Distance of the camera from the candidate if there is room, mm: this much more than its diameter, within these limits.
const STAND_BACK_MM: f64 = 13.0;
const DISTANCE_MM: [f64; 2] = [15.0, 25.0];
/// Minimum distance of the camera from the candidate, mm, unless there is less room in every direction.
const LEAST_MM: f64 = 4.0;
/// Step by which the camera comes nearer where there is no room, mm.
const STEP_MM: f64 = 1.0;
/// Distance of the camera from the wall behind it and beside it, mm.
const CLEAR_MM: f64 = 2.0;
/// Free length along a direction that counts as ample room, mm.
const ROOM_MM: f64 = 60.0;
/// Angles between the candidate's axis and the direction to the camera, degrees: the preferred one first.
const TILTS: [f64; 6] = [30.0, 20.0, 40.0, 10.0, 50.0, 0.0];
/// Directions around the axis.
const SIDES: usize = 16;
/// The view shows this much across at the candidate's distance, mm: at least, and for each mm of its diameter.
const ACROSS_MM: f64 = 30.0;
const ACROSS_DIAMETERS: f64 = 2.5;
/// Limits of the view angle, degrees.
const FOV: [f64; 2] = [30.0, 110.0];
/// The nearest wall of a candidate without measures is within this, mm.
const NEAR_MM: f64 = 15.0;

/// A candidate as its pictures show it. World, mm LPS.
#[doc(hidden)]
pub struct Subject {
    /// The middle of every picture.
    pub(crate) middle: DVec3,
    /// Its place on the wall.
    position: DVec3,
    /// Unit vector into the lumen.
    axis: DVec3,
    /// Unit vector of its longest diameter, across the axis.
    long: DVec3,
    /// Radius of a circle around it, mm.
    #[doc(hidden)]
    pub radius_mm: f64,
}

impl Subject {
    /// Returns the subject of a candidate. One without measures is seen along the normal of the wall nearest to it.
    #[doc(hidden)]
    pub fn of(candidate: &Candidate, wall: &Wall) -> Self {
        let position = candidate.position;
        let unit = |v: DVec3| v.try_normalize().filter(|u| u.is_finite());
        let Some(lesion) = &candidate.lesion else {
            let normal = wall.nearest(position, NEAR_MM).and_then(|v| unit(wall.normal(v).as_dvec3()));
            let axis = normal.unwrap_or(DVec3::NEG_Y);
            return Self { middle: position, position, axis, long: across(axis), radius_mm: 6.0 };
        };
        let axis = unit(lesion.axis).unwrap_or(DVec3::NEG_Y);
        let [a, b] = lesion.ends;
        let long = b - a - axis * (b - a).dot(axis);
        // A diameter along the axis, of a polyp higher than wide, has no direction across it.
        let long = unit(long).filter(|_| long.length() > 0.2 * lesion.diameter_mm).unwrap_or_else(|| across(axis));
        let middle = 0.5 * (a + b);
        let off = middle.distance(position);
        let middle = if off <= lesion.diameter_mm.max(lesion.height_mm) { middle } else { position };
        Self { middle, position, axis, long, radius_mm: 0.5 * lesion.diameter_mm }
    }

    /// Returns the subject at a place of the wall, with the direction into the lumen there, of unit length, and the ends of its diameter.
    #[doc(hidden)]
    pub fn at(place: DVec3, axis: DVec3, ends: Option<[DVec3; 2]>) -> Self {
        let Some([a, b]) = ends else {
            return Self { middle: place, position: place, axis, long: across(axis), radius_mm: 6.0 };
        };
        let long = (b - a).reject_from_normalized(axis);
        let long = long.try_normalize().filter(|_| long.length() > 0.2 * a.distance(b)).unwrap_or_else(|| across(axis));
        let radius_mm = 0.5 * a.distance(b);
        // Ends may have been dragged away from where it was marked.
        let middle = a.midpoint(b);
        let middle = if middle.distance(place) <= 2.0 * radius_mm.max(3.0) { middle } else { place };
        Self { middle, position: place, axis, long, radius_mm }
    }

    /// Returns its slices: axial; along the axis and across the longest diameter; along both. In the latter two the lumen is on
    /// top, and the patient's left is on the right as far as possible.
    #[doc(hidden)]
    pub fn slices(&self) -> [Slice; 3] {
        let frame = |normal: DVec3| {
            let [one, other] = [normal, -normal].map(|forward| PlaneFrame::looking(forward, self.axis));
            if leftwards(one.right()) >= leftwards(other.right()) { one } else { other }
        };
        // The axial plane has a frame.
        let axial = SlicePlane::Axial.frame().unwrap_or_else(|_| PlaneFrame::looking(DVec3::Z, DVec3::NEG_Y));
        let frames = [axial, frame(self.long), frame(self.axis.cross(self.long))];
        let mm_per_pixel = SLICE_MM / SLICE as f64;
        frames.map(|frame| Slice { centre: self.middle, frame, mm_per_pixel, size: [SLICE; 2] })
    }
}

/// Orders directions of an image's right edge: to the patient's left, else to posterior, else to superior.
fn leftwards(right: DVec3) -> f64 {
    right.x + 1e-3 * right.y + 1e-6 * right.z
}

/// Returns a unit vector across `axis`, horizontal if possible.
fn across(axis: DVec3) -> DVec3 {
    axis.cross(DVec3::Z).try_normalize().unwrap_or(DVec3::X)
}

/// Finds places for cameras in a scan.
#[doc(hidden)]
pub struct Looks {
    volume: PreparedVolume,
    clearances: ClearanceFinder,
}

/// A place for a camera.
#[derive(Clone, Copy)]
struct Place {
    eye: DVec3,
    /// Distance from the wall that it looks at, mm.
    mm: f64,
    /// Free length along the direction to the camera, mm, at most [`ROOM_MM`].
    free: f64,
}

impl Looks {
    /// Prepares a search for places in the gas of `volume`.
    #[doc(hidden)]
    pub fn new(volume: &PreparedVolume) -> Self {
        let iso = volume.transfer().iso() as f32;
        let clearances = ClearanceFinder::new(Arc::clone(&volume.shared_voxels()), iso, 2.0 * CLEAR_MM);
        Self { volume: volume.clone(), clearances }
    }

    /// Returns a view of the subject, `side` pixels wide and high: from the lumen, from its axis a little to the side on which
    /// there is most room, with superior on top. Also returns the length of a mm at the subject, pixels.
    ///
    /// # Errors
    /// Returns status 2 if the subject's position is not finite.
    #[doc(hidden)]
    pub fn view(&self, subject: &Subject, side: usize) -> Result<(View, f64)> {
        let (eye, fov) = self.camera(subject);
        let forward = subject.middle - eye;
        let view = View::new(eye, forward, DVec3::Z, fov, side, side)?;
        let scale = side as f64 / (2.0 * forward.length() * (0.5 * fov).to_radians().tan());
        Ok((view, scale))
    }

    /// Returns where the camera of that view is, and its view angle, degrees. It looks at the subject's middle.
    pub(crate) fn camera(&self, subject: &Subject) -> (DVec3, f64) {
        let eye = self.eye(subject);
        let across_mm = ACROSS_MM.max(2.0 * subject.radius_mm * ACROSS_DIAMETERS);
        let fov = 2.0 * (0.5 * across_mm / eye.distance(subject.middle)).atan();
        (eye, fov.to_degrees().clamp(FOV[0], FOV[1]))
    }

    /// Returns where the camera is.
    fn eye(&self, subject: &Subject) -> DVec3 {
        let start = self.start(subject);
        let wanted = (STAND_BACK_MM + 2.0 * subject.radius_mm).clamp(DISTANCE_MM[0], DISTANCE_MM[1]);
        let (u, w) = subject.axis.any_orthonormal_pair();
        let mut best: Option<Place> = None;
        for tilt in TILTS {
            let sides = if tilt == 0.0 { 1 } else { SIDES };
            for side in 0..sides {
                let (sin, cos) = (TAU * side as f64 / SIDES as f64).sin_cos();
                let (lean, along) = tilt.to_radians().sin_cos();
                let direction = subject.axis * along + (u * cos + w * sin) * lean;
                let Some(place) = self.place(start, direction, wanted) else { continue };
                if best.is_none_or(|b| (place.mm, place.free) > (b.mm, b.free)) {
                    best = Some(place);
                }
            }
            // Enough room at this angle is better than more at another.
            if let Some(best) = best.filter(|b| b.mm >= DISTANCE_MM[0]) {
                return best.eye;
            }
        }
        best.map_or_else(
            || {
                // A slit: half of what there is.
                let free = first_crossing(&self.volume, start, subject.axis, LEAST_MM).unwrap_or(LEAST_MM);
                start + subject.axis * (0.5 * free).max(0.5)
            },
            |b| b.eye,
        )
    }

    /// Returns a point of the gas just before the subject.
    fn start(&self, subject: &Subject) -> DVec3 {
        let before = |mm: f64| subject.position + subject.axis * mm;
        let is_gas = |p: &DVec3| first_crossing(&self.volume, *p, subject.axis, 0.0).is_none();
        [0.5, 1.0, 1.5, 2.0, 3.0].map(before).into_iter().find(is_gas).unwrap_or_else(|| before(1.0))
    }

    /// Returns the place nearest to `wanted` mm from `start` that a free straight line reaches, with room around it.
    fn place(&self, start: DVec3, direction: DVec3, wanted: f64) -> Option<Place> {
        let free = first_crossing(&self.volume, start, direction, ROOM_MM).unwrap_or(ROOM_MM);
        let steps = ((wanted - LEAST_MM) / STEP_MM).floor() as usize;
        let distances = (0..=steps).map(|n| wanted - n as f64 * STEP_MM);
        distances
            .filter(|mm| mm + CLEAR_MM <= free)
            .map(|mm| Place { eye: start + direction * mm, mm, free })
            .find(|p| self.clearances.at(p.eye).mm >= CLEAR_MM)
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::space::TransferFunction;
    use crate::volume::{Grid, Volume};

    const RADIUS_MM: f64 = 4.0;

    /// A room of gas, x and y from 5 to 55 mm and z from 5 mm to `top`, with a ball on the middle of its floor.
    fn room(top: f64) -> PreparedVolume {
        let grid = Grid::new([60; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let hu = |n: usize| {
            let p = grid.world(DVec3::new((n % 60) as f64, (n / 60 % 60) as f64, (n / 3600) as f64));
            let is_gas = (p - 30.0).truncate().abs().max_element() < 25.0 && p.z > 5.0 && p.z < top;
            if is_gas && p.distance(DVec3::new(30.0, 30.0, 7.0)) > RADIUS_MM { -1000 } else { 40 }
        };
        let volume = Volume::new(grid.clone(), (0..grid.len()).map(hu).collect());
        PreparedVolume::new(Arc::new(volume), TransferFunction::default())
    }

    fn ball() -> Subject {
        Subject {
            middle: DVec3::new(30.0, 30.0, 8.0),
            position: DVec3::new(30.0, 30.0, 7.0 + RADIUS_MM),
            axis: DVec3::Z,
            long: DVec3::X,
            radius_mm: RADIUS_MM,
        }
    }

    #[test]
    fn the_camera_is_in_the_gas_and_sees_the_candidate_in_the_middle() {
        for (top, tilt) in [(55.0, Some(30.0)), (28.0, None), (19.0, None)] {
            let volume = room(top);
            let subject = ball();
            let (view, scale) = Looks::new(&volume).view(&subject, 320).unwrap();
            let eye = view.position();
            assert!(ClearanceFinder::new(volume.shared_voxels(), -650.0, 5.0).at(eye).mm >= CLEAR_MM, "{top}: {eye}");
            let [x, y] = view.project(subject.middle).unwrap();
            assert!((x - 160.0).abs() < 1e-6 && (y - 160.0).abs() < 1e-6, "{top}: {x} {y}");
            // Nothing but the ball is in between.
            let mm = first_crossing(&volume, eye, view.forward(), 100.0).unwrap();
            let hit = eye + view.forward() * mm;
            assert!((hit.distance(DVec3::new(30.0, 30.0, 7.0)) - RADIUS_MM).abs() < 1.0, "{top}: {hit}");
            let off = (eye - subject.position).angle_between(subject.axis).to_degrees();
            assert!(tilt.is_none_or(|t| f64::abs(off - t) < 3.0), "{top}: {off}°");
            let beside = view.project(subject.middle + view.right()).unwrap();
            assert!((beside[0] - 160.0 - scale).abs() < 1e-6);
        }
    }

    #[test]
    fn a_place_without_room_has_a_view_all_the_same() {
        let volume = room(14.0);
        assert!(Looks::new(&volume).view(&ball(), 320).is_ok());
        let nowhere = Subject { position: DVec3::new(2.0, 2.0, 2.0), middle: DVec3::new(2.0, 2.0, 2.0), ..ball() };
        assert!(Looks::new(&volume).view(&nowhere, 320).is_ok());
    }

    #[test]
    fn slices_hold_the_axis_with_the_lumen_on_top_and_the_patients_left_on_the_right() {
        for (axis, long) in [(DVec3::Z, DVec3::X), (DVec3::Y, DVec3::NEG_Z), (DVec3::NEG_X, DVec3::Y)] {
            let subject = Subject { axis, long, ..ball() };
            let [axial, across, along] = subject.slices();
            assert_eq!(axial.frame.edges(), ["R", "L", "A", "P"]);
            for (slice, normal) in [(across, long), (along, axis.cross(long))] {
                let (down, right) = (slice.frame.down(), slice.frame.right());
                assert!((down + axis).length() < 1e-12 && leftwards(right) > 0.0);
                assert!((slice.frame.normal().dot(normal).abs() - 1.0).abs() < 1e-12);
                // Not mirrored.
                assert!((right.cross(down) + slice.frame.normal()).length() < 1e-12);
                assert_eq!(slice.pixel(subject.middle), ([120.0; 2], 0.0));
            }
        }
    }
}
