//! Places of the wall that look like polyps, and their measures.
//!
//! A [`Detector`] looks at a [`Colon`] and returns [`Candidate`]s. Those of this crate are in [`detectors::BUILT_IN`]; a program
//! may add its own with `Program::detector`. [`find`] runs one and leaves the best candidate of each place, measured.
//! [`answers`] holds what a reader says of them.

pub mod answers;
pub(crate) mod base;
mod broad;
mod caps;
mod coats;
pub mod detectors;
mod edge;
mod fit;
mod flow;
mod lesion;
mod measure;
mod score;
mod settle;
mod wall;

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::fields::Lumen;
use crate::panics::ask_plugin;
use crate::progress::Progress;
use crate::volume::Volume;

pub use caps::{Cap, caps};
pub use coats::{Coated, CoatedPlaces, CoatedSpot, Coats};
pub use lesion::{FEATURES, Lesion};
pub use measure::{Form, Measurement, RESTORED_HU, measure};
pub use score::{EVIDENCE, Term, score, terms};
pub use wall::{SMOOTH_MM, Wall};

/// Maximum distance of a candidate's place from the wall, mm, approximately: more than the radius of a large polyp.
const WALL_MM: f64 = 10.0;
/// Candidates nearer to a better one than this are the same place, mm.
const SAME_MM: f64 = 5.0;

/// The input of a detector. A scan with tag has been cleansed.
#[derive(Debug)]
pub struct Colon<'a> {
    /// The scan, HU.
    pub volume: &'a Volume,
    /// The lumen in it.
    pub lumen: &'a Lumen,
    /// Its wall.
    pub wall: &'a Wall,
}

/// A place that may be a polyp.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Candidate {
    /// Where it is: a place on the wall, world, mm LPS.
    pub position: DVec3,
    /// How much it looks like a polyp. Larger is more likely; the scale is the detector's own.
    pub score: f64,
    /// Its measures, if its detector took them.
    pub lesion: Option<Lesion>,
}

impl Candidate {
    /// Creates a candidate that is not measured yet.
    pub fn new(position: DVec3, score: f64) -> Self {
        Self { position, score, lesion: None }
    }
}

/// A method that finds polyps. Create one with [`Detector::new`], so that your code also compiles with later fields.
#[derive(Clone, Copy, Debug)]
pub struct Detector {
    /// Its name, for `--detector`.
    pub name: &'static str,
    /// A one-sentence description for users.
    pub summary: &'static str,
    /// Returns the candidates in a colon, in any order. Their places must be on its wall. The same colon must give the same candidates on any number of threads.
    pub find: fn(&Colon<'_>, &Progress) -> Result<Vec<Candidate>>,
}

impl Detector {
    /// Creates a detector.
    pub const fn new(
        name: &'static str,
        summary: &'static str,
        find: fn(&Colon<'_>, &Progress) -> Result<Vec<Candidate>>,
    ) -> Self {
        Self { name, summary, find }
    }
}

/// Runs a detector. Returns its candidates, best first, one for each place.
///
/// # Errors
/// Returns the detector's error, or status 1 if it panics, or if a place is not finite, outside the scan or far from the wall.
pub fn find(detector: &Detector, colon: &Colon<'_>, progress: &Progress) -> Result<Vec<Candidate>> {
    progress.stage("looking for polyps", 0);
    let found = ask_plugin(|| format!("detector {}", detector.name), || (detector.find)(colon, progress))?;
    if let Some(why) = misplaced(&found, colon) {
        return Err(Error::fault(format!("detector {}", detector.name), why, "fix it or leave it out"));
    }
    let mut found: Vec<Candidate> = found.into_iter().filter(|c| c.score.is_finite()).collect();
    let key = |c: &Candidate| c.position.to_array();
    found.sort_by(|a, b| {
        let [p, q] = [key(a), key(b)];
        b.score.total_cmp(&a.score).then_with(|| p.partial_cmp(&q).unwrap_or(std::cmp::Ordering::Equal))
    });
    let mut kept: Vec<Candidate> = Vec::new();
    // What was kept, by cells of that size: a detector may return every vertex.
    let mut cells: BTreeMap<[i64; 3], Vec<usize>> = BTreeMap::new();
    for c in found {
        let at = cell(c.position, SAME_MM);
        let mut near = beside(at).filter_map(|n| cells.get(&n));
        if near.all(|own| own.iter().all(|&k| kept[k].position.distance(c.position) >= SAME_MM)) {
            cells.entry(at).or_default().push(kept.len());
            kept.push(c);
        }
    }
    Ok(kept)
}

/// The cell of a place, in cells of `mm`.
fn cell(place: DVec3, mm: f64) -> [i64; 3] {
    (place / mm).floor().to_array().map(|x| x as i64)
}

/// A cell and the 26 beside it.
fn beside([x, y, z]: [i64; 3]) -> impl Iterator<Item = [i64; 3]> {
    (0..27).map(move |n| {
        let [i, j, k] = [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1];
        [x.saturating_add(i), y.saturating_add(j), z.saturating_add(k)]
    })
}

/// Returns what is wrong with the places of candidates: the first that is not on the wall.
fn misplaced(found: &[Candidate], colon: &Colon<'_>) -> Option<String> {
    if found.is_empty() {
        return None;
    }
    let grid = colon.volume.grid();
    let last = DVec3::from_array(grid.dims().map(|n| n as f64 - 1.0));
    // Cells that hold wall: a place without any in its cell and those beside it is farther from it than a cell's edge.
    let vertices = (0..colon.wall.len() as u32).into_par_iter();
    let add = |(mut walled, before): (BTreeSet<[i64; 3]>, Option<[i64; 3]>), vertex| {
        let at = cell(colon.wall.world(vertex), WALL_MM);
        // Vertices that follow each other are near to each other.
        if before != Some(at) {
            walled.insert(at);
        }
        (walled, Some(at))
    };
    let parts = vertices.fold(Default::default, add).map(|part| part.0);
    let walled = parts.reduce(BTreeSet::new, |mut all, part| {
        all.extend(part);
        all
    });
    found.iter().map(|c| c.position).find_map(|p| {
        let voxel = grid.voxel(p);
        let why = if !p.is_finite() {
            return Some("returned a place that is not finite".to_owned());
        } else if voxel.cmplt(DVec3::splat(-1.0)).any() || voxel.cmpgt(last + 1.0).any() {
            "outside the scan"
        } else if !beside(cell(p, WALL_MM)).any(|n| walled.contains(&n)) {
            "far from the wall"
        } else {
            return None;
        };
        // Not with 300 digits.
        let of = |x: f64| if x.abs() < 1e6 { format!("{x:.1}") } else { format!("{x:.1e}") };
        Some(format!("returned a place {why}: {},{},{} mm", of(p.x), of(p.y), of(p.z)))
    })
}

#[cfg(test)]
mod sweep;
#[cfg(test)]
mod tests;
