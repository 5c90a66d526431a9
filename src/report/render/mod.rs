//! `report render`: error of each method against its time, and the paper's claims by name.

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
use crate::space::PreparedVolume;

use super::methods::{METHODS, RenderMethod};
use super::page::Page;
use super::{Effort, flight};

use measure::{Fault, Measured};

/// A scan in the report.
pub struct Subject {
    /// Prefix of its file names.
    pub name: String,
    /// Title for people.
    pub title: String,
    /// The scan.
    pub volume: PreparedVolume,
}

/// Extent of the measurements.
#[derive(Clone, Copy, Debug)]
pub struct Extent {
    /// Side of the pictures, pixels.
    pub pixels: usize,
    /// View angle, degrees.
    pub fov_degrees: f64,
    /// Number of poses along the flight.
    pub along: usize,
    /// Number of jumps and sudden turns among them.
    pub jumps: usize,
    /// Number of preceding frames of the flight for each pose, for methods that keep data between frames.
    pub lead: usize,
    /// Sides of the voxel cubes that the first subject is resampled to.
    pub sides: &'static [usize],
    /// Number of frames in motion in real time, and how often the camera stops among them.
    pub moving: usize,
    /// See `moving`.
    pub stops: usize,
    /// Decides whether slow methods are left out.
    pub effort: Effort,
}

impl Extent {
    /// Returns the extent of a full report, or of one that takes about a minute.
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

/// Measures every method in every subject and writes the report into `folder`. Returns the findings, one sentence each.
///
/// # Errors
/// Returns status 4 if a subject cannot be flown or if interrupted, 5 if a file cannot be written.
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
            page.text("The flight did not arrive; the poses lie on the part of the path that was flown.");
        }
    }
    page.finish()?;
    Ok(findings)
}
