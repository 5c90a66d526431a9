//! The place of a point in the colon: distance along its line, distance from it, and angle about it.

use std::sync::Arc;

use glam::DVec3;

use super::band::{Band, set};
use super::lattice::Lattice;
use super::{Crossing, Subject};
use crate::fields::Along;
use crate::fields::centerline::Centerline;
use crate::fields::frames::{Frame, STEP_MM, evenly, frames};
use crate::volume::Grid;

/// The nearest point of the line is looked for within this of the one that the colon's map names, mm along.
const WINDOW_MM: f64 = 12.0;
/// Steps in which that is remembered, mm.
const NEAR_STEP_MM: f64 = 0.5;

/// The line of a colon with frames that do not turn about it.
#[derive(Debug)]
pub struct Rings {
    along: Arc<Along>,
    /// Where places are along the line, in steps of [`NEAR_STEP_MM`] from 1; 0 for nowhere.
    known: Lattice,
    frames: Vec<Frame>,
    /// Distance of each frame along the line as scanned, mm.
    mm: Vec<f64>,
}

impl Rings {
    /// Creates them for the only line of a colon in a scan's grid; `None` if there is none.
    pub fn new(along: &Arc<Along>, grid: &Grid) -> Option<Self> {
        let line: &Centerline = along.only_line()?;
        let (even, mm) = evenly(&line.points);
        let frames = frames(&even);
        (frames.len() > 1 && frames.len() == mm.len()).then(|| Self {
            along: Arc::clone(along),
            known: Lattice::new(grid),
            frames,
            mm,
        })
    }

    /// Returns the points of the line, world, mm, with the distance of each along it, mm.
    pub fn points(&self) -> impl Iterator<Item = (f64, &Frame)> {
        self.mm.iter().copied().zip(&self.frames)
    }

    /// Returns the distance along the line, mm, that from the line, mm, and the angle about it, radians from −π to π, of a point (world,
    /// mm); `None` if it is farther than 12 mm from the lumen. Angle 0 is towards the patient's front where the line begins.
    pub fn of(&self, place: DVec3) -> Option<[f64; 3]> {
        let steps = |place| self.along.of(place).map_or(0, |at| (at.mm / NEAR_STEP_MM).clamp(0.0, 65_000.0) as u16 + 1);
        let about = f64::from(self.known.label(place, steps).checked_sub(1)?) * NEAR_STEP_MM;
        // The frames are evenly spaced.
        let frame = |mm: f64| mm.max(0.0) / STEP_MM;
        let last = (frame(about + WINDOW_MM) as usize + 1).clamp(2, self.frames.len());
        let first = (frame(about - WINDOW_MM).ceil() as usize).min(last - 2);
        let away = |n: usize| self.frames[n].at.distance_squared(place);
        let nearest = (first..last).min_by(|a, b| away(*a).total_cmp(&away(*b)))?;
        // The nearest point of the two lengths that meet there.
        let on = |n: usize| {
            let (a, b) = (self.frames[n].at, self.frames[n + 1].at);
            let share = ((place - a).dot(b - a) / (b - a).length_squared().max(1e-12)).clamp(0.0, 1.0);
            (n, share, a.lerp(b, share).distance_squared(place))
        };
        let lengths = nearest.saturating_sub(1)..(nearest + 1).min(self.frames.len() - 1);
        let (n, share, square) = lengths.map(on).min_by(|a, b| a.2.total_cmp(&b.2))?;
        let frame = self.frames[n].to(&self.frames[n + 1], share);
        let mm = self.mm[n] + (self.mm[n + 1] - self.mm[n]) * share;
        Some([mm, square.sqrt(), frame.angle(place - frame.at)])
    }
}

impl Band<'_> {
    /// Finds what the wall of each pixel belongs to, and where it is in the colon.
    pub(super) fn anatomy(&mut self, subject: &Subject<'_>) {
        if self.labels.is_empty() && self.along.is_empty() {
            return;
        }
        for (n, found) in self.crossings.iter().enumerate() {
            // What is not deformed is known better.
            let tissue = |c: &Crossing| if subject.tissue.is_some() { c.tissue.as_dvec3() } else { c.place };
            let along = found.as_ref().and_then(|c| subject.rings?.of(tissue(c)));
            set(self.along, n, || along.map_or([f32::NAN; 3], |a| a.map(|x| x as f32)));
            set(self.labels, n, || {
                let label = |c: &Crossing| {
                    Some(subject.labeller?.label(tissue(c), self.facing[n].as_dvec3(), along.map(|a| a[0])))
                };
                found.as_ref().and_then(label).unwrap_or_default()
            });
        }
    }
}
