//! The page of `report candidates`.

use std::path::Path;

use super::froc::{Is, Share, Trial, false_positives};
use super::{FACTORS, Measured, Part, Step};
use crate::error::Result;
use crate::phantom::{DecoyKind, PolypShape, PolypSite, TruePolyp};
use crate::polyps::FEATURES;
use crate::report::page::Page;
use crate::report::plot::{Plot, Point, Series};
use crate::report::table::{Cell, Table, finite, row, table};
use crate::report::{mean, quantile};

/// Rates of false positives per scan at which the tables give the sensitivity.
const RATES: [f64; 5] = [0.5, 1.0, 2.0, 4.0, 8.0];
/// The rate used for everything else.
const RATE: f64 = 2.0;

/// A group of polyps.
type Group = (String, Box<dyn Fn(&TruePolyp) -> bool>);

const SHAPES: [(PolypShape, &str); 3] =
    [(PolypShape::Sessile, "sessile"), (PolypShape::Stalked, "stalked"), (PolypShape::Flat, "flat")];
const SITES: [(PolypSite, &str); 3] =
    [(PolypSite::Wall, "on walls"), (PolypSite::Fold, "on folds"), (PolypSite::Between, "between folds")];
const SIZES: [(f64, f64, &str); 3] =
    [(3.0, 6.0, "3-5 mm"), (6.0, 10.0, "6-9 mm"), (10.0, f64::INFINITY, "10 mm or more")];
const KINDS: [(DecoyKind, &str); 6] = [
    (DecoyKind::FoldTip, "fold tip"),
    (DecoyKind::FoldJunction, "junction of folds"),
    (DecoyKind::Valve, "ileocecal valve"),
    (DecoyKind::Tube, "rectal tube and balloon"),
    (DecoyKind::Stool, "untagged stool"),
    (DecoyKind::TaggedStool, "tagged stool"),
];

/// True for a sessile or stalked polyp of at least 6 mm, which a detector should find.
fn is_due(p: &TruePolyp) -> bool {
    p.diameter_mm >= 6.0 && p.shape != PolypShape::Flat
}

/// True for a flat polyp that is high enough to be seen.
fn is_raised(p: &TruePolyp) -> bool {
    p.shape == PolypShape::Flat && p.height_mm.is_some_and(|h| h >= 2.0)
}

fn groups() -> Vec<Group> {
    let mut out: Vec<Group> = vec![("sessile and stalked of 6 mm or more".to_owned(), Box::new(is_due))];
    for (site, name) in SITES {
        out.push((format!("… {name}"), Box::new(move |p| is_due(p) && p.site == site)));
    }
    out.push(("… submerged".to_owned(), Box::new(|p| is_due(p) && p.submerged)));
    out.push(("… not submerged".to_owned(), Box::new(|p| is_due(p) && !p.submerged)));
    out.push(("flat of 2 mm high or more".to_owned(), Box::new(is_raised)));
    for (shape, name) in SHAPES {
        for (least, most, size) in SIZES {
            let of = move |p: &TruePolyp| p.shape == shape && (least..most).contains(&p.diameter_mm);
            out.push((format!("{name} {size}"), Box::new(of)));
        }
    }
    out
}

/// Writes the page. Returns the findings.
pub(super) fn write(
    usual: &[Measured],
    steps: &[Step],
    own: &[Part],
    first: u64,
    folder: &Path,
) -> Result<Vec<String>> {
    let mut page = Page::new(folder, "colvis: polyp candidates, sensitivity against false positives")?;
    page.text(&format!(
        "Phantoms with folds, lesions of every shape and site, decoys, pools, films, stool, pseudo-enhancement and noise. Seeds {first} \
         and above are a test set: every constant of the detectors was chosen on seeds 1 to 30, and on one CT as an example of a wall \
         without polyps. A candidate within 3 mm of a lesion's surface is a hit, whatever the size and shape of the lesion. Every other \
         candidate, on a decoy or not, is a false positive. Intervals are 95 % Wilson intervals. All scans are synthetic: the figures say \
         nothing about patients.",
    ));
    let mut findings = findings(usual);
    findings.extend(own.iter().filter(|p| p.name != "own").flat_map(put_in));
    page.findings(&findings);
    page.section("Sensitivity against false positives");
    page.plot("froc", &curves(usual), "Sessile and stalked polyps of 6 mm or more. Lower and further left is better.")?;
    page.table("sensitivity", &sensitivity(usual))?;
    page.section("Measures");
    page.table("measures", &measures(usual))?;
    page.section("Decoys");
    page.table("decoys", &decoys(usual))?;
    page.table("features", &features(usual))?;
    for factor in FACTORS.iter().filter(|f| steps.iter().any(|s| s.name == f.name)) {
        page.section(&format!("Effect of {}", factor.name));
        page.table(&format!("by-{}", factor.name), &by_factor(usual, steps, factor.name))?;
    }
    for Part { name, title, text, measured } in own {
        page.section(title);
        if !text.is_empty() {
            page.text(text);
        }
        page.table(name, &sensitivity(measured))?;
        page.table(&format!("{name}-measures"), &measures(measured))?;
        page.csv(&format!("{name}-candidates"), &every(measured))?;
    }
    page.section("All candidates");
    page.csv("candidates", &every(usual))?;
    page.text("candidates.csv lists each candidate with its features and its class.");
    page.finish()?;
    Ok(findings)
}

fn curves(all: &[Measured]) -> Plot {
    let series = all.iter().map(|m| {
        let count = Share::at(&m.trials, 0.0, is_due).of.max(1) as f64;
        let rates = (0..40).map(|n| 0.125 * 1.19f64.powi(n));
        let point = |rate: f64| {
            let score = m.threshold(rate);
            let missed = 1.0 - Share::at(&m.trials, score, is_due).value();
            // A logarithmic axis has no 0: half a polyp.
            Point::at(rate, 100.0 * missed.max(0.5 / count))
        };
        Series::line(m.detector, rates.map(point))
    });
    let title = "Missed polyps against false positives";
    Plot::new(title, "false positives a scan", "missed / %", series.collect())
}

fn sensitivity(all: &[Measured]) -> Table {
    let rates: Vec<String> = RATES.iter().map(|r| format!("{r} a scan / %")).collect();
    let mut columns = vec!["detector", "polyps", "number"];
    columns.extend(rates.iter().map(String::as_str));
    columns.extend(["at 2: from / %", "to / %", "at any score / %"]);
    let mut t = Table::new(&columns);
    for m in all {
        for (name, group) in groups() {
            let at = |rate: f64| Share::at(&m.trials, m.threshold(rate), &group);
            let [low, high] = at(RATE).interval();
            let mut row = row![m.detector, name, at(RATE).of];
            let any = Share::at(&m.trials, f64::NEG_INFINITY, &group).value();
            let shares = RATES.iter().map(|&r| at(r).value()).chain([low, high, any]);
            row.extend(shares.map(|share| finite(100.0 * share, 1)));
            t.row(row);
        }
    }
    t
}

/// Errors of a measurement over the polyps found in a group: measured minus true.
fn errors(
    m: &Measured,
    group: impl Fn(&TruePolyp) -> bool,
    of: impl Fn(&TruePolyp, &crate::polyps::Lesion) -> Option<f64>,
) -> Vec<f64> {
    let each = |t: &Trial| -> Vec<f64> {
        let polyps = t.polyps.iter().enumerate().filter(|p| group(p.1));
        polyps.filter_map(|(n, p)| of(p, t.best(n)?.lesion.as_ref()?)).collect()
    };
    m.trials.iter().flat_map(each).collect()
}

fn deviation(values: &[f64]) -> f64 {
    let middle = mean(values);
    (values.iter().map(|v| (v - middle).powi(2)).sum::<f64>() / (values.len() as f64 - 1.0)).sqrt()
}

fn measures(all: &[Measured]) -> Table {
    let groups = all.iter().flat_map(|m| {
        let each = groups().into_iter().map(move |(name, group)| {
            let diameter = errors(m, &group, |p, l| Some(l.diameter_mm - p.diameter_mm));
            let height = errors(m, &group, |p, l| Some(l.height_mm - p.height_mm?));
            let volume = errors(m, &group, |p, l| Some(100.0 * (l.volume_mm3 / p.volume_mm3? - 1.0)));
            (m.detector, name, diameter, height, volume)
        });
        each.filter(|g| !g.2.is_empty())
    });
    let size = |v: &[f64]| v.iter().map(|x| x.abs()).collect::<Vec<_>>();
    let worst = |v: &[f64]| v.iter().copied().fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a });
    table!(for (detector, name, diameter, height, volume) in groups;
        "detector" => detector,
        "polyps" => name,
        "measured" => diameter.len(),
        "diameter: bias / mm" => finite(mean(&diameter), 2),
        "SD / mm" => finite(deviation(&diameter), 2),
        "68 % within / mm" => finite(quantile(&size(&diameter), 0.68), 2),
        "95 % within / mm" => finite(quantile(&size(&diameter), 0.95), 2),
        "worst / mm" => finite(worst(&diameter), 2),
        "height: bias / mm" => finite(mean(&height), 2),
        "SD / mm" => finite(deviation(&height), 2),
        "volume: median error / %" => finite(quantile(&volume, 0.5), 1),
        "95 % within / %" => finite(quantile(&size(&volume), 0.95), 1),
    )
}

fn decoys(all: &[Measured]) -> Table {
    let mut t = Table::new(&["detector", "decoy", "number", "false positive at 2 a scan", "candidate at any score"]);
    for m in all {
        let score = m.threshold(RATE);
        for (kind, name) in KINDS {
            let (mut of, mut taken, mut any) = (0usize, 0usize, 0usize);
            for trial in &m.trials {
                for (n, _) in trial.decoys.iter().enumerate().filter(|d| d.1.kind == kind) {
                    of += 1;
                    taken += usize::from(trial.decoy(n).is_some_and(|c| c.score >= score));
                    any += usize::from(trial.decoy(n).is_some());
                }
            }
            t.row(row![m.detector, name, of, taken, any]);
        }
        let other = m.trials.iter().flat_map(|t| &t.found).filter(|f| f.1 == Is::Other);
        let taken = other.clone().filter(|f| f.0.score >= score).count();
        t.row(row![m.detector, "wall, no decoy", Cell::None, taken, other.count()]);
    }
    t
}

/// The median of each feature over polyps and over each kind of decoy, to show which features separate them.
fn features(all: &[Measured]) -> Table {
    let mut columns = vec!["detector", "candidates on"];
    columns.extend(FEATURES);
    let mut t = Table::new(&columns);
    for m in all {
        let mut row = |name: &str, lesions: Vec<&crate::polyps::Lesion>| {
            if lesions.is_empty() {
                return;
            }
            let median = |n: usize| quantile(&lesions.iter().map(|l| l.features[n]).collect::<Vec<_>>(), 0.5);
            let medians = (0..FEATURES.len()).map(|n| finite(median(n), 3));
            t.row(row![m.detector, name].into_iter().chain(medians).collect());
        };
        let best = m.trials.iter().flat_map(|t| (0..t.polyps.len()).filter_map(|n| t.best(n)?.lesion.as_ref()));
        row("polyps", best.collect());
        for (kind, name) in KINDS {
            let of = |t: &'_ Trial| -> Vec<usize> {
                t.decoys.iter().enumerate().filter(|d| d.1.kind == kind).map(|d| d.0).collect()
            };
            let found = m
                .trials
                .iter()
                .flat_map(|t| of(t).into_iter().filter_map(|n| t.decoy(n)?.lesion.as_ref()).collect::<Vec<_>>());
            row(name, found.collect());
        }
    }
    t
}

fn by_factor(usual: &[Measured], steps: &[Step], name: &str) -> Table {
    let steps = steps.iter().filter(|s| s.name == name).flat_map(|s| s.measured.iter().map(move |m| (s, m)));
    table!(for (step, m) in steps;
        let score = m.threshold(RATE);
        // The threshold that a reader would have chosen on the default scans.
        let as_usual = usual.iter().find(|u| u.detector == m.detector).map_or(score, |u| u.threshold(RATE));
        let due = Share::at(&m.trials, score, is_due);
        let [low, high] = due.interval();
        let small = Share::at(&m.trials, score, |p| p.diameter_mm < 6.0 && p.shape != PolypShape::Flat);
        let flat = Share::at(&m.trials, score, |p| p.shape == PolypShape::Flat);
        "value" => format!("{} {}", step.value, step.unit),
        "detector" => m.detector,
        "number" => due.of,
        "found at 2 a scan / %" => finite(100.0 * due.value(), 1),
        "from / %" => finite(100.0 * low, 1),
        "to / %" => finite(100.0 * high, 1),
        "3-5 mm / %" => finite(100.0 * small.value(), 1),
        "flat / %" => finite(100.0 * flat.value(), 1),
        "false positives at the default threshold" => finite(false_positives(&m.trials, as_usual), 2),
        "time / s" => finite(m.seconds, 2),
    )
}

fn every(all: &[Measured]) -> Table {
    let mut columns = vec!["detector", "scan", "score", "is", "number", "x", "y", "z"];
    columns.extend(FEATURES);
    let mut t = Table::new(&columns);
    for m in all {
        for (scan, trial) in m.trials.iter().enumerate() {
            for (c, is) in &trial.found {
                let (what, number) = match is {
                    Is::Polyp(n) => ("polyp", Some(*n)),
                    Is::Decoy(n) => {
                        let kind = trial.decoys[*n].kind;
                        (KINDS.iter().find(|k| k.0 == kind).map_or("", |k| k.1), Some(*n))
                    }
                    Is::Other => ("other", None),
                };
                let [x, y, z] = c.position.to_array().map(|x| (x, 2));
                let mut row = row![m.detector, scan, (c.score, 4), what, number, x, y, z];
                let features = c.lesion.as_ref().map(|l| l.features);
                row.extend((0..FEATURES.len()).map(|n| Cell::from((features.map(|f| f[n]), 4))));
                t.row(row);
            }
        }
    }
    t
}

/// The rate of false positives at which lesions in real scans are told.
const REAL_RATE: f64 = 4.0;

/// What is said first of lesions that were put into a scan.
fn put_in(part: &Part) -> Vec<String> {
    let line = |m: &Measured| {
        let at = |group: fn(&TruePolyp) -> bool| Share::at(&m.trials, m.threshold(REAL_RATE), group);
        let (due, raised) = (at(is_due), at(is_raised));
        let diameter = errors(m, |p| p.diameter_mm >= 6.0, |p, l| Some(l.diameter_mm - p.diameter_mm));
        let size = if diameter.is_empty() {
            String::new()
        } else {
            format!(" Diameters from 6 mm: bias {:.2} mm, SD {:.2} mm.", mean(&diameter), deviation(&diameter))
        };
        format!(
            "{}. {}: {} of {} sessile and stalked lesions of 6 mm or more, {} of {} flat ones of 2 mm high or more, at most {REAL_RATE} false \
             positives a scan.{size}",
            part.title, m.detector, due.found, due.of, raised.found, raised.of,
        )
    };
    part.measured.iter().take(1).map(line).collect()
}

fn findings(all: &[Measured]) -> Vec<String> {
    let line = |m: &Measured| {
        let score = m.threshold(RATE);
        let due = Share::at(&m.trials, score, is_due);
        let [low, high] = due.interval().map(|x| 100.0 * x);
        let diameter = errors(m, is_due, |p, l| Some(l.diameter_mm - p.diameter_mm));
        let size = if diameter.is_empty() {
            String::new()
        } else {
            format!(
                " Their diameters, of the tissue, against those of the phantoms' surface, which lies 0.42 times the blur outside: bias {:.2} mm, SD {:.2} mm.",
                mean(&diameter),
                deviation(&diameter)
            )
        };
        format!(
            "{}: {} of {} sessile and stalked polyps of 6 mm or more ({:.1} %; {low:.1} to {high:.1}) at {:.2} false positives a scan, in \
             {:.2} s.{size}",
            m.detector,
            due.found,
            due.of,
            100.0 * due.value(),
            false_positives(&m.trials, score),
            m.seconds,
        )
    };
    all.iter().map(line).collect()
}
