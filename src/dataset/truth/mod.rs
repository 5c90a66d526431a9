//! What each pixel of a view shows: its distance, normal, light, place in the colon, and where it is in the frames before and after.
//!
//! All of it is measured at the first point where the pixel's ray crosses the wall, in double precision ([`Crossing`]). The world is the
//! scan's: mm, LPS.

mod along;
mod crossing;
mod flow;
mod lattice;
#[cfg(test)]
mod tests;

use std::time::{Duration, Instant};

use glam::DVec3;
use rayon::prelude::*;

pub use along::Rings;
pub use crossing::Crossing;
pub use flow::{HIDDEN, Neighbour, OUTSIDE};
pub use lattice::Lattice;

use crate::error::Result;
use crate::progress::Progress;
use crate::render::View;
use crate::render::leap::Crossings;
use crate::space::PreparedVolume;
use crossing::{SIDE, crossings};

/// A kind of ground truth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Distance along the ray.
    Depth,
    /// Distance along the camera's axis.
    Z,
    /// Normals of the wall.
    Normals,
    /// Where a pixel's point is in the frames before and after, and whether it is seen there.
    Flow,
    /// The light of a lamp at the camera.
    Shading,
    /// What the wall belongs to.
    Labels,
    /// The place in the colon.
    Along,
}

impl Kind {
    /// Every kind, in the order of their files.
    pub const ALL: [Self; 7] =
        [Self::Depth, Self::Z, Self::Normals, Self::Flow, Self::Shading, Self::Labels, Self::Along];

    /// Returns its name on the command line and in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Depth => "depth",
            Self::Z => "z",
            Self::Normals => "normals",
            Self::Flow => "flow",
            Self::Shading => "shading",
            Self::Labels => "labels",
            Self::Along => "along",
        }
    }

    /// Returns the kind of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|k| k.name() == name)
    }
}

/// What the wall belongs to at a point (world, mm), as numbers that the asker knows.
pub trait Labeller: Sync {
    /// Returns the number of what is at a point of the wall whose normal, into the gas, is known; and that of the part of the colon.
    fn label(&self, place: DVec3, normal: DVec3, along: Option<f64>) -> [u8; 2];
}

/// What is measured, and in what.
#[derive(Clone, Copy)]
pub struct Subject<'a> {
    /// The scan at the moment of the frame.
    pub volume: &'a PreparedVolume,
    /// Rays through it.
    pub rays: &'a Crossings,
    /// The camera and its pixels.
    pub view: &'a View,
    /// The scan's place of the tissue at a place, both world, mm, if the scan is deformed.
    pub tissue: Option<&'a (dyn Fn(DVec3) -> DVec3 + Sync)>,
    /// The frames before and after, if there are any.
    pub neighbours: [Option<Neighbour<'a>>; 2],
    /// The line of the colon, for [`Kind::Along`] and for labels by distance.
    pub rings: Option<&'a Rings>,
    /// For [`Kind::Labels`].
    pub labeller: Option<&'a dyn Labeller>,
}

/// The ground truth of a frame, row by row from the top left pixel. What was not asked for is empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Truth {
    /// Distance along the ray, mm; infinite where there is no wall.
    pub depth: Vec<f32>,
    /// Distance along the camera's axis, mm; infinite where there is no wall.
    pub z: Vec<f32>,
    /// World, of unit length, towards the gas; NaN where there is no wall.
    pub normals: Vec<[f32; 3]>,
    /// By how many pixels to the right and downwards the point is elsewhere in the frame before, and in that after; NaN where there is
    /// no wall, or no such frame, where its camera does not show that direction, and beyond its picture unless it is a pinhole.
    pub flow: [Vec<[f32; 2]>; 2],
    /// For each of both whether the point is [`HIDDEN`] or [`OUTSIDE`] there; 0 where it is seen.
    pub unseen: [Vec<u8>; 2],
    /// By how much the point's tissue has moved by the frame after, world, mm; NaN where there is no wall. Empty unless the scan is deformed.
    pub scene: Vec<[f32; 3]>,
    /// cos/r² of a lamp at the camera, 1/mm²: what a wall that is white and scatters evenly sends back. 0 where there is no wall.
    pub shading: Vec<f32>,
    /// What the wall belongs to, and the part of the colon; 0 where there is no wall.
    pub labels: Vec<[u8; 2]>,
    /// Distance along the line from its beginning, mm; distance from the line, mm; and angle about it, radians from −π to π. NaN where
    /// there is no wall, or no line.
    pub along: Vec<[f32; 3]>,
    /// Where each pixel's ray crosses the wall.
    pub crossings: Vec<Option<Crossing>>,
    /// Times that the parts took.
    pub times: Times,
}

/// Times that the parts of a frame's truth took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Times {
    /// The crossings, with depths, normals and light.
    pub crossings: Duration,
    /// Both flows.
    pub flow: Duration,
    /// Labels and places in the colon.
    pub anatomy: Duration,
}

impl Truth {
    /// Measures the truth of `kinds` for a frame. The result is the same for every number of threads.
    ///
    /// # Errors
    /// Returns status 4 if interrupted.
    pub fn measure(&mut self, subject: Subject<'_>, kinds: &[Kind], progress: &Progress) -> Result<()> {
        let has = |kind| kinds.contains(&kind);
        let begun = Instant::now();
        let found = crossings(subject.volume, subject.rays, subject.view, subject.tissue, progress)?;
        let (view, eye) = (subject.view, subject.view.position());
        fill(&mut self.depth, has(Kind::Depth), &found, |_, c| c.map_or(f32::INFINITY, |c| c.mm as f32));
        fill(&mut self.z, has(Kind::Z), &found, |_, c| {
            c.map_or(f32::INFINITY, |c| (c.place - eye).dot(view.forward()) as f32)
        });
        let unit = |c: &Crossing| c.normal.as_vec3().to_array();
        fill(&mut self.normals, has(Kind::Normals), &found, |_, c| c.map_or([f32::NAN; 3], unit));
        fill(&mut self.shading, has(Kind::Shading), &found, |_, c| c.map_or(0.0, |c| c.headlight(eye) as f32));
        let crossed = begun.elapsed();
        for (n, neighbour) in subject.neighbours.into_iter().enumerate() {
            let (flow, unseen) = (&mut self.flow[n], &mut self.unseen[n]);
            if has(Kind::Flow) {
                flow::measure(view, neighbour, &found, (flow, unseen), progress)?;
            } else {
                flow.clear();
                unseen.clear();
            }
        }
        let moved = subject.neighbours[1].and_then(|n| n.moved).filter(|_| has(Kind::Flow));
        fill(&mut self.scene, moved.is_some(), &found, |_, c| {
            c.zip(moved).map_or([f32::NAN; 3], |(c, moved)| (moved(c.place) - c.place).as_vec3().to_array())
        });
        let flowed = begun.elapsed();
        let rings = subject.rings.filter(|_| has(Kind::Along) || has(Kind::Labels));
        let mut along = Vec::new();
        fill(&mut along, has(Kind::Along) || has(Kind::Labels), &found, |_, c| {
            c.and_then(|c| Some(rings?.of(c.tissue)?.map(|x| x as f32))).unwrap_or([f32::NAN; 3])
        });
        fill(&mut self.labels, has(Kind::Labels), &found, |n, c| {
            let mm = along[n][0];
            let label =
                |c: &Crossing| Some(subject.labeller?.label(c.tissue, c.normal, mm.is_finite().then_some(mm.into())));
            c.and_then(label).unwrap_or_default()
        });
        self.along = if has(Kind::Along) { along } else { Vec::new() };
        self.crossings = found;
        self.times = Times { crossings: crossed, flow: flowed - crossed, anatomy: begun.elapsed() - flowed };
        progress.check()
    }
}

/// Fills a list with what `of` returns for each pixel, or empties it.
fn fill<T: Send + Copy + Default>(
    out: &mut Vec<T>,
    is_wanted: bool,
    found: &[Option<Crossing>],
    of: impl Fn(usize, Option<&Crossing>) -> T + Sync,
) {
    out.clear();
    if is_wanted {
        out.resize(found.len(), T::default());
        let each = SIDE * SIDE * 16;
        out.par_chunks_mut(each).zip(found.par_chunks(each)).enumerate().for_each(|(n, (out, found))| {
            out.iter_mut().zip(found).enumerate().for_each(|(k, (out, c))| *out = of(n * each + k, c.as_ref()));
        });
    }
}
