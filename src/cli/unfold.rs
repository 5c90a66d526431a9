//! `colvis unfold`: the colon cut open and laid flat.

use std::path::Path;

use serde_json::{Value, json};

use crate::app::Timings;
use crate::cli::args::{Global, Point, UnfoldArgs};
use crate::cli::colon::Colon;
use crate::cli::messages::say;
use crate::cli::prepare;
use crate::error::{Error, Result};
use crate::fields::matching::has_line;
use crate::fields::{Along, Lumen};
use crate::host::record::write_rgb_png;
use crate::output;
use crate::progress::Progress;
use crate::unfold::{Chart, Measures, Sheet, Unfolding, picture};

/// Two ends this close are one place, mm.
const APART_MM: f64 = 3.0;

/// Runs the command. Fails with status 2 for an unknown ending, 3 if the input cannot be read, 4 if it has no colon, no line through it,
/// or no such point, or if interrupted, 5 if an output cannot be written.
pub(crate) fn run(args: &UnfoldArgs, global: &Global, progress: &Progress) -> Result<()> {
    check_ending(&args.out, "png", "an image")?;
    args.map.as_deref().map_or(Ok(()), |map| check_ending(map, "npy", "a NumPy file"))?;
    let iso = prepare::transfer(global)?.iso();
    let outputs: Vec<&Path> =
        [Some(&args.out), args.map.as_ref(), args.stats.as_ref()].into_iter().flatten().map(|p| p.as_path()).collect();
    output::check_folders(&outputs)?;
    let mut timings = Timings::default();
    let (colon, volume) = Colon::cleansed(&args.input, global, &mut timings, progress)?;
    let line = colon.along.only_line().filter(|_| has_line(&colon.lumen, &colon.along));
    let Some(line) = line else { return Err(no_line(&args.input, &colon.lumen)) };
    let sheet = sheet(args, &colon.along)?;
    let chart = timings.time("chart_s", || Chart::new(&volume, &colon.lumen, line, iso, progress))?;
    for [from, to] in chart.gaps() {
        say(&format!("from {from:.0} to {to:.0} mm the lumen is collapsed: those rows are empty"));
    }
    let map = timings.time("map_s", || Unfolding::new(chart, &volume, iso, &sheet, progress))?;
    let pixels = timings.time("picture_s", || Ok(picture(&map, iso)))?;
    write_rgb_png(&args.out, &pixels, [map.columns(), map.rows()])?;
    if let Some(path) = &args.map {
        output::write_npy(path, map.points().as_flattened(), &[map.rows(), map.columns(), 3])?;
    }
    if let Some(path) = &args.stats {
        progress.stage("measuring", 0);
        let measures = timings.time("measure_s", || Ok(Measures::of(&map)))?;
        let mut stats = prepare::stats_head(&timings);
        if let Value::Object(measures) = json!(measures) {
            stats.extend(measures);
        }
        let [steps, cells] = map.chart().solved();
        for (name, value) in [
            ("rows", json!(map.rows())),
            ("columns", json!(map.columns())),
            ("from_mm", json!(map.mm(0))),
            ("to_mm", json!(map.mm(map.rows() - 1))),
            ("length_mm", json!(map.chart().length_mm())),
            ("gaps_mm", json!(map.chart().gaps())),
            ("cleansed", json!(colon.is_cleansed)),
            ("solver_steps", json!(steps)),
            ("solver_cells", json!(cells)),
        ] {
            stats.insert(name.to_owned(), value);
        }
        output::write_json(path, &stats)?;
    }
    Ok(())
}

/// Fails with status 2 unless a file's name ends so.
fn check_ending(path: &Path, ending: &str, what: &str) -> Result<()> {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending)) {
        return Ok(());
    }
    let why = format!("its extension is not that of {what}");
    Err(Error::usage(path.display().to_string(), why, format!("end it in .{ending}")))
}

/// The failure for a colon without a line from the rectum to the cecum.
fn no_line(input: &Path, lumen: &Lumen) -> Error {
    let count = lumen.segments.len();
    let place = lumen.largest().map_or_else(String::new, |n| {
        let p = lumen.segments[n].ends[0];
        format!(", the largest with one end at {:.0},{:.0},{:.0}", p.x, p.y, p.z)
    });
    let why = format!("no line leads from the rectum to the cecum: the colon is in {count} pieces{place}");
    Error::incomplete(input.display().to_string(), why, "give a scan whose colon is better filled")
}

/// The part of the colon between the requested points. Fails with status 4 if one of them is not in the colon, or if both are one place.
fn sheet(args: &UnfoldArgs, along: &Along) -> Result<Sheet> {
    let place = |option: &str, point: Option<Point>, whole: Option<f64>| match point {
        None => Ok(whole),
        Some(Point::Rectum) => Ok(None),
        Some(Point::Cecum) => Ok(Some(f64::INFINITY)),
        Some(Point::World(p)) => along.of(p).map(|a| Some(a.mm)).ok_or_else(|| {
            let why = format!("{:.1},{:.1},{:.1} is not in the colon", p.x, p.y, p.z);
            Error::incomplete(option, why, "give a point in the colon")
        }),
    };
    let from = place("--from", args.from, None)?;
    let to = place("--to", args.to, Some(f64::INFINITY))?;
    // The rectum is on top, whichever end comes first.
    let key = |mm: Option<f64>| mm.unwrap_or(f64::NEG_INFINITY);
    let (low, high) = if key(from) <= key(to) { (from, to) } else { (to, from) };
    if key(high) - key(low) < APART_MM || (low, high) == (Some(f64::INFINITY), Some(f64::INFINITY)) || high.is_none() {
        return Err(Error::incomplete("--to", "is the same place as --from", "give two places"));
    }
    Ok(Sheet { from_mm: low, to_mm: high.filter(|mm| mm.is_finite()), ..Sheet::default() })
}
