//! `colvis case`: what a reading of a scan leaves behind, for colleagues and for other programs.

#[cfg(feature = "dicom")]
mod dicom;
mod map;
mod markups;
mod outputs;
mod page;
mod second;
mod segments;

pub(super) use markups::curve;
use outputs::Outputs;
use second::Second;
use segments::Segments;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use serde_json::json;

use crate::app::Timings;
use crate::app::findings::{
    Draft, Finding, FindingPicture, Findings, NoScan, Quality, Scheme, SegmentFacts, lesion_at, quality,
};
use crate::cli::args::{CaseArgs, Global};
use crate::cli::messages::say;
use crate::cli::prepare;
use crate::cli::shared::Use;
#[cfg(feature = "dicom")]
use crate::dicom::objects::Study;
use crate::error::{Error, Result};
use crate::fields::cleanse::Cleansed;
use crate::fields::lumen::residue;
use crate::fields::{Along, Lumen};
use crate::output;
use crate::polyps::RESTORED_HU;
use crate::progress::Progress;
use crate::render::Preset;
use crate::space::{PreparedVolume, TransferFunction};
#[cfg(feature = "dicom")]
use crate::volume::io;
use crate::volume::{Volume, content_hash, content_origin};

/// Side of a finding's pictures, pixels.
const SIDE: usize = 360;
/// What to do about an invalid file of findings.
const HINT: &str = "give the file that a window keeps of a reading, below findings/ in its folder";

/// The files that it writes or removes; `capture-NN.dcm` come to them.
pub(super) const FILES: [&str; 8] = [
    "report.html",
    "findings.json",
    "findings.mrk.json",
    "second.mrk.json",
    "centerline.mrk.json",
    "lumen.seg.nrrd",
    "report.dcm",
    "segments.dcm",
];

/// Everything that the report tells.
struct Case {
    /// Whose scan it is.
    #[cfg(feature = "dicom")]
    study: Study,
    findings: Findings,
    /// Pictures of each finding.
    pictures: Vec<Vec<FindingPicture>>,
    /// The quality of each segment, with what else is known of it.
    quality: Vec<(Quality, SegmentFacts)>,
    scheme: Scheme,
    along: Arc<Along>,
    /// The colon from outside.
    map: Option<map::Map>,
    /// The patient's other position.
    second: Option<Second>,
}

impl Case {
    /// Returns the category that follows from the findings, and from the quality of both positions.
    fn draft(&self) -> Draft {
        let quality = self.second.as_ref().map(|s| s.either(&self.findings.quality));
        self.scheme.draft(&self.findings.findings, quality.as_ref().unwrap_or(&self.findings.quality))
    }
}

/// Runs the command. Fails with status 2 for an unknown scheme, 3 if the input or the findings cannot be read or do not belong together,
/// 4 if there is no colon or if interrupted, 5 if an output cannot be written.
pub(crate) fn run(args: &CaseArgs, global: &Global, progress: &Progress) -> Result<()> {
    if (args.dicom || args.identity) && !cfg!(feature = "dicom") {
        let why = "needs the feature \"dicom\", which this build does not have";
        return Err(Error::usage(if args.dicom { "--dicom" } else { "--identity" }, why, "build it with that feature"));
    }
    let scheme = Scheme::named(&args.scheme)?;
    let findings = Findings::read(&args.findings, NoScan::Refused, HINT)?;
    let transfer = prepare::transfer(global)?;
    check_names(args)?;
    if let Some(second) = &args.second {
        second::check(second, args, global, progress)?;
    }
    let had_folder = args.out.exists();
    output::make_folder(&args.out)?;
    let reported = report(args, global, &scheme, findings, transfer, progress);
    if reported.is_err() && !had_folder {
        // Only if nothing is in it.
        let _ = std::fs::remove_dir(&args.out);
    }
    reported
}

/// Refuses an input or a file of stats that has the name and the place of one of the report's. Fails with status 2.
fn check_names(args: &CaseArgs) -> Result<()> {
    let folder = std::fs::canonicalize(&args.out).ok();
    for path in std::iter::once(&args.input).chain(&args.second).chain(&args.stats) {
        let own = path.parent().map(|p| if p.as_os_str().is_empty() { Path::new(".") } else { p });
        let is_there = folder.is_some() && own.and_then(|p| std::fs::canonicalize(p).ok()) == folder;
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if is_there && outputs::is_of_report(&name) {
            let why = "has the name of a file of the report, in its folder";
            return Err(Error::usage(path.display().to_string(), why, "give another --out"));
        }
    }
    Ok(())
}

/// Makes the report. Its folder exists.
fn report(
    args: &CaseArgs,
    global: &Global,
    scheme: &Scheme,
    findings: Findings,
    transfer: TransferFunction,
    progress: &Progress,
) -> Result<()> {
    let stats: Vec<&Path> = args.stats.iter().map(std::path::PathBuf::as_path).collect();
    output::check_folders(&stats)?;
    let mut timings = Timings::default();
    // The command cleanses the scan itself; `--cleanse` must not do it first.
    let global = Global { cleanse: false, ..global.clone() };
    let input = prepare::load(&args.input, &global, Use::Look, &mut timings, progress)?;
    let scanned = Arc::clone(&input.volume);
    let hash = timings.time("hash_s", || Ok(content_hash(&scanned)))?;
    if findings.scan != hash {
        let why = format!("belongs to another scan than {}", args.input.display());
        return Err(Error::file(&args.findings, why, "give the findings of this scan"));
    }
    #[cfg(feature = "dicom")]
    let study = {
        let load = prepare::load_options(&global);
        let identity = args.identity.then(|| io::identity(&args.input, &load, progress)).transpose()?.flatten();
        if args.identity && identity.is_none() {
            say("the input does not tell whose scan it is: the report has no identity");
        }
        if args.dicom {
            dicom::check(&scanned, &args.input)?;
        }
        dicom::study(identity.as_ref(), &hash, &args.findings)
    };
    let mut findings = findings.moved_to(content_origin(scanned.grid()));
    check_places(&findings, &scanned)?;
    let found = input.lumen(&mut timings, progress)?;
    if found.segments.is_empty() {
        return Err(prepare::no_lumen(&scanned, &found, "report it by hand: there is nothing to show"));
    }
    let along = timings.time("along_s", || found.along(&scanned, progress))?;
    let segments = timings.time("segments_s", || segments::of(&found, &along))?;
    let quality = timings.time("quality_s", || judged(&scanned, &found, &along, &findings.quality, progress))?;
    let map = timings.time("map_s", || map::of(&found, &along, &findings, progress))?;
    // Pictures show the wall under tag, and the tag beside it.
    let mut cleansed = input;
    let (_, taken) = cleansed.cleanse(None, false, &mut timings, progress)?;
    let preset = Preset::default();
    let prepared = |volume: Arc<Volume>| preset.preparation.prepare(volume, transfer);
    let scanned = taken.as_ref().map(|_| prepared(scanned));
    let shown = prepared(cleansed.volume);
    timings.time("findings_s", || {
        findings.findings.iter_mut().try_for_each(|f| complete(f, &shown, taken.as_ref(), &along, progress))
    })?;
    progress.stage("rendering findings", findings.findings.len() as u64);
    let pictures = findings.findings.iter().map(|f| {
        progress.advance(1)?;
        f.pictures(&shown, scanned.as_ref(), preset, SIDE)
    });
    let pictures = timings.time("pictures_s", || pictures.collect::<Result<Vec<_>>>())?;
    findings.quality = quality.iter().map(|(q, _)| q.clone()).collect();
    drop((shown, scanned));
    let first = second::First { findings: &findings, lumen: &found, along: &along, transfer };
    let read = |path: &std::path::PathBuf| second::read(path, args, &global, &first, &mut timings, progress);
    let second = args.second.as_ref().map(read).transpose()?;
    findings.second = second.as_ref().map(|s| s.hash.clone()).or(findings.second);
    let case = Case {
        findings,
        pictures,
        quality,
        scheme: scheme.clone(),
        along,
        map,
        second,
        #[cfg(feature = "dicom")]
        study,
    };
    let mut outputs = Outputs::new(&args.out);
    timings.time("write_s", || write(&case, &segments, args, &mut outputs, progress))?;
    progress.check()?;
    outputs.finish()?;
    let Some(path) = &args.stats else { return Ok(()) };
    let mut stats = prepare::stats_head(&timings);
    let draft = case.draft();
    let inadequate: Vec<&String> = case.quality.iter().map(|(_, f)| &f.why).filter(|w| !w.is_empty()).collect();
    for (name, value) in [
        ("quality", json!(case.findings.quality)),
        ("inadequate", json!(inadequate)),
        ("category", json!(draft.category)),
        ("because", json!(draft.because)),
    ] {
        stats.insert(name.to_owned(), value);
    }
    output::write_json(path, &stats)
}

/// Writes everything but the stats, the page last.
fn write(
    case: &Case,
    segments: &Segments,
    args: &CaseArgs,
    outputs: &mut Outputs<'_>,
    progress: &Progress,
) -> Result<()> {
    outputs.add_json("findings.json", &case.findings.json())?;
    outputs.add_json("findings.mrk.json", &markups::findings(&case.findings))?;
    if let Some(second) = &case.second {
        outputs.add_json("second.mrk.json", &markups::findings(&second.marked()))?;
    }
    if let Some(line) = case.along.line() {
        outputs.add_json("centerline.mrk.json", &curve(line))?;
    } else {
        say("centerline.mrk.json is left out: no line leads from the rectum to the cecum");
    }
    let name = "lumen.seg.nrrd";
    outputs.add_file(name, segments.write(&outputs.path(name), progress)?);
    #[cfg(feature = "dicom")]
    if args.dicom {
        progress.stage("writing DICOM", 0);
        dicom::write(case, segments, outputs)?;
    }
    let _ = args;
    let page = page::html(case)?;
    outputs.add("report.html", |w| w.write_all(page.as_bytes()))
}

/// Refuses findings that lie outside the scan. Fails with status 3.
fn check_places(findings: &Findings, scan: &Volume) -> Result<()> {
    let own = findings.findings.iter().map(|f| (format!("finding {}", f.id), f.place));
    let outside = findings.outside.iter().zip(1..).map(|(o, n)| (format!("finding {n} outside the colon"), o.place));
    let lost = own.chain(outside).find(|(_, place)| !scan.grid().contains(*place));
    lost.map_or(Ok(()), |(name, _)| {
        let why = format!("{name} lies outside the scan");
        Err(Error::input("findings", why, "give the findings of this scan"))
    })
}

/// Returns the quality of each segment, with coverage and times of the reading.
fn judged(
    volume: &Volume,
    lumen: &Lumen,
    along: &Along,
    read: &[Quality],
    progress: &Progress,
) -> Result<Vec<(Quality, SegmentFacts)>> {
    let found = residue(volume, lumen, progress)?;
    let mut list = quality(along, lumen, Some(&found), |_| false)?;
    let read: BTreeMap<&str, &Quality> = read.iter().map(|q| (q.segment.as_str(), q)).collect();
    for (quality, _) in &mut list {
        if let Some(own) = read.get(quality.segment.as_str()) {
            (quality.coverage, quality.seconds) = (own.coverage, own.seconds);
        }
    }
    Ok(list)
}

/// Adds what the file does not tell of a finding: its measures, and where it is along the colon.
fn complete(
    finding: &mut Finding,
    shown: &PreparedVolume,
    taken: Option<&Cleansed>,
    along: &Along,
    progress: &Progress,
) -> Result<()> {
    let volume = shown.voxels();
    if finding.ends.is_none() && finding.diameter_mm.is_none() {
        let is_restored = |at| {
            let grid = volume.grid();
            let [i, j, k] = grid.voxel(at).round().to_array().map(|x| x.max(0.0) as usize);
            let is_inside = [i, j, k].iter().zip(grid.dims()).all(|(n, d)| *n < d);
            let before = || taken?.changes.get(grid.index(i, j, k));
            is_inside
                && before().is_some_and(|hu| {
                    (i32::from(hu) - i32::from(volume.get(i as i64, j as i64, k as i64))).abs() > RESTORED_HU
                })
        };
        match lesion_at(volume, shown.transfer().iso(), finding.place, is_restored, progress) {
            Ok(measured) => {
                let (form, tissue, confidence) = (finding.morphology, finding.tissue, finding.confidence);
                finding.measure(&measured);
                // What the reader said stays.
                finding.morphology = form.or(finding.morphology);
                finding.tissue = tissue.or(finding.tissue);
                finding.confidence = confidence.or(finding.confidence);
            }
            Err(e) => {
                progress.check()?;
                say(&format!("finding {} has no measures: {}", finding.id, e.why));
            }
        }
    }
    if finding.along_mm.is_none()
        && let Some(at) = along.of(finding.place)
    {
        finding.along_mm = Some(at.mm);
        finding.segment = finding.segment.take().or(at.part.map(str::to_owned));
    }
    finding.view = Some(finding.view_in(shown)?);
    Ok(())
}
