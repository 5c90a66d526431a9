//! `report cleansing`: how well cleansing methods restore the wall under tag, compared with the same colon without tagging.

mod measure;
mod methods;

use std::path::Path;
use std::sync::Arc;

use glam::{DMat3, DVec3};

use crate::error::{Error, Result};
use crate::phantom::{Beside, NOISE_HU, Phantom, PhantomSettings, Scanner, Size};
use crate::progress::Progress;
use crate::volume::Grid;

use super::page::Page;
use super::plot::{Plot, Point, Series};
use super::table::{Table, finite, table};
use super::{Effort, mean};
use measure::{Outcome, Part, Subject};
use methods::METHODS;

/// Places on the wall of each phantom.
const PLACES: usize = 60_000;
/// Parts of the wall whose errors are plotted.
const PLOTTED: [Part; 2] = [Part::Beside(Beside::Fluid), Part::Beside(Beside::Rim)];

/// A factor of the scan that is varied while the others keep their defaults.
struct Factor {
    name: &'static str,
    unit: &'static str,
    values: &'static [f64],
    set: fn(&mut Scan, f64),
}

/// How a phantom is scanned.
#[derive(Clone, Copy, Debug)]
struct Scan {
    scanner: Scanner,
    noise: bool,
    /// Voxel spacing, mm; `None` for that of the phantom's size.
    spacing: Option<DVec3>,
}

impl Default for Scan {
    fn default() -> Self {
        Self { scanner: Scanner::default(), noise: true, spacing: None }
    }
}

const FACTORS: [Factor; 4] = [
    Factor { name: "tag", unit: "HU", values: &[250.0, 450.0, 700.0, 1000.0], set: |s, v| s.scanner.tag_hu = Some(v) },
    Factor {
        name: "noise",
        unit: "HU",
        values: &[0.0, 12.0, 22.0, 50.0],
        set: |s, v| (s.noise, s.scanner.noise_hu) = (v > 0.0, v),
    },
    Factor { name: "blur", unit: "mm", values: &[0.4, 0.58, 0.75, 0.9], set: |s, v| s.scanner.blur_mm = Some(v) },
    Factor {
        name: "slices",
        unit: "mm",
        values: &[0.6, 0.9, 1.5, 2.5],
        set: |s, v| s.spacing = Some(DVec3::new(0.8, 0.8, v)),
    },
];

/// Measurements on one phantom.
struct Measured {
    /// The factor that is varied, and its value; `None` for the phantoms of the first part.
    factor: Option<(&'static str, f64)>,
    title: String,
    polyps: usize,
    outcomes: Vec<Outcome>,
}

/// Measures on phantoms and writes the report into `folder`. Returns the findings, one sentence each.
///
/// # Errors
/// Returns status 4 if interrupted, 5 if a file cannot be written.
pub fn report(effort: Effort, seed: u64, folder: &Path, progress: &Progress) -> Result<Vec<String>> {
    let (size, name) = effort.choose((Size::Small, "small"), (Size::Standard, "standard"));
    let mut all = Vec::new();
    for seed in seed..seed + effort.choose(1, 5) {
        let title = format!("{name}, seed {seed}");
        all.push(measured(settings(size, seed), Scan::default(), None, title, progress)?);
    }
    for factor in &FACTORS {
        for &value in effort.choose(&factor.values[..0], factor.values) {
            let mut scan = Scan::default();
            (factor.set)(&mut scan, value);
            let title = format!("{} {value} {}", factor.name, factor.unit);
            all.push(measured(settings(Size::Small, seed), scan, Some((factor.name, value)), title, progress)?);
        }
    }
    write(&all, folder)
}

/// Returns the settings of a phantom with all kinds of tag.
fn settings(size: Size, seed: u64) -> PhantomSettings {
    let (pools, films, stool, inhomogeneous, pseudo) = (true, true, true, true, true);
    PhantomSettings { size, seed, pools, films, stool, inhomogeneous, pseudo, ..PhantomSettings::default() }
}

fn measured(
    settings: PhantomSettings,
    scan: Scan,
    factor: Option<(&'static str, f64)>,
    title: String,
    progress: &Progress,
) -> Result<Measured> {
    let phantom = Phantom::scanned(&PhantomSettings { noise: scan.noise, ..settings }, scan.scanner);
    let quiet = Phantom::scanned(&PhantomSettings { noise: false, ..settings }, scan.scanner).twin();
    let grid = match scan.spacing {
        None => phantom.grid(),
        Some(spacing) => with_spacing(&phantom.grid(), spacing)?,
    };
    let clean = Arc::new(quiet.voxelise(&grid, progress)?);
    let volume = Arc::new(phantom.voxelise(&grid, progress)?);
    let lumen = methods::lumen_of(&volume, progress)?;
    progress.check()?;
    let subject = Subject::new(&phantom, &clean, volume, lumen, PLACES)?;
    drop(clean);
    let mut outcomes = Vec::new();
    for method in &METHODS {
        outcomes.push(subject.measure(method, progress)?);
        progress.check()?;
    }
    Ok(Measured { factor, title, polyps: subject.polyps(), outcomes })
}

/// Returns a grid of the same extent with other voxels.
fn with_spacing(grid: &Grid, spacing: DVec3) -> Result<Grid> {
    let extent = DVec3::from_array(grid.dims().map(|n| n as f64)) * grid.spacing();
    let dims = (extent / spacing).to_array().map(|n| n.round().max(2.0) as usize);
    let last = DVec3::from_array(dims.map(|n| n as f64 - 1.0));
    Grid::new(dims, spacing, -0.5 * last * spacing, DMat3::IDENTITY)
        .map_err(|e| Error::fault("report cleansing", e.why, "report it"))
}

fn write(all: &[Measured], folder: &Path) -> Result<Vec<String>> {
    let mut page = Page::new(folder, "colvis: cleansing, the restored wall against the same colon without tagging")?;
    page.text(
        "Phantoms with folds, polyps, pools, films, stool, inhomogeneous tag (200 to 1200 HU), pseudo-enhancement and noise, \
         each blurred by a simulated scanner. The truth is the analytic colon without tagging: at places spread over its wall, the \
         position error is the distance to the nearest rising crossing of -650 HU along the normal, and the normal error the angle \
         to the gradient that the default renderer estimates there. A wall more than 1.5 mm away counts as missing. A surface in \
         the lumen that is more than 1.5 mm from any true wall is a ghost. Dry walls show the effect of noise and sampling alone.",
    );
    let findings = findings(all);
    page.findings(&findings);
    page.section("By part of the wall");
    page.table("parts", &parts_table(all))?;
    page.section("Ghosts, polyps, time");
    page.table("methods", &methods_table(all))?;
    for factor in FACTORS.iter().filter(|f| all.iter().any(|m| m.factor.is_some_and(|(name, _)| name == f.name))) {
        page.section(&format!("Effect of {}", factor.name));
        let file = format!("normals-{}", factor.name);
        page.plot(&file, &factor_plot(all, factor), "Small phantoms; all other factors have their defaults.")?;
    }
    page.finish()?;
    Ok(findings)
}

/// Returns all outcomes, with their phantoms.
fn outcomes(all: &[Measured]) -> impl Iterator<Item = (&Measured, &Outcome)> {
    all.iter().flat_map(|m| m.outcomes.iter().map(move |o| (m, o)))
}

fn parts_table(all: &[Measured]) -> Table {
    // If no wall was found, it has no error.
    table!(for (m, o, (part, e)) in outcomes(all).flat_map(|(m, o)| o.parts.iter().map(move |p| (m, o, p)));
        "phantom" => &m.title,
        "method" => o.method,
        "wall" => part.name(),
        "places" => e.places,
        "mean position error / mm" => finite(e.mean_mm, 3),
        "95 % / mm" => finite(e.p95_mm, 3),
        "mean normal error / degrees" => finite(e.mean_degrees, 1),
        "95 % / degrees" => finite(e.p95_degrees, 1),
        "missing / %" => (100.0 * e.missing, 2),
    )
}

fn methods_table(all: &[Measured]) -> Table {
    table!(for (m, o) in outcomes(all);
        "phantom" => &m.title,
        "method" => o.method,
        "ghosts / % of the surface" => (100.0 * o.ghosts, 3),
        "polyps under fluid, 6 mm and more" => m.polyps,
        "largest error of their volume / %" => (100.0 * o.polyp_volume, 1),
        "time / s" => (o.seconds, 3),
        "memory / MB" => (o.megabytes, 0),
    )
}

/// Plots the normals' errors over a factor, with a line for each method and part.
fn factor_plot(all: &[Measured], factor: &Factor) -> Plot {
    let lines = METHODS.iter().flat_map(|method| PLOTTED.map(|part| (method, part)));
    let series = lines.map(|(method, part)| {
        let points = all.iter().filter_map(|m| {
            let (_, value) = m.factor.filter(|(name, _)| *name == factor.name)?;
            let outcome = m.outcomes.iter().find(|o| o.method == method.name)?;
            // A logarithmic axis has no 0.
            Some(Point::at(value.max(1.0e-1), outcome.parts.get(&part)?.mean_degrees))
        });
        Series::line(format!("{}, {}", method.name, part.name()), points)
    });
    let (title, x) = (format!("Normals under tag over {}", factor.name), format!("{} / {}", factor.name, factor.unit));
    Plot::new(title, x, "mean angular error / degrees", series.collect())
}

/// Returns the mean over the phantoms of the first part of what `of` returns for a method.
fn over(all: &[Measured], method: &str, of: impl Fn(&Outcome) -> Option<f64>) -> f64 {
    let own = all.iter().filter(|m| m.factor.is_none());
    let values: Vec<f64> = own.filter_map(|m| m.outcomes.iter().find(|o| o.method == method)).filter_map(of).collect();
    mean(&values)
}

fn findings(all: &[Measured]) -> Vec<String> {
    let dry = over(all, "none", |o| Some(o.parts.get(&Part::Beside(Beside::Gas))?.mean_degrees));
    let mut lines =
        vec![format!("On dry walls, noise ({NOISE_HU:.0} HU) and sampling alone put normals {dry:.1}° off.")];
    for method in &METHODS[1..] {
        let part = |part: Part, of: fn(&measure::Errors) -> f64| over(all, method.name, |o| o.parts.get(&part).map(of));
        let (fluid, rim) = (Part::Beside(Beside::Fluid), Part::Beside(Beside::Rim));
        lines.push(format!(
            "{}: under fluid {:.2} mm and {:.1}° off (95 %: {:.1}°), at rims {:.2} mm and {:.1}°; ghosts on {:.2} % of the surface; \
             {:.0} % of thin folds under fluid missing; {:.2} s.",
            method.name,
            part(fluid, |e| e.mean_mm),
            part(fluid, |e| e.mean_degrees),
            part(fluid, |e| e.p95_degrees),
            part(rim, |e| e.mean_mm),
            part(rim, |e| e.mean_degrees),
            100.0 * over(all, method.name, |o| Some(o.ghosts)),
            100.0 * part(Part::Fold, |e| e.missing),
            over(all, method.name, |o| Some(o.seconds)),
        ));
    }
    lines
}
