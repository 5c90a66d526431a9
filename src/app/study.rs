//! A colon that detectors search for polyp candidates, and the list that files have of what they find.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::DVec3;
use serde::Serialize;

use crate::Timings;
use crate::colon;
use crate::error::Result;
use crate::fields::cleanse::Cleansed;
use crate::fields::{Along, Lumen};
use crate::polyps::{self, Candidate, Coated, Coats, Colon, Detector, FEATURES, Wall};
use crate::progress::Progress;
use crate::volume::Volume;

/// A candidate in a list. Places are world, mm LPS.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CandidateEntry {
    /// Rank, from 1.
    pub rank: usize,
    /// The detector's score.
    pub score: f64,
    /// Position.
    pub position: DVec3,
    /// Largest diameter, if it could be measured.
    pub diameter_mm: Option<f64>,
    /// Height above the wall, if it could be measured.
    pub height_mm: Option<f64>,
    /// Volume, if it could be measured.
    pub volume_mm3: Option<f64>,
    /// Distance along the colon from the rectal end, if it is known.
    pub along_mm: Option<f64>,
    /// Segment of the lumen, counted from 0.
    pub segment: Option<usize>,
    /// Part of the colon.
    pub part: Option<&'static str>,
    /// Share of the wall there that wears thin tag, 0 to 1; `None` if nobody looked for it.
    pub coated: Option<f64>,
    /// Mean thickness of that tag, mm; `None` without any.
    pub coat_mm: Option<f64>,
    /// What was measured of it, by name.
    pub features: BTreeMap<&'static str, f64>,
}

impl CandidateEntry {
    /// Creates the entry of a candidate, of which so much is coated.
    pub fn new(rank: usize, candidate: &Candidate, along: &Along, coated: Option<Coated>) -> Self {
        let lesion = candidate.lesion.as_ref();
        let place = along.of(candidate.position);
        Self {
            rank,
            score: candidate.score,
            position: candidate.position,
            diameter_mm: lesion.map(|l| l.diameter_mm),
            height_mm: lesion.map(|l| l.height_mm),
            volume_mm3: lesion.map(|l| l.volume_mm3),
            along_mm: place.map(|p| p.mm),
            segment: place.map(|p| p.segment),
            part: place.and_then(|p| p.part),
            coated: coated.map(|c| c.share),
            coat_mm: coated.map(|c| c.thickness_mm).filter(|mm| *mm > 0.0),
            features: lesion.map_or_else(BTreeMap::new, |l| FEATURES.into_iter().zip(l.features).collect()),
        }
    }
}

/// A colon that is ready to be searched.
#[derive(Debug)]
pub struct Study {
    /// The scan around the colon.
    pub volume: Volume,
    /// Its lumen.
    pub lumen: Lumen,
    /// The measure along it.
    pub along: Arc<Along>,
    /// Its wall.
    pub wall: Wall,
}

impl Study {
    /// Prepares a cleansed scan, up to `beyond_mm` beyond its lumen. `iso` is the value of the wall, HU.
    ///
    /// # Errors
    /// Returns status 4 if interrupted.
    pub fn new(
        volume: Volume,
        lumen: Lumen,
        iso: f64,
        beyond_mm: f64,
        timings: &mut Timings,
        progress: &Progress,
    ) -> Result<Self> {
        let along = lumen.along(&volume, progress)?;
        let (volume, lumen) = colon::around(volume, lumen, beyond_mm);
        let wall = timings.time("wall_s", || Wall::new(&volume, &lumen, iso, progress))?;
        Ok(Self { volume, lumen, along, wall })
    }

    /// Returns what a detector finds, best first.
    ///
    /// # Errors
    /// Returns status 4 if interrupted, or the detector's error.
    pub fn find(&self, detector: &Detector, progress: &Progress) -> Result<Vec<Candidate>> {
        polyps::find(detector, &Colon { volume: &self.volume, lumen: &self.lumen, wall: &self.wall }, progress)
    }

    /// Finds the thin tag on the wall, in the values as `scanned`. `cleansed` is what was cleansed, if anything was.
    ///
    /// # Errors
    /// Returns status 4 if interrupted.
    pub fn coats(&self, scanned: Option<&Volume>, cleansed: Option<&Cleansed>, progress: &Progress) -> Result<Coats> {
        Coats::find(&self.wall, scanned.unwrap_or(&self.volume), cleansed, progress)
    }

    /// Returns the entries of candidates, with ranks from 1. `coats` are those of its wall, if they were looked for.
    pub fn entries(&self, found: &[Candidate], coats: Option<&Coats>) -> Vec<CandidateEntry> {
        let coated = coats.map(|coats| coats.of_each(&self.wall, found));
        let entry = |(n, c)| CandidateEntry::new(n + 1, c, &self.along, coated.as_ref().map(|coated| coated[n]));
        found.iter().enumerate().map(entry).collect()
    }
}
