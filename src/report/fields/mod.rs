//! `report fields`: wall distances and centerlines, error against time and memory.

mod kinds;
mod measure;
mod slices;

use std::path::Path;

use crate::error::Result;
use crate::fields::centerline::CenterlineMethod;
use crate::fields::lumen;
use crate::phantom::{Phantom, PhantomSettings, Size};
use crate::progress::Progress;
use crate::volume::Volume;

use super::page::Page;
use super::plot::{Plot, Point, Series};
use super::table::{Table, table};
use super::{Effort, mean};
use measure::{DistanceLine, LineLine, Measured};

/// Centerline methods, with their names in the report.
const METHODS: [(CenterlineMethod, &str); 4] = [
    (CenterlineMethod::PenalisedPath, "penalised path"),
    (CenterlineMethod::PeelOnion, "peel onion"),
    (CenterlineMethod::Roadmap, "roadmap"),
    (CenterlineMethod::Cells, "cell decomposition"),
];
/// Number of phantoms in a full report.
const SEEDS: u64 = 3;

/// Number of phantoms with every kind of gas in a full report.
const JUDGED: u64 = 10;

/// Measures on phantoms (and on a scan, with its title) and writes the report into `folder`. Returns the findings, one sentence
/// each.
///
/// # Errors
/// Returns status 4 if interrupted or if a scan contains no colon, 5 if a file cannot be written.
pub fn report(
    effort: Effort,
    seed: u64,
    scan: Option<(String, Volume)>,
    folder: &Path,
    progress: &Progress,
) -> Result<Vec<String>> {
    let (size, name) = effort.choose((Size::Small, "small"), (Size::Standard, "standard"));
    let mut all = Vec::new();
    for seed in seed..seed + effort.choose(1, SEEDS) {
        let phantom = Phantom::new(&PhantomSettings { size, seed, ..PhantomSettings::default() });
        let volume = phantom.voxelise(&phantom.grid(), progress)?;
        all.push(measure::measure(&format!("phantom, {name}, seed {seed}"), &volume, Some(&phantom), progress)?);
    }
    let (mut decided, mut sliced) = (None, Vec::new());
    if let Some((title, volume)) = scan {
        all.push(measure::measure(&title, &volume, None, progress)?);
        sliced = slices::scan(effort, &title, &volume, progress)?;
        decided = Some((title, kinds::Decisions::of(&lumen::find(&volume, progress)?)));
    }
    let judged = kinds::phantoms(size, name, effort.choose(2, JUDGED), progress)?;
    let sliced = [slices::phantoms(effort, size, seed, progress)?, sliced];
    write(&all, &judged, decided.as_ref(), &sliced, folder)
}

fn write(
    all: &[Measured],
    judged: &[kinds::Judgement],
    decided: Option<&(String, kinds::Decisions)>,
    [phantoms, scan]: &[Vec<slices::Run>; 2],
    folder: &Path,
) -> Result<Vec<String>> {
    let mut page = Page::new(folder, "colvis: distances to the wall and centerlines, error against time")?;
    page.text(
        "Phantoms with folds, polyps and noise; the truth of a centerline is the tube's axis, that of a distance the \
         analytic wall within 2 mm of it. A line's error is the distance of its points from the truth, between its ends. \
         Memory is the increase of resident memory, on systems that report it. Each method is measured once, in turn, in a process that has run it before.",
    );
    let mut findings = findings(all);
    page.findings(&findings);
    page.section("Distance to the wall");
    page.plot(
        "distances",
        &plot("Distance to the wall", all, |m| &m.distances, |d: &DistanceLine| (d.method, d.seconds, d.wall_mm)),
        "Mean error against the analytic wall, at voxels within 2 mm of it.",
    )?;
    page.table("distance-methods", &distance_table(all))?;
    page.section("Centerline");
    page.plot(
        "centerlines",
        &plot("Centerline", all, |m| &m.lines, |l: &LineLine| (l.method, l.seconds, l.mean_mm)),
        "Mean distance of the line's points from the tube's axis; each point is one phantom.",
    )?;
    page.table("centerline-methods", &line_table(all))?;
    page.section("The whole preparation");
    page.table("preparation", &preparation_table(all))?;
    let about_kinds = kinds::write(&mut page, judged, decided)?;
    page.findings(&about_kinds);
    findings.extend(about_kinds);
    let about_slices = slices::write(&mut page, phantoms, scan)?;
    page.findings(&about_slices);
    findings.extend(about_slices);
    page.finish()?;
    Ok(findings)
}

/// Plots error over time with a series for each method.
fn plot<L>(
    title: &str,
    all: &[Measured],
    lines: impl Fn(&Measured) -> &Vec<L>,
    point: impl Fn(&L) -> (&'static str, f64, Option<f64>),
) -> Plot {
    let point = |m: &Measured, l: &L| {
        let (method, seconds, error) = point(l);
        Some((method.to_owned(), false, Point { x: 1000.0 * seconds, y: error?, name: m.short.clone() }))
    };
    let points = all.iter().flat_map(|m| lines(m).iter().filter_map(|l| point(m, l)).collect::<Vec<_>>());
    Plot { front: true, ..Plot::new(title, "time / ms", "mean error / mm", Series::grouped(points)) }
}

fn distance_table(all: &[Measured]) -> Table {
    table!(for (m, d) in all.iter().flat_map(|m| m.distances.iter().map(move |d| (m, d)));
        "volume" => &m.title,
        "method" => d.method,
        "time / s" => (d.seconds, 3),
        "memory / MB" => (d.megabytes, 1),
        "mean error against exact / mm" => (d.mean_mm, 3),
        "largest / mm" => (d.max_mm, 2),
        "mean error at the wall / mm" => (d.wall_mm, 3),
    )
}

fn line_table(all: &[Measured]) -> Table {
    table!(for (m, l) in all.iter().flat_map(|m| m.lines.iter().map(move |l| (m, l)));
        "volume" => &m.title,
        "method" => l.method,
        "time / s" => (l.seconds, 3),
        "memory / MB" => (l.megabytes, 1),
        "mean error / mm" => (l.mean_mm, 2),
        "95 % / mm" => (l.p95_mm, 2),
        "largest / mm" => (l.max_mm, 2),
        "length / mm" => (l.length_mm, 0),
        "least radius / mm" => (l.least_radius_mm, 1),
    )
}

fn preparation_table(all: &[Measured]) -> Table {
    let mb = |b: usize| b as f64 / 1e6;
    table!(for m in all;
        let parts = [m.lumen_s, m.distances[0].seconds, m.lines[0].seconds];
        "volume" => &m.title,
        "volume / MB" => (mb(m.volume_bytes), 0),
        "lumen / s" => (parts[0], 2),
        "distance / s" => (parts[1], 2),
        "centerline / s" => (parts[2], 2),
        "sum / s" => (parts.iter().sum::<f64>(), 2),
        "kept fields / MB" => (mb(m.field_bytes), 1),
        "fields of the volume / %" => (100.0 * m.field_bytes as f64 / m.volume_bytes as f64, 1),
    )
}

/// Returns the findings, in two sentences.
fn findings(all: &[Measured]) -> Vec<String> {
    let phantoms: Vec<&Measured> = all.iter().filter(|m| m.lines.iter().all(|l| l.mean_mm.is_some())).collect();
    let over = |f: &dyn Fn(&Measured) -> f64| mean(&phantoms.iter().map(|m| f(m)).collect::<Vec<_>>());
    let line = |m: &Measured, n: usize| m.lines[n].mean_mm.unwrap_or(f64::NAN);
    let error: Vec<f64> = (0..METHODS.len()).map(|n| over(&|m| line(m, n))).collect();
    let time: Vec<f64> = (0..METHODS.len()).map(|n| over(&|m| m.lines[n].seconds)).collect();
    let best = (0..METHODS.len()).reduce(|a, b| if error[b] < error[a] { b } else { a }).unwrap_or(0);
    let next = (0..METHODS.len()).filter(|&n| n != best).reduce(|a, b| if error[b] < error[a] { b } else { a });
    let next = next.unwrap_or(best);
    let distance = |n: usize, f: &dyn Fn(&DistanceLine) -> f64| over(&|m| f(&m.distances[n]));
    vec![
        format!(
            "The centerline by {} has the smallest mean error, {:.2} mm in {:.2} s; next is {} with {:.2} mm in {:.2} s.",
            METHODS[best].1, error[best], time[best], METHODS[next].1, error[next], time[next]
        ),
        format!(
            "The exact distance takes {:.2} s with a mean error of {:.3} mm at the wall. There, {} ({:.2} s) has {:.3} mm and {} ({:.2} s) {:.3} mm; further inside, their errors reach {:.1} and {:.1} mm.",
            distance(0, &|d| d.seconds),
            distance(0, &|d| d.wall_mm.unwrap_or(f64::NAN)),
            measure::DISTANCES[1],
            distance(1, &|d| d.seconds),
            distance(1, &|d| d.wall_mm.unwrap_or(f64::NAN)),
            measure::DISTANCES[2],
            distance(2, &|d| d.seconds),
            distance(2, &|d| d.wall_mm.unwrap_or(f64::NAN)),
            distance(1, &|d| d.max_mm),
            distance(2, &|d| d.max_mm),
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn findings_follow_the_numbers() {
        let line = |n: usize, mean: f64| LineLine {
            method: METHODS[n].1,
            seconds: 1.0,
            megabytes: None,
            mean_mm: Some(mean),
            p95_mm: None,
            max_mm: None,
            length_mm: 100.0,
            least_radius_mm: 3.0,
        };
        let distance = |n: usize| DistanceLine {
            method: measure::DISTANCES[n],
            seconds: 1.0,
            megabytes: None,
            mean_mm: 0.1,
            max_mm: 0.2,
            wall_mm: Some(0.05),
        };
        let mut m = Measured {
            title: "phantom".to_owned(),
            short: "1".to_owned(),
            volume_bytes: 100,
            field_bytes: 10,
            lumen_s: 0.5,
            distances: (0..3).map(distance).collect(),
            lines: (0..4).map(|n| line(n, 1.0 + n as f64)).collect(),
        };
        assert!(findings(&[m.clone()])[0].contains("by penalised path has the smallest mean error, 1.00 mm"));
        m.lines[2].mean_mm = Some(0.25);
        let found = findings(&[m.clone()]);
        assert!(
            found[0].contains("by roadmap has the smallest mean error, 0.25 mm")
                && found[0].contains("next is penalised")
        );
        // A scan without a truth changes nothing.
        let scan = Measured { lines: m.lines.iter().map(|l| LineLine { mean_mm: None, ..*l }).collect(), ..m.clone() };
        assert_eq!(findings(&[m, scan]), found);
    }
}
