//! The second position in a report: what of the findings is there, or expected there, and how well it can be read.

use std::path::Path;
use std::sync::Arc;

use super::{SIDE, complete, judged};
use crate::app::Timings;
use crate::app::findings::{Finding, FindingPicture, Findings, Quality, SegmentFacts, wall_near};
use crate::cli::args::{CaseArgs, Global, SeriesChoice};
use crate::cli::messages::say;
use crate::cli::pair::Pair;
use crate::cli::prepare;
use crate::cli::shared::Use;
use crate::error::{Error, Result};
use crate::fields::matching::{Match, Matching, Side};
use crate::fields::{Along, Lumen};
use crate::progress::Progress;
use crate::render::Preset;
use crate::space::{PreparedVolume, TransferFunction};
use crate::volume::{Volume, content_hash};

/// The scan of the second position.
pub(super) struct Second {
    pub(super) hash: String,
    /// For each finding what it is there; `None` if that is not known.
    pub(super) findings: Vec<Option<There>>,
    /// The quality of each segment, with what else is known of it.
    pub(super) quality: Vec<(Quality, SegmentFacts)>,
}

/// A finding in the second position.
pub(super) struct There {
    /// Its place there, with its measures if the reader has marked it there.
    pub(super) finding: Finding,
    /// Where it is expected along the colon, if the reader has not marked it there.
    pub(super) expected: Option<Match>,
    pub(super) pictures: Vec<FindingPicture>,
}

/// What is known of the first position.
pub(super) struct First<'a> {
    pub(super) findings: &'a Findings,
    pub(super) lumen: &'a Lumen,
    pub(super) along: &'a Along,
    /// For the pictures of both.
    pub(super) transfer: TransferFunction,
}

/// Returns the pair of positions, and the options with which the second is read. Fails with status 3 if a study has no second one.
fn own(path: &Path, args: &CaseArgs, global: &Global) -> Result<(Pair, Global)> {
    let pair = Pair { first: (args.input.clone(), global.series_number()), second: path.to_owned() };
    let own = Global { series: pair.paired(global)?.map(SeriesChoice::Number), ..global.clone() };
    Ok((pair, own))
}

/// Refuses the scan of another patient before any work is done. Fails with status 3.
pub(super) fn check(path: &Path, args: &CaseArgs, global: &Global, progress: &Progress) -> Result<()> {
    if args.force {
        return Ok(());
    }
    let (pair, own) = own(path, args, global)?;
    pair.check(&own, progress)
}

/// Reads the second position and looks for the findings of the first there. Fails with status 3 if it cannot be
/// read or is not the scan that the findings name; 4 if it has no colon or if interrupted.
pub(super) fn read(
    path: &Path,
    args: &CaseArgs,
    global: &Global,
    First { findings, lumen, along, transfer }: &First<'_>,
    timings: &mut Timings,
    progress: &Progress,
) -> Result<Second> {
    let own = own(path, args, global)?.1;
    let input = prepare::load(path, &own, Use::Change, timings, progress)?;
    let scanned = Arc::clone(&input.volume);
    let hash = content_hash(&scanned);
    if findings.second.as_ref().is_some_and(|named| *named != hash) {
        let why = format!("names another second scan than {}", path.display());
        return Err(Error::file(&args.findings, why, "give the scan that the findings were marked in"));
    }
    let found = input.lumen(timings, progress)?;
    if found.segments.is_empty() {
        return Err(prepare::no_lumen(&scanned, &found, "leave --second out"));
    }
    let there = timings.time("along_s", || found.along(&scanned, progress))?;
    let quality = judged(&scanned, &found, &there, &[], progress)?;
    let matched = timings.time("match_s", || Matching::new((lumen, along), (&found, &there), progress))?;
    if matched.is_none() {
        say("the positions cannot be compared: no one line leads from the rectum to the cecum of each");
    }
    let mut cleansed = input;
    let (_, taken) = cleansed.cleanse(None, false, timings, progress)?;
    let preset = Preset::default();
    let prepared = |volume: Arc<Volume>| preset.preparation.prepare(volume, *transfer);
    let scanned = taken.as_ref().map(|_| prepared(scanned));
    let shown = prepared(cleansed.volume);
    progress.stage("rendering the second position", findings.findings.len() as u64);
    let places = findings.findings.iter().map(|f| -> Result<Option<There>> {
        progress.advance(1)?;
        let (mut finding, expected) = match f.other {
            Some(place) => (Finding { place, ..Finding::default() }, None),
            None => {
                let place = |matched: &Matching| matched.place(Side::A, f.place, along.of(f.place)?.mm);
                let Some(found_there) = matched.as_ref().and_then(place) else { return Ok(None) };
                (expected_at(&shown, found_there.on_wall(&found)), Some(found_there))
            }
        };
        finding.id.clone_from(&f.id);
        if !shown.voxels().grid().contains(finding.place) {
            let why = format!("finding {} lies outside the second scan", f.id);
            return Err(Error::input("findings", why, "give the scan that the findings were marked in"));
        }
        if expected.is_none() {
            complete(&mut finding, &shown, taken.as_ref(), &there, progress)?;
        } else if let Some(at) = there.of(finding.place) {
            (finding.along_mm, finding.segment) = (Some(at.mm), at.part.map(str::to_owned));
        }
        let pictures = finding.pictures(&shown, scanned.as_ref(), preset, SIDE)?;
        Ok(Some(There { finding, expected, pictures }))
    });
    let places = timings.time("pictures_s", || places.collect::<Result<Vec<_>>>())?;
    Ok(Second { hash, findings: places, quality })
}

/// Returns what is looked at where a finding is expected.
fn expected_at(shown: &PreparedVolume, place: glam::DVec3) -> Finding {
    let on_wall = wall_near(shown, place);
    let (place, normal) = on_wall.map_or((place, None), |(place, normal)| (place, Some(normal)));
    Finding { place, normal, ..Finding::default() }
}

impl Second {
    /// Returns the quality of the segments of the first position, each adequate if either position is: what one does not show, the other
    /// may.
    pub(super) fn either(&self, first: &[Quality]) -> Vec<Quality> {
        let is_adequate = |name: &str| self.quality.iter().any(|(q, _)| q.segment == name && q.adequate);
        let either = |q: &Quality| Quality { adequate: q.adequate || is_adequate(&q.segment), ..q.clone() };
        first.iter().map(either).collect()
    }

    /// Returns the findings that were marked there, for other programs.
    pub(super) fn marked(&self) -> Findings {
        let marked = self.findings.iter().flatten().filter(|t| t.expected.is_none()).map(|t| t.finding.clone());
        Findings { scan: self.hash.clone(), findings: marked.collect(), ..Findings::default() }
    }
}

impl There {
    /// Returns what it is there, in words.
    pub(super) fn text(&self) -> String {
        let place = match (&self.finding.segment, self.finding.along_mm) {
            (Some(segment), Some(mm)) => format!("{segment}, {:.0} mm from the rectum", (mm / 10.0).round() * 10.0),
            _ => "nowhere along the colon".to_owned(),
        };
        match &self.expected {
            None => match self.finding.diameter_mm {
                Some(mm) => format!("marked, {mm:.1} mm; {place}"),
                None => format!("marked; {place}"),
            },
            Some(found) if found.is_gap => {
                format!("not marked; expected about {place}, where one of them is collapsed")
            }
            Some(found) => format!("not marked; expected {place} (± {:.0} mm)", found.uncertainty_mm.ceil()),
        }
    }
}
