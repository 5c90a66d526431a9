//! `colvis candidates`.

pub(super) mod gallery;
mod page;

pub(super) use page::escape;

use std::path::{Path, PathBuf};

use serde_json::json;

use crate::app::Timings;
use crate::app::boxed::boxed;
use crate::app::colon::WALL_MM;
use crate::app::study::Study;
use crate::cli::Program;
use crate::cli::args::{CandidatesArgs, Global};
use crate::cli::prepare;
use crate::cli::shared::Use;
use crate::error::Result;
use crate::output;
use crate::polyps::{CoatedSpot, Coats, detectors};
use crate::progress::Progress;

/// How far beyond the lumen the scan is kept for pictures, mm.
const PICTURE_MM: f64 = 50.0;

/// Runs the command. Fails with status 2 for an unknown detector, 3 if the input cannot be read, 4 if it has no gas of a colon or
/// if interrupted, 5 if an output cannot be written.
pub(crate) fn run(program: &Program, args: &CandidatesArgs, global: &Global, progress: &Progress) -> Result<()> {
    let detector = program.catalog.find_detector(args.detector.as_deref().unwrap_or(detectors::BUILT_IN[0].name))?;
    let transfer = prepare::transfer(global)?;
    check_outputs(args)?;
    let mut timings = Timings::default();
    // The command cleanses the scan itself; `--cleanse` must not do it first.
    let global = Global { cleanse: false, ..global.clone() };
    let mut input = prepare::load(&args.input, &global, Use::Change, &mut timings, progress)?;
    let (lumen, cleansed) = input.cleanse(args.from.map(|p| p.0), true, &mut timings, progress)?;
    let volume = input.into_volume();
    let scanned = cleansed.as_ref().map(|c| boxed(&volume, &lumen, &c.changes));
    let cleansed = cleansed.map(|c| c.without_values());
    let beyond = if args.gallery.is_some() { PICTURE_MM } else { WALL_MM };
    let study = Study::new(volume, lumen, transfer.iso(), beyond, &mut timings, progress)?;
    let coats = timings.time("coats_s", || study.coats(scanned.as_ref(), cleansed.as_ref(), progress))?;
    drop(scanned);
    let mut found = timings.time("candidates_s", || study.find(&detector, progress))?;
    found.truncate(args.max.unwrap_or(usize::MAX));
    let entries = study.entries(&found, Some(&coats));
    output::write_json(&args.out, &json!({ "candidates": entries }))?;
    let wall_bytes = study.wall.bytes();
    if let Some(folder) = &args.gallery {
        let name = args.input.file_name().map_or_else(|| "scan".to_owned(), |n| n.to_string_lossy().into_owned());
        let Study { volume, lumen, wall, .. } = study;
        let scene = gallery::Scene { volume, transfer, wall: &wall, scan: name, is_ordered: lumen.ordered };
        timings.time("gallery_s", || gallery::write(folder, scene, &found, &entries, progress))?;
    }
    if let Some(path) = &args.stats {
        let mut stats = prepare::stats_head(&timings);
        for (name, value) in
            [("candidates", json!(entries.len())), ("coats", json!(spots(&coats))), ("wall_bytes", json!(wall_bytes))]
        {
            stats.insert(name.to_owned(), value);
        }
        output::write_json(path, &stats)?;
    }
    Ok(())
}

/// Returns the coated spots, largest first.
fn spots(coats: &Coats) -> Vec<serde_json::Value> {
    let spot = |s: &CoatedSpot| json!({"place": s.place, "normal": s.normal, "area_mm2": s.area_mm2, "thickness_mm": s.thickness_mm});
    coats.spots.iter().map(spot).collect()
}

/// Rejects outputs whose folder is missing, and makes the gallery's folder. Fails with status 5 if a folder is missing or cannot be
/// made.
fn check_outputs(args: &CandidatesArgs) -> Result<()> {
    let files: Vec<&Path> = std::iter::once(&args.out).chain(&args.stats).map(PathBuf::as_path).collect();
    if let Some(folder) = &args.gallery {
        output::make_folder(folder)?;
    }
    output::check_folders(&files)
}

#[cfg(test)]
#[cfg(feature = "report")]
mod tests {
    use glam::DVec3;
    use serde_json::Value;

    use super::*;
    use crate::cli::args::Command;
    use crate::phantom::{PhantomSettings, Size};
    use crate::report::candidates::found_by;
    use crate::shared::shared;
    use crate::volume::Volume;
    use crate::volume::io::{self, LoadOptions};

    /// Writes a scan to a file, and the list of its candidates with `colvis candidates --out`. Returns the options, the scan as the file
    /// has it, and the list.
    fn written(scan: &Volume, options: &[&str], progress: &Progress) -> (Global, Volume, Vec<Value>) {
        let dir = tempfile::tempdir().unwrap();
        let [path, list] = ["scan.nii", "list.json"].map(|n| dir.path().join(n).to_string_lossy().into_owned());
        io::save(Path::new(&path), scan, progress).unwrap();
        let program = Program::default();
        let args = program.parse(["colvis", "candidates", &path, "--out", &list].iter().chain(options)).unwrap();
        let Some(Command::Candidates(candidates)) = args.command else { panic!("{:?}", args.command) };
        run(&program, &candidates, &args.global, progress).unwrap();
        let mut listed: Value = serde_json::from_str(&std::fs::read_to_string(&list).unwrap()).unwrap();
        let Value::Array(listed) = listed["candidates"].take() else { panic!("a list") };
        let scan = io::load(Path::new(&path), &LoadOptions::default(), progress).unwrap().volume;
        (args.global, scan, listed)
    }

    /// The report measures the same pipeline that the command runs.
    #[test]
    #[ignore = "slow: candidates of a phantom, twice"]
    fn the_command_and_its_report_find_the_same_candidates() {
        let progress = Progress::new();
        let settings = PhantomSettings {
            size: Size::Small,
            lesions: true,
            polyps: false,
            pools: true,
            films: true,
            touching: true,
            ..PhantomSettings::default()
        };
        let (_, scan) = shared(&settings);
        let (global, scan, listed) = written(&scan, &["--wall=-800,-550"], &progress);
        let listed: Vec<(DVec3, f64)> = listed
            .iter()
            .map(|c| {
                let position = serde_json::from_value(c["position"].clone()).unwrap();
                (position, c["score"].as_f64().unwrap())
            })
            .collect();
        let transfer = prepare::transfer(&global).unwrap();
        let mut found = found_by(&detectors::BUILT_IN[..1], scan, transfer, &progress).unwrap();
        let found: Vec<(DVec3, f64)> = found.remove(0).0.iter().map(|c| (c.position, c.score)).collect();
        assert!(found.len() > 5 && listed.len() == found.len(), "{} and {}", listed.len(), found.len());
        for (listed, found) in listed.iter().zip(&found) {
            // A number in a list may differ by its last digit.
            let is_same = listed.0.distance(found.0) < 1e-9 && (listed.1 - found.1).abs() < 1e-12;
            assert!(is_same, "{listed:?} and {found:?}");
        }
    }
}
