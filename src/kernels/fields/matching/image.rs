//! The wall of a colon as an image over the distance along its line and the angle about it.

use std::f64::consts::TAU;

use glam::DVec3;
use rayon::prelude::*;

use crate::fields::frames::{Frame, evenly, frames};
use crate::fields::{Along, Lumen};

pub(super) use crate::fields::frames::STEP_MM;

/// Number of angles of a row.
pub(super) const ANGLES: usize = 32;
/// Rays end at this distance from the line, mm.
const FAR_MM: f64 = 45.0;
/// Step of a ray, mm.
const RAY_MM: f64 = 0.5;

/// The wall over distance and angle. Rows are [`STEP_MM`] apart.
#[derive(Clone, Debug)]
pub(super) struct WallImage {
    pub(super) frames: Vec<Frame>,
    /// Distance from the line to the wall, mm, [`ANGLES`] for each row.
    pub(super) radius_mm: Vec<f32>,
    /// False where the line is a guess: the lumen is collapsed there.
    pub(super) is_open: Vec<bool>,
}

impl WallImage {
    /// Samples the wall of `lumen` from the line of `along`, or from that line the other way. `None` if no one line leads from the rectum to the cecum.
    pub(super) fn new(lumen: &Lumen, along: &Along, backwards: bool) -> Option<Self> {
        let line = along.only_line().filter(|_| super::has_line(lumen, along))?;
        let (mut points, mm) = evenly(&line.points);
        let mut is_open: Vec<bool> =
            mm.iter().map(|mm| !along.guessed().iter().any(|[a, b]| (*a..=*b).contains(mm))).collect();
        if backwards {
            points.reverse();
            is_open.reverse();
        }
        let frames = frames(&points);
        let is_inside = |p: DVec3| lumen.segment_at(p).is_some() || lumen.is_fluid(p);
        let radius_mm = frames
            .par_iter()
            .flat_map_iter(|frame| {
                (0..ANGLES).map(move |n| {
                    let direction = frame.direction(TAU * n as f64 / ANGLES as f64);
                    let mut reach = 0.0;
                    while reach < FAR_MM && is_inside(frame.at + direction * (reach + RAY_MM)) {
                        reach += RAY_MM;
                    }
                    (reach + 0.5 * RAY_MM) as f32
                })
            })
            .collect();
        Some(Self { frames, radius_mm, is_open })
    }

    /// Returns the frame at a distance along the line, mm, between those of rows.
    pub(super) fn frame(&self, mm: f64) -> Option<Frame> {
        let last = self.frames.len().checked_sub(1)?;
        let row = (mm / STEP_MM).clamp(0.0, last as f64);
        let (low, high) = (row.floor() as usize, row.ceil() as usize);
        Some(self.frames[low].to(&self.frames[high], row - row.floor()))
    }

    /// Returns the distance from the line to the wall at a distance along it and in the direction of an angle, mm.
    pub(super) fn radius_at(&self, mm: f64, angle: f64) -> f64 {
        let Some(last) = self.rows().checked_sub(1) else { return 0.0 };
        let row = (mm / STEP_MM).round().clamp(0.0, last as f64) as usize;
        let column = (angle.rem_euclid(TAU) / TAU * ANGLES as f64).round() as usize % ANGLES;
        f64::from(self.row(row)[column])
    }

    /// Number of rows.
    pub(super) fn rows(&self) -> usize {
        self.frames.len()
    }

    /// Returns the distances of a row, mm.
    pub(super) fn row(&self, row: usize) -> &[f32] {
        &self.radius_mm[row * ANGLES..][..ANGLES]
    }
}
