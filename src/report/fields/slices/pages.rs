//! The section of the page: its plot, its table, and what they say.

use super::skips::Skip;
use super::{BASE, Run, Setting};
use crate::error::Result;
use crate::report::page::Page;
use crate::report::plot::{Plot, Point, Series};
use crate::report::table::{Table, table};

/// Writes the section. Returns the findings. Fails with status 5 if a file cannot be written.
pub(in super::super) fn write(page: &mut Page, phantoms: &[Run], scan: &[Run]) -> Result<Vec<String>> {
    page.section("Effect of thick slices and noise on the colon's length");
    page.text(&format!(
        "Two limbs of the colon may share a wall that is thinner than a slice. A line that passes through it skips the \
         stretch between the limbs. Each line leads from rectum to cecum, as \"colvis centerline --from rectum --to cecum\" finds it. A \
         phantom's line is compared with the true one. Slice thickness, noise and wall thickness vary one at a time, from {} mm, {} HU \
         and {} mm. A scan is averaged to thicker slices, white noise is added, and the line is compared with that of the scan as it is. \
         A skip is a place where consecutive points of the line are nearest to points more than 40 mm apart along the reference line. \
         The table gives the largest skip, with its beginning and end along the reference line and its position (LPS), and the beginning \
         and end of the whole line along the reference line. Segments are in order if they are reported to run from rectum to cecum and \
         do; \"wrong\" if they are reported to and do not.",
        BASE.slice_mm,
        BASE.noise_hu,
        BASE.wall_mm.unwrap_or_default(),
    ));
    let caption = "Length of the line found, in percent of the reference line.";
    page.plot("slice-length", &plot(phantoms, scan), caption)?;
    page.table("slices", &table(phantoms.iter().chain(scan)))?;
    let versions = scan.first().map_or(String::new(), |run| format!("versions of {}", run.volume));
    Ok([finding("scans of phantoms", "the true line", phantoms), finding(&versions, "that of the scan as it is", scan)]
        .into_iter()
        .flatten()
        .collect())
}

fn plot(phantoms: &[Run], scan: &[Run]) -> Plot {
    let is_base = |s: Setting| s.noise_hu == BASE.noise_hu && (s.wall_mm.is_none() || s.wall_mm == BASE.wall_mm);
    let shown = phantoms.iter().filter(|r| is_base(r.setting)).map(|r| (r, r.volume.clone()));
    let scanned = scan.iter().map(|r| (r, format!("{}, noise of {} HU added", r.volume, r.setting.noise_hu)));
    let points = shown.chain(scanned).filter_map(|(run, series)| {
        let name = run.seed.map_or(String::new(), |seed| seed.to_string());
        Some((series, run.seed.is_none(), Point { x: run.setting.slice_mm, y: run.share()?, name }))
    });
    let title = "Length of the line over slice thickness; numbers are seeds";
    Plot::new(title, "slice thickness / mm", "share of the length / %", Series::grouped(points))
}

pub(super) fn table<'a>(runs: impl Iterator<Item = &'a Run>) -> Table {
    let place = |s: &Skip| {
        let ([a, b], at) = (s.between_mm, s.at);
        format!("{a:.0} to {b:.0} mm at ({:.0} {:.0} {:.0})", at.x, at.y, at.z)
    };
    table!(for run in runs;
        let Setting { slice_mm, noise_hu, wall_mm } = run.setting;
        let (found, largest) = (run.found.as_ref().ok(), run.largest_skip());
        "volume" => &run.volume,
        "slice / mm" => (slice_mm, 1),
        "noise / HU" => (noise_hu, 0),
        "wall / mm" => (wall_mm, 1),
        "seed" => run.seed.map(|n| (n as f64, 0)),
        "length / mm" => found.map(|f| (f.length_mm, 0)),
        "reference / mm" => (run.reference_mm, 0),
        "share / %" => (run.share(), 1),
        "begins / mm" => found.map(|f| (f.ends_mm[0], 0)),
        "ends / mm" => found.map(|f| (f.ends_mm[1], 0)),
        "skips" => found.map(|f| f.skips.len()),
        "largest skip / mm" => largest.map(|s| (s.mm(), 0)),
        "where" => largest.map(place),
        "narrowest / mm" => found.map(|f| (f.narrowest_mm, 1)),
        "guessed / mm" => found.map(|f| (f.guessed_mm, 0)),
        "septum / voxels" => found.map(|f| f.septum_voxels),
        "segments" => found.map(|f| f.segments),
        "segments in order" => found.map(|f| f.order),
        "parts in order" => found.map(|f| f.parts),
        "exit status" => run.found.as_ref().map_or_else(|why| why.as_str(), |_| "0"),
    )
}

/// Summarises the runs in one or two sentences; `None` if there are none.
pub(super) fn finding(subject: &str, reference: &str, runs: &[Run]) -> Option<String> {
    let range = |of: &dyn Fn(&Run) -> Option<f64>, digits: usize| {
        let values = runs.iter().filter_map(of);
        let (least, most) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        (least <= most).then(|| format!("{least:.digits$} to {most:.digits$}"))
    };
    let slices = range(&|r| Some(r.setting.slice_mm), 1)?;
    let noises = range(&|r| Some(r.setting.noise_hu), 0)?;
    let mut out = format!("In {} {subject}, with slices of {slices} mm and noise of {noises} HU, ", runs.len());
    match range(&|r| r.share(), 1) {
        Some(shares) => out.push_str(&format!("the centerline is {shares} % as long as {reference}. ")),
        None => out.push_str("no centerline is found. "),
    }
    let count = |is: &dyn Fn(&Run) -> bool| runs.iter().filter(|r| is(r)).count();
    let worst = runs.iter().filter_map(|r| Some((r, r.largest_skip()?.mm()))).max_by(|a, b| a.1.total_cmp(&b.1));
    match worst {
        Some((run, mm)) => {
            let skipping = count(&|r| r.largest_skip().is_some());
            let word = if skipping == 1 { "line skips" } else { "lines skip" };
            out.push_str(&format!(
                "{skipping} {word} a stretch of the colon, the longest {mm:.0} mm ({})",
                run.words()
            ));
        }
        None => out.push_str("No line skips a stretch of the colon"),
    }
    let order = |word: &str| count(&|r| r.found.as_ref().is_ok_and(|f| f.order == word));
    let (failed, not_ordered, wrong) = (count(&|r| r.found.is_err()), order("no"), order("wrong"));
    let incomplete = count(&|r| r.found.as_ref().is_ok_and(|f| !f.parts));
    let others = [
        (failed, "without a line"),
        (not_ordered, "without an order"),
        (incomplete, "without all parts on the line"),
        (wrong, "with segments in the wrong order"),
    ];
    let others = others.iter().filter(|o| o.0 > 0).map(|(n, what)| format!("{n} {what}")).collect::<Vec<_>>();
    if !others.is_empty() {
        out.push_str(&format!("; of all volumes, {}", others.join(", ")));
    }
    Some(out + ".")
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::super::Found;
    use super::*;

    #[test]
    fn findings_follow_the_numbers() {
        let found = |skips: Vec<Skip>, order: &'static str| Found {
            length_mm: 900.0,
            ends_mm: [2.0, 998.0],
            skips,
            narrowest_mm: Some(1.0),
            guessed_mm: 0.0,
            septum_voxels: 3,
            segments: 1,
            order,
            parts: true,
        };
        let run = |found| Run {
            volume: "phantom".to_owned(),
            setting: BASE,
            seed: Some(2),
            reference_mm: 1000.0,
            found: Ok(found),
        };
        let say = |runs: &[Run]| finding("phantoms", "the true line", runs).unwrap();
        let good = run(found(Vec::new(), "yes"));
        let said = say(std::slice::from_ref(&good));
        assert!(
            said.contains("90.0 to 90.0 % as long") && said.ends_with("No line skips a stretch of the colon."),
            "{said}"
        );
        let skip = |mm: f64| Skip { between_mm: [100.0, 100.0 + mm], at: DVec3::ZERO };
        let bad = run(found(vec![skip(50.0), skip(321.0)], "wrong"));
        let said = say(&[good, bad.clone()]);
        assert!(said.contains("1 line skips a stretch of the colon, the longest 321 mm (3 mm slices, 25 HU noise, 0.7 mm wall, seed 2)"), "{said}");
        assert!(said.ends_with("1 with segments in the wrong order."), "{said}");
        let csv = table([&bad].into_iter()).csv();
        assert!(csv.contains(",2,998,2,321,100 to 421 mm at (0 0 0),"), "{csv}");
        assert_eq!(finding("phantoms", "the true line", &[]), None);
    }
}
