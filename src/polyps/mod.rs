//! Places of the wall that look like polyps, and their measures.
//!
//! A [`Detector`] looks at a [`Colon`] and returns [`Candidate`]s. Those of this crate are in [`detectors::BUILT_IN`]; a program
//! may add its own with `Program::detector`. [`find`] runs one and leaves the best candidate of each place, measured.
//! [`answers`] holds what a reader says of them.

pub mod answers;
pub(crate) mod base;
mod caps;
pub mod detectors;
mod fit;
mod flow;
mod lesion;
mod measure;
mod score;
mod wall;

use std::collections::BTreeMap;

use glam::DVec3;

use crate::error::Result;
use crate::fields::Lumen;
use crate::panics::ask_plugin;
use crate::progress::Progress;
use crate::volume::Volume;

pub use caps::{Cap, caps};
pub use lesion::{FEATURES, Lesion};
pub use measure::{Form, Measurement, measure};
pub use score::{TERMS, Term, score, terms};
pub use wall::{SMOOTH_MM, Wall};

/// Candidates nearer to a better one than this are the same place, mm.
const SAME_MM: f64 = 5.0;

/// What a detector looks at. The scan has no tag any more if it had some.
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

/// A method that finds polyps.
#[derive(Clone, Copy, Debug)]
pub struct Detector {
    /// Its name, for `--detector`.
    pub name: &'static str,
    /// A one-sentence description for users.
    pub summary: &'static str,
    /// Returns the candidates in a colon, in any order. The same colon must give the same candidates on any number of threads.
    pub find: fn(&Colon<'_>, &Progress) -> Result<Vec<Candidate>>,
}

/// Runs a detector. Returns its candidates with the best first, one for each place.
///
/// # Errors
/// Returns the detector's error, or status 1 if it panics.
pub fn find(detector: &Detector, colon: &Colon<'_>, progress: &Progress) -> Result<Vec<Candidate>> {
    progress.stage("looking for polyps", 0);
    let found = ask_plugin(|| format!("detector {}", detector.name), || (detector.find)(colon, progress))?;
    let mut found: Vec<Candidate> =
        found.into_iter().filter(|c| c.position.is_finite() && c.score.is_finite()).collect();
    let key = |c: &Candidate| c.position.to_array();
    found.sort_by(|a, b| {
        let [p, q] = [key(a), key(b)];
        b.score.total_cmp(&a.score).then_with(|| p.partial_cmp(&q).unwrap_or(std::cmp::Ordering::Equal))
    });
    let mut kept: Vec<Candidate> = Vec::new();
    // What was kept, by cells of that size: a detector may return every vertex.
    let mut cells: BTreeMap<[i64; 3], Vec<usize>> = BTreeMap::new();
    let cell = |p: DVec3| (p / SAME_MM).floor().to_array().map(|x| x as i64);
    for c in found {
        let [x, y, z] = cell(c.position);
        let mut near = (0..27).filter_map(|n| {
            let [i, j, k] = [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1];
            cells.get(&[x.saturating_add(i), y.saturating_add(j), z.saturating_add(k)])
        });
        if near.all(|own| own.iter().all(|&k| kept[k].position.distance(c.position) >= SAME_MM)) {
            cells.entry([x, y, z]).or_default().push(kept.len());
            kept.push(c);
        }
    }
    Ok(kept)
}

#[cfg(test)]
mod tests;
