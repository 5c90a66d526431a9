//! What each pixel of a view shows: its distance, normal, light, place in the colon, and where it is in the frames before and after.
//!
//! All of it is measured at the first point where the pixel's ray crosses the wall, in double precision ([`Crossing`]). The world is the
//! scan's: mm, LPS.

mod along;
mod angle;
mod band;
mod crossing;
mod flow;
mod labels;
mod lattice;
mod places;
#[cfg(test)]
mod tests;
mod trace;

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use glam::DVec3;
use rayon::prelude::*;

pub use along::Rings;
pub use crossing::Crossing;
pub use flow::{HIDDEN, Neighbour, OUTSIDE};
pub use labels::{Find, Labels};

use crate::error::Result;
use crate::progress::Progress;
use crate::render::View;
use crate::render::leap::Crossings;
use crate::space::PreparedVolume;
use band::{Eyes, bands};

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
    pub labels: Option<&'a Labels<'a>>,
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
        let (begun, clock) = (Instant::now(), Clock::default());
        let is_moving = subject.neighbours[1].is_some_and(|n| n.moved.is_some());
        self.resize(subject.view.width() * subject.view.height(), kinds, is_moving);
        let eyes = Eyes::of(&subject);
        bands(self, subject.view.width()).into_par_iter().try_for_each(|mut band| {
            progress.check()?;
            let start = Instant::now();
            band.cross(&subject, &eyes);
            let crossed = Instant::now();
            band.flow(&subject, &eyes);
            let flowed = Instant::now();
            band.anatomy(&subject);
            clock.add([crossed - start, flowed - crossed, flowed.elapsed()]);
            Ok(())
        })?;
        self.times = clock.shares(begun.elapsed());
        progress.check()
    }

    /// Makes room for `kinds` of so many pixels, and empties all others.
    fn resize(&mut self, count: usize, kinds: &[Kind], is_moving: bool) {
        let room = |kinds_of: &[Kind]| if kinds_of.iter().any(|k| kinds.contains(k)) { count } else { 0 };
        let flow = room(&[Kind::Flow]);
        self.crossings.resize(count, None);
        self.depth.resize(room(&[Kind::Depth]), 0.0);
        self.z.resize(room(&[Kind::Z]), 0.0);
        self.normals.resize(room(&[Kind::Normals]), [0.0; 3]);
        self.shading.resize(room(&[Kind::Shading]), 0.0);
        self.labels.resize(room(&[Kind::Labels]), [0; 2]);
        self.along.resize(room(&[Kind::Along]), [0.0; 3]);
        self.flow.iter_mut().for_each(|f| f.resize(flow, [0.0; 2]));
        self.unseen.iter_mut().for_each(|u| u.resize(flow, 0));
        self.scene.resize(if is_moving { flow } else { 0 }, [0.0; 3]);
    }
}

/// Time that all threads together have spent on each part, ns.
#[derive(Default)]
struct Clock([AtomicU64; 3]);

impl Clock {
    fn add(&self, times: [Duration; 3]) {
        for (sum, time) in self.0.iter().zip(times) {
            sum.fetch_add(time.as_nanos() as u64, Ordering::Relaxed);
        }
    }

    /// Returns the parts' shares of the time that a frame took.
    fn shares(self, whole: Duration) -> Times {
        let spent = self.0.map(|ns| ns.into_inner() as f64);
        let all = spent.iter().sum::<f64>().max(1.0);
        let [crossings, flow, anatomy] = spent.map(|ns| whole.mul_f64(ns / all));
        Times { crossings, flow, anatomy }
    }
}
