//! `report candidates`: the sensitivity of detectors against their false positives, and the accuracy of lesion measurements.

mod froc;
mod pages;
mod put_in;

use std::path::Path;
use std::sync::Arc;

use glam::{DMat3, DVec3};
use serde::Deserialize;

use super::{Effort, timed};
use crate::app::found::Found;
use crate::app::{Timings, colon};
use crate::error::{Error, Result};
use crate::fields::lumen;
use crate::phantom::{Phantom, PhantomSettings, Scanner, Size, TrueDecoy, TruePolyp};
use crate::polyps::{self, Candidate, Colon, Detector, Wall};
use crate::progress::Progress;
use crate::space::TransferFunction;
use crate::volume::{Grid, Volume};
use froc::Trial;

/// The first seed of the phantoms that are measured. All constants of the detectors were chosen on seeds 1 to 30.
const HELD_APART: u64 = 1001;

/// Scanner settings of the phantoms: the defaults, or with one factor changed.
#[derive(Clone, Copy, Debug)]
struct Scan {
    scanner: Scanner,
    /// Slice spacing, mm; `None` for that of the phantom's grid.
    slice_mm: Option<f64>,
    tagged: bool,
}

impl Default for Scan {
    fn default() -> Self {
        Self { scanner: Scanner::default(), slice_mm: None, tagged: true }
    }
}

/// A factor of the scan that is varied while the others keep their defaults.
struct Factor {
    name: &'static str,
    unit: &'static str,
    values: &'static [f64],
    set: fn(&mut Scan, f64),
}

const FACTORS: [Factor; 3] = [
    Factor { name: "noise", unit: "HU", values: &[12.0, 22.0, 50.0], set: |s, v| s.scanner.noise_hu = v },
    Factor { name: "slices", unit: "mm", values: &[0.6, 1.0, 2.0, 3.0], set: |s, v| s.slice_mm = Some(v) },
    Factor {
        name: "tag",
        unit: "HU",
        values: &[0.0, 250.0, 450.0, 1000.0],
        set: |s, v| (s.tagged, s.scanner.tag_hu) = (v > 0.0, Some(v).filter(|v| *v > 0.0)),
    },
];

/// Results of a detector on some scans.
struct Measured {
    detector: &'static str,
    /// How much of a scan each of them is, 0 to 1.
    share: f64,
    /// Mean time beyond lumen and cleansing, s, and the largest memory, MB.
    seconds: f64,
    megabytes: Option<f64>,
    trials: Vec<Trial>,
}

impl Measured {
    /// Returns the lowest score at which there are at most `per_scan` false positives per whole scan.
    fn threshold(&self, per_scan: f64) -> f64 {
        froc::threshold(&self.trials, per_scan * self.share)
    }
}

/// The scans of one value of a factor.
struct Step {
    name: &'static str,
    value: f64,
    unit: &'static str,
    measured: Vec<Measured>,
}

/// The user's scan.
pub struct Own {
    /// Its name in the tables.
    pub title: String,
    /// The scan.
    pub volume: Volume,
    /// Its true polyps, and its decoys: structures that look like polyps. Without them, lesions are put into it.
    pub truth: Option<(Vec<TruePolyp>, Vec<TrueDecoy>)>,
}

/// A part of the page on the user's scan.
struct Part {
    /// Short name, for files.
    name: &'static str,
    title: String,
    text: String,
    measured: Vec<Measured>,
}

/// The parts of a truth file that are needed.
#[derive(Deserialize)]
struct TruthFile {
    polyps: Vec<TruePolyp>,
    #[serde(default)]
    decoys: Vec<TrueDecoy>,
}

/// Reads the polyps and decoys of a truth file: what `colvis phantom --truth` writes, or `{"polyps": [{"position", "diameter_mm"}]}`.
///
/// # Errors
/// Returns status 3 if it cannot be read, is not a truth file, or has a polyp without a position or diameter.
pub fn read_truth(path: &Path) -> Result<(Vec<TruePolyp>, Vec<TrueDecoy>)> {
    let hint =
        "give what `colvis phantom --truth` writes, or {\"polyps\": [{\"position\": [x, y, z], \"diameter_mm\": d}]}";
    let text = std::fs::read_to_string(path)
        .map_err(|e| Error::file(path, format!("cannot be read: {e}"), "give a readable file").caused_by(e))?;
    let truth: TruthFile =
        serde_json::from_str(&text).map_err(|e| Error::file(path, format!("is not a list of polyps: {e}"), hint))?;
    let sound = |p: DVec3, d: f64| p.is_finite() && d.is_finite() && d > 0.0;
    if let Some(n) = truth.polyps.iter().position(|p| !sound(p.position, p.diameter_mm)) {
        return Err(Error::file(path, format!("its polyp {} has no position or no diameter", n + 1), hint));
    }
    if let Some(n) = truth.decoys.iter().position(|d| !sound(d.position, d.diameter_mm)) {
        return Err(Error::file(path, format!("its decoy {} has no position or no diameter", n + 1), hint));
    }
    Ok((truth.polyps, truth.decoys))
}

/// Measures detectors on phantoms, and on a scan with its truth or with lesions that are put into it, and writes the report into `folder`. Returns the findings, one
/// sentence each.
///
/// # Errors
/// Returns status 4 if interrupted, 5 if a file cannot be written, or a detector's error.
pub fn report(
    effort: Effort,
    seed: u64,
    detectors: &[Detector],
    transfer: TransferFunction,
    own: Option<Own>,
    folder: &Path,
    progress: &Progress,
) -> Result<Vec<String>> {
    let size = effort.choose(Size::Small, Size::Standard);
    let first = HELD_APART - 1 + seed;
    let usual = measured(size, first..first + effort.choose(2, 24), &Scan::default(), detectors, transfer, progress)?;
    let mut steps = Vec::new();
    for factor in &FACTORS {
        for &value in effort.choose(&factor.values[..0], factor.values) {
            let mut scan = Scan::default();
            (factor.set)(&mut scan, value);
            let measured = measured(size, first..first + 4, &scan, detectors, transfer, progress)?;
            steps.push(Step { name: factor.name, value, unit: factor.unit, measured });
        }
    }
    let own = match own {
        Some(Own { title, volume, truth: Some((polyps, decoys)) }) => {
            let found = trials_of(volume, &polyps, &decoys, detectors, transfer, progress)?;
            let measured = collected(detectors, vec![found]);
            vec![Part { name: "own", title, text: String::new(), measured }]
        }
        Some(Own { title, volume, truth: None }) => {
            put_in::measured(&title, volume, effort, first, detectors, transfer, progress)?
        }
        None => Vec::new(),
    };
    pages::write(&usual, &steps, &own, first, folder)
}

/// Cost and result of one detector on one scan.
struct Run {
    seconds: f64,
    megabytes: Option<f64>,
    trial: Trial,
}

fn collected(detectors: &[Detector], runs: Vec<Vec<Run>>) -> Vec<Measured> {
    let mut out: Vec<Measured> = detectors
        .iter()
        .map(|d| Measured { detector: d.name, share: 1.0, seconds: 0.0, megabytes: None, trials: Vec::new() })
        .collect();
    let count = runs.len() as f64;
    for run in runs {
        for (m, r) in out.iter_mut().zip(run) {
            m.seconds += r.seconds / count;
            m.megabytes = [m.megabytes, r.megabytes].into_iter().flatten().reduce(f64::max);
            m.trials.push(r.trial);
        }
    }
    out
}

fn measured(
    size: Size,
    seeds: std::ops::Range<u64>,
    scan: &Scan,
    detectors: &[Detector],
    transfer: TransferFunction,
    progress: &Progress,
) -> Result<Vec<Measured>> {
    let mut runs = Vec::new();
    for seed in seeds {
        let (lesions, decoys, t) = (true, true, scan.tagged);
        let (pools, films, stool, inhomogeneous, pseudo) = (t, t, t, t && scan.scanner.tag_hu.is_none(), t);
        let polyps = false;
        let settings = PhantomSettings {
            size,
            seed,
            polyps,
            lesions,
            decoys,
            pools,
            films,
            stool,
            inhomogeneous,
            pseudo,
            ..PhantomSettings::default()
        };
        let phantom = Phantom::scanned(&settings, scan.scanner);
        let grid = match scan.slice_mm {
            None => phantom.grid(),
            Some(mm) => with_slices(&phantom.grid(), mm)?,
        };
        let volume = phantom.voxelise(&grid, progress)?;
        let truth = phantom.truth();
        drop(phantom);
        runs.push(trials_of(volume, &truth.polyps, &truth.decoys, detectors, transfer, progress)?);
        progress.check()?;
    }
    Ok(collected(detectors, runs))
}

/// Runs the detectors on a scan with its truth.
fn trials_of(
    volume: Volume,
    polyps: &[TruePolyp],
    decoys: &[TrueDecoy],
    detectors: &[Detector],
    transfer: TransferFunction,
    progress: &Progress,
) -> Result<Vec<Run>> {
    let runs = found_by(detectors, volume, transfer, progress)?.into_iter();
    let run = |(candidates, seconds, megabytes)| {
        let trial = Trial::new(polyps.to_vec(), decoys.to_vec(), candidates);
        Run { seconds, megabytes, trial }
    };
    Ok(runs.map(run).collect())
}

/// A detector's candidates, with its time, s, and its memory, MB, if that is known.
pub type FoundBy = (Vec<Candidate>, f64, Option<f64>);

/// Returns the candidates of each detector in a scan, as `colvis candidates` finds them, with the time, s, and the memory, MB, in
/// addition to those for the colon.
///
/// # Errors
/// Returns status 4 if interrupted, or a detector's error.
pub fn found_by(
    detectors: &[Detector],
    mut volume: Volume,
    transfer: TransferFunction,
    progress: &Progress,
) -> Result<Vec<FoundBy>> {
    let found = lumen::find(&volume, progress)?;
    let again = |volume: &Volume| lumen::find(volume, progress);
    let (found, known, mut untimed) = (Arc::new(found), Found::default(), Timings::default());
    let (lumen, _) = colon::without_tag(&mut volume, (found, &known), false, again, |_| (), &mut untimed, progress)?;
    let (volume, lumen) = colon::around(volume, lumen, colon::WALL_MM);
    let run = |detector: &Detector| {
        let work = || {
            let wall = Wall::new(&volume, &lumen, transfer.iso(), progress)?;
            polyps::find(detector, &Colon { volume: &volume, lumen: &lumen, wall: &wall }, progress)
        };
        let (candidates, seconds, megabytes) = timed(work);
        Ok((candidates?, seconds, megabytes))
    };
    detectors.iter().map(run).collect()
}

/// Returns a grid of the same extent with other slices.
fn with_slices(grid: &Grid, mm: f64) -> Result<Grid> {
    let [nx, ny, nz] = grid.dims();
    let spacing = grid.spacing();
    let dims = [nx, ny, ((nz as f64 * spacing.z / mm).round() as usize).max(2)];
    let spacing = spacing.with_z(mm);
    let last = DVec3::from_array(dims.map(|n| n as f64 - 1.0));
    Grid::new(dims, spacing, -0.5 * last * spacing, DMat3::IDENTITY)
        .map_err(|e| Error::fault("report candidates", e.why, "report it"))
}
