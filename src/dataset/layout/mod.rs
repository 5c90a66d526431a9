//! How the files of a dataset are named and listed: a layout is one file here and a line in [`BUILT_IN`].
//!
//! Every layout keeps the ground truth as it is measured in `truth/`, a folder for each kind. What differs is where the pictures lie,
//! which other files of a frame a program expects, and the lists.

mod colmap;
mod nerfstudio;
mod own;
mod tum;
mod vslam_lab;

use std::fmt::Debug;

use super::camera::{Intrinsics, VisionPose};
use super::truth::{Crossing, Kind, Truth};
use crate::error::{Error, Result};
use crate::render::View;

/// A layout, by its name.
#[derive(Clone, Copy)]
pub struct LayoutModel {
    /// Its name on the command line.
    pub name: &'static str,
    /// A one-sentence description for users.
    pub summary: &'static str,
    /// True if its files have a place for the camera.
    pub holds: fn(&Intrinsics) -> bool,
    /// Creates it, for a camera that it holds.
    pub make: fn(&Intrinsics) -> Box<dyn Layout>,
}

/// Every layout of this crate.
pub const BUILT_IN: [LayoutModel; 5] = [own::MODEL, tum::MODEL, colmap::MODEL, nerfstudio::MODEL, vslam_lab::MODEL];

impl LayoutModel {
    /// Returns the layout of that name.
    pub fn named(name: &str) -> Option<Self> {
        BUILT_IN.into_iter().find(|m| m.name == name)
    }

    /// Creates the layout for a camera.
    ///
    /// # Errors
    /// Returns status 2 if it has no place for that, and names the layouts that have.
    pub fn layout(&self, camera: &Intrinsics) -> Result<Box<dyn Layout>> {
        let (holds, make) = (self.holds, self.make);
        if holds(camera) {
            return Ok(make(camera));
        }
        let others: Vec<&str> = BUILT_IN.iter().filter(|m| (m.holds)(camera)).map(|m| m.name).collect();
        let why = format!("has no place for {}", camera.told());
        Err(Error::usage(format!("--layout {}", self.name), why, format!("give --layout {}", others.join(" or "))))
    }
}

/// A frame, for its files.
#[derive(Clone, Copy)]
pub struct Shot<'a> {
    /// Its number, from 0.
    pub n: usize,
    /// When it was taken, s.
    pub seconds: f64,
    /// Its camera.
    pub view: &'a View,
    /// What its pixels show.
    pub truth: &'a Truth,
}

impl Shot<'_> {
    /// Returns the depth along the camera's axis in steps of `step_mm`, 16 bits, row by row; 0 where there is no wall or it is too far.
    pub fn z16(&self, step_mm: f64) -> Vec<u16> {
        let (eye, forward) = (self.view.position(), self.view.forward());
        self.depth16(step_mm, |c| (c.place - eye).dot(forward))
    }

    /// Returns the distance along each pixel's ray in the same way.
    pub fn ray16(&self, step_mm: f64) -> Vec<u16> {
        self.depth16(step_mm, |c| c.mm)
    }

    fn depth16(&self, step_mm: f64, mm: impl Fn(&Crossing) -> f64) -> Vec<u16> {
        let steps = |c: &Crossing| {
            let steps = (mm(c) / step_mm).round();
            if (1.0..65536.0).contains(&steps) { steps as u16 } else { 0 }
        };
        self.truth.crossings.iter().map(|c| c.as_ref().map_or(0, steps)).collect()
    }
}

/// A frame in the lists.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entry {
    /// Its number, from 0.
    pub n: usize,
    /// When it was taken, s.
    pub seconds: f64,
    /// Its pose.
    pub pose: VisionPose,
}

/// What the lists are written from.
#[derive(Clone, Copy)]
pub struct Index<'a> {
    /// The camera.
    pub camera: &'a Intrinsics,
    /// Width and height, pixels.
    pub size: [usize; 2],
    /// Frames a second.
    pub fps: f64,
    /// The kinds of ground truth.
    pub kinds: &'a [Kind],
    /// The frames, in order.
    pub frames: &'a [Entry],
    /// Some points of the wall that are seen in several frames.
    pub points: &'a [Point],
}

/// A point of the wall and where frames see it.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// World, mm.
    pub place: glam::DVec3,
    /// 8-bit red, green and blue of the pixel where it is first seen.
    pub colour: [u8; 3],
    /// The frame's number, and the place in its picture, pixels from the top left corner.
    pub seen: Vec<(usize, [f64; 2])>,
}

/// What a file of a frame holds.
#[derive(Clone, Debug, PartialEq)]
pub enum Content {
    /// 16 bits a pixel, as a PNG.
    Grey16(Vec<u16>),
    /// As it is.
    Text(String),
}

/// Names and lists of a dataset.
pub trait Layout: Send + Sync {
    /// Returns the name of a frame's picture, below the dataset's folder. It ends in `.png`.
    fn picture(&self, n: usize, seconds: f64) -> String;

    /// Returns a frame's files beside its picture and its ground truth, by their names.
    fn files(&self, _shot: &Shot<'_>) -> Vec<(String, Content)> {
        Vec::new()
    }

    /// Returns how many points of the wall its lists want for each frame, at most; 0 for none.
    fn points(&self) -> usize {
        0
    }

    /// Returns its lists, by their names.
    fn lists(&self, index: &Index<'_>) -> Vec<(String, String)>;

    /// Returns what a reader of its folder has to know beside what all layouts have in common: units, axes, files.
    fn told(&self) -> &'static str;
}

/// Writes a line for each frame.
pub(crate) fn lines(head: &str, frames: &[Entry], line: impl Fn(&Entry) -> String) -> String {
    let mut text = head.to_owned();
    for frame in frames {
        text.push_str(&line(frame));
        text.push('\n');
    }
    text
}

/// Returns a pose as TUM writes it: position in metres, rotation as a quaternion x, y, z, w, from the camera to the world.
fn metres(pose: &VisionPose, between: &str) -> String {
    let place = (pose.position * 1e-3).to_array().map(|m| format!("{m:.9}"));
    let turn = pose.quaternion().map(|q| format!("{q:.12}"));
    [&place[..], &turn[..]].concat().join(between)
}
