//! The place of a point in the colon: distance along its line, distance from it, and angle about it.

use std::sync::Arc;

use fearless_simd::Level;
use glam::DVec3;

use super::angle::angle;
use super::band::{Band, set};
use super::lattice::Lattice;
use super::{Crossing, Labels, Subject};
use crate::fields::Along;
use crate::fields::centerline::Centerline;
use crate::fields::frames::{Frame, STEP_MM, evenly, frames};
use crate::volume::Grid;

/// The nearest point of the line is looked for within this of the one that the colon's map names, mm along.
const WINDOW_MM: f64 = 12.0;
/// Frames that are looked at together: at least those within that distance.
const FRAMES: usize = 16;
const _: () = assert!(2.0 * WINDOW_MM / STEP_MM + 1.0 <= FRAMES as f64);
/// Steps in which that is remembered, mm.
const NEAR_STEP_MM: f64 = 0.5;

/// The line of a colon with frames that do not turn about it.
#[derive(Debug)]
pub struct Rings {
    along: Arc<Along>,
    /// Where places are along the line, in steps of [`NEAR_STEP_MM`] from 1; 0 for nowhere.
    known: Lattice,
    frames: Vec<Frame>,
    /// x, y and z of the frames, and of as many beyond the last as are looked at together.
    at: [Vec<f32>; 3],
    /// Distance of each frame along the line as scanned, mm.
    mm: Vec<f64>,
    level: Level,
}

impl Rings {
    /// Creates them for the only line of a colon in a scan's grid; `None` if there is none.
    pub fn new(along: &Arc<Along>, grid: &Grid) -> Option<Self> {
        let line: &Centerline = along.only_line()?;
        let (even, mm) = evenly(&line.points);
        let frames = frames(&even);
        let beyond = [f32::INFINITY; FRAMES];
        let of = |axis: usize| frames.iter().map(|f| f.at[axis] as f32).chain(beyond).collect();
        let at = [of(0), of(1), of(2)];
        (frames.len() > 1 && frames.len() == mm.len()).then(|| Self {
            along: Arc::clone(along),
            known: Lattice::new(grid),
            at,
            frames,
            mm,
            level: Level::new(),
        })
    }

    /// Returns the points of the line, world, mm, with the distance of each along it, mm.
    pub fn points(&self) -> impl Iterator<Item = (f64, &Frame)> {
        self.mm.iter().copied().zip(&self.frames)
    }

    /// Returns the distances along the line, mm, those from the line, mm, and the angles about it, radians from −π to π, of sixteen points
    /// (world, mm); NaN for those that are not finite, or farther than 12 mm from the lumen. Angle 0 is towards the patient's front where
    /// the line begins.
    pub(super) fn sixteen(&self, places: &[DVec3; 16]) -> [[f64; 16]; 3] {
        fearless_simd::dispatch!(self.level, _simd => self.measure(places))
    }

    #[inline(always)]
    fn measure(&self, places: &[DVec3; 16]) -> [[f64; 16]; 3] {
        let mut out = [[f64::NAN; 16]; 3];
        // Of each point: its share of the way from a frame to the next, its offset from there, and both frames' tangents and normals.
        let (mut shares, mut offset) = ([0.0; 16], [[0.0; 16]; 3]);
        let (mut tangent, mut normal) = ([[[1.0; 16]; 3]; 2], [[[1.0; 16]; 3]; 2]);
        for (k, place) in places.iter().enumerate().filter(|p| p.1.is_finite()) {
            let Some((n, share, at)) = self.nearest(*place) else { continue };
            let (a, b) = (&self.frames[n], &self.frames[n + 1]);
            shares[k] = share;
            out[0][k] = self.mm[n] + (self.mm[n + 1] - self.mm[n]) * share;
            let away = (*place - at).to_array();
            for axis in 0..3 {
                offset[axis][k] = away[axis];
                (tangent[0][axis][k], tangent[1][axis][k]) = (a.tangent[axis], b.tangent[axis]);
                (normal[0][axis][k], normal[1][axis][k]) = (a.normal[axis], b.normal[axis]);
            }
        }
        let is_known = out[0].map(|mm| mm.is_finite());
        for k in 0..16 {
            let [x, y, z] = [offset[0][k], offset[1][k], offset[2][k]];
            let between =
                |of: &[[[f64; 16]; 3]; 2], axis: usize| of[0][axis][k] + (of[1][axis][k] - of[0][axis][k]) * shares[k];
            let [tx, ty, tz] = [between(&tangent, 0), between(&tangent, 1), between(&tangent, 2)];
            let [nx, ny, nz] = [between(&normal, 0), between(&normal, 1), between(&normal, 2)];
            let square = tx * tx + ty * ty + tz * tz;
            let tilt = (nx * tx + ny * ty + nz * tz) / square;
            let [nx, ny, nz] = [nx - tx * tilt, ny - ty * tilt, nz - tz * tilt];
            // Both as long as the tangent: only their ratio matters.
            let right = (x * nx + y * ny + z * nz) * square.sqrt();
            let up = x * (ty * nz - tz * ny) + y * (tz * nx - tx * nz) + z * (tx * ny - ty * nx);
            out[1][k] = if is_known[k] { (x * x + y * y + z * z).sqrt() } else { f64::NAN };
            out[2][k] = if is_known[k] { angle(up, right) } else { f64::NAN };
        }
        out
    }

    /// Returns the frame after which the nearest point of the line lies, its share of the way to the next one, and the point.
    #[inline(always)]
    fn nearest(&self, place: DVec3) -> Option<(usize, f64, DVec3)> {
        let mut steps =
            |place| self.along.of(place).map_or(0, |at| (at.mm / NEAR_STEP_MM).clamp(0.0, 65_000.0) as u16 + 1);
        let about = f64::from(self.known.label(place, &mut steps).checked_sub(1)?) * NEAR_STEP_MM;
        // The frames are evenly spaced.
        let frame = |mm: f64| mm.max(0.0) / STEP_MM;
        let last = (frame(about + WINDOW_MM) as usize + 1).clamp(2, self.frames.len());
        let first = (frame(about - WINDOW_MM).ceil() as usize).min(last - 2);
        // Squares that are not negative are in the order of their bits. The last four give way to the number.
        let [x, y, z] = place.as_vec3().to_array();
        let [xs, ys, zs] = [0, 1, 2].map(|axis| &self.at[axis][first..first + FRAMES]);
        let mut least = u32::MAX;
        for k in 0..FRAMES {
            let (x, y, z) = (xs[k] - x, ys[k] - y, zs[k] - z);
            let square = ((x * x + y * y + z * z).to_bits() & !15) | k as u32;
            least = least.min(if k < last - first { square } else { u32::MAX });
        }
        let nearest = first + (least & 15) as usize;
        // The nearest point of the two lengths that meet there.
        let on = |n: usize| {
            let (a, b) = (self.frames[n].at, self.frames[n + 1].at);
            let share = ((place - a).dot(b - a) / (b - a).length_squared().max(1e-12)).clamp(0.0, 1.0);
            let at = a.lerp(b, share);
            (at.distance_squared(place), (n, share, at))
        };
        let (before, after) = (nearest.saturating_sub(1), nearest.min(self.frames.len() - 2));
        let (one, other) = (on(before), on(after));
        Some(if other.0 < one.0 { other.1 } else { one.1 })
    }
}

impl Band<'_> {
    /// Finds what the wall of each pixel belongs to, and where it is in the colon.
    pub(super) fn anatomy(&mut self, subject: &Subject<'_>) {
        if self.labels.is_empty() && self.along.is_empty() {
            return;
        }
        for square in 0..self.squares() {
            let square = self.square(square);
            // What is not deformed is known better.
            let tissue = |c: &Crossing| if subject.tissue.is_some() { c.tissue.as_dvec3() } else { c.place };
            let found = square.pixels.map(|n| self.crossings[n?].as_ref());
            let places = found.map(|c| c.map_or(DVec3::NAN, tissue));
            let along = subject.rings.map_or([[f64::NAN; 16]; 3], |rings| rings.sixteen(&places));
            for (k, n) in square.pixels.into_iter().enumerate() {
                let Some(n) = n else { continue };
                set(self.along, n, || along.map(|a| a[k] as f32));
                set(self.labels, n, || {
                    let label = |labels: &Labels<'_>| labels.label(places[k], self.facing[n].as_dvec3(), along[0][k]);
                    subject.labels.filter(|_| found[k].is_some()).map(label).unwrap_or_default()
                });
            }
        }
    }
}
