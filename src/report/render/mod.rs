//! `report render`: each method's error against its time, and the paper's claims by name.

mod claims;
mod growth;
mod measure;
mod motion;
mod pages;
mod recount;
#[cfg(test)]
mod tests;
mod worth;

use std::path::Path;

use crate::components::flight::State;
use crate::error::Result;
use crate::progress::Progress;
use crate::render::PreparedVolume;

use super::methods::{METHODS, RenderMethod};
use super::page::Page;
use super::{Effort, flight};

pub use measure::{Fault, Measured};

/// A scan that is reported on.
pub struct Subject {
    /// Begins the names of its files.
    pub name: String,
    /// As a person reads it.
    pub title: String,
    /// The scan.
    pub volume: PreparedVolume,
}

/// How much is measured.
#[derive(Clone, Copy, Debug)]
pub struct Extent {
    /// Pixels along each side.
    pub pixels: usize,
    /// View angle, degrees.
    pub fov_degrees: f64,
    /// Poses along the flight.
    pub along: usize,
    /// Jumps and sudden turns among them.
    pub jumps: usize,
    /// Frames of the flight before each pose, for methods that keep something between frames.
    pub lead: usize,
    /// Sides of the cubes of voxels that the first subject is resampled to.
    pub sides: &'static [usize],
    /// Frames in motion by the clock, and how often the camera stands still among them.
    pub moving: usize,
    /// See `moving`.
    pub stops: usize,
    /// Whether slow methods are left out.
    pub effort: Effort,
}

impl Extent {
    /// The whole report, or what fits a minute.
    pub fn new(effort: Effort, fov_degrees: f64) -> Self {
        if effort == Effort::Quick {
            Self {
                pixels: 256,
                fov_degrees,
                along: 6,
                jumps: 2,
                lead: 3,
                sides: &[64, 128, 256],
                moving: 120,
                stops: 2,
                effort,
            }
        } else {
            Self {
                pixels: 512,
                fov_degrees,
                along: 24,
                jumps: 8,
                lead: 4,
                sides: &[256, 512, 1024],
                moving: 600,
                stops: 6,
                effort,
            }
        }
    }
}

/// Measures every method in every subject and writes the report into `folder`. Returns the findings, a sentence each.
///
/// # Errors
/// Status 4 where a subject cannot be flown or when interrupted, 5 when a file cannot be written.
pub fn report(subjects: &[Subject], extent: &Extent, folder: &Path, progress: &Progress) -> Result<Vec<String>> {
    let methods: Vec<RenderMethod> =
        METHODS.iter().copied().filter(|m| !(extent.effort == Effort::Quick && m.traits.slow)).collect();
    let mut page = Page::new(folder, "colvis: error against run time of the renderers")?;
    pages::introduction(&mut page, extent);
    let mut findings = Vec::new();
    for (n, s) in subjects.iter().enumerate() {
        let flown = flight::fly(&s.volume, progress)?;
        let stops = flown.stops(extent.along, extent.jumps, extent.lead);
        let measured = measure::measure(&s.volume, &methods, &stops, extent, progress)?;
        let claims = claims::claims(&s.volume, &measured, &stops, extent, progress)?;
        findings.extend(pages::subject(&mut page, s, &measured, &claims)?);
        let taken = worth::measure(&s.volume, &stops, extent, progress)?;
        worth::tell(&mut page, s, &taken, extent)?;
        drop(taken);
        drop(measured);
        let moved = motion::motion(&s.volume, &flown, extent, progress)?;
        findings.push(pages::motion(&mut page, s, &moved, extent)?);
        if n == 0 {
            let grown = growth::growth(&s.volume, &flown, &stops, extent, progress)?;
            findings.push(pages::growth(&mut page, s, &grown, extent)?);
        }
        if flown.state != State::Arrived {
            page.text("The flight did not arrive; the poses lie on the part of the way that was flown.");
        }
    }
    page.finish()?;
    Ok(findings)
}
