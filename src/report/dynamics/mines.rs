//! How the number of mines, their spacing and their reach affect which flights arrive, and the benefit of mines where the lumen
//! is not a plain tube.

use glam::DVec3;
use rayon::prelude::*;

use super::Subject;
use crate::app::Scene;
use crate::dynamics::mines::MineSettings;
use crate::error::Result;
use crate::plane::drawing::Drawing;
use crate::plane::shipped::DRAWINGS;
use crate::plane::{Flight, PlaneSettings, State};
use crate::progress::Progress;
use crate::report::page::Page;
use crate::report::table::{Table, known, row, table};
use crate::report::trials::{self, Course};
use crate::report::{Effort, mean};

/// The tested settings, varied one at a time from the defaults.
const KEPT: [usize; 7] = [0, 1, 4, 8, 12, 50, 1000];
const SPACING_MM: [f64; 6] = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0];
const REACH_MM: [f64; 6] = [5.0, 10.0, 15.0, 25.0, 50.0, 100.0];
/// Numbers of mines whose benefit is measured in drawings.
const WORTH: [usize; 3] = [0, 12, 50];
/// Maximum duration of a flight in a quick and in a full report, simulated seconds. No flight of a quick report arrives later.
const SECONDS: [f64; 2] = [60.0, 120.0];

/// Results for one choice of mines.
#[derive(Clone, Debug, PartialEq)]
struct Laid {
    /// The choice.
    settings: MineSettings,
    /// Which setting differs from the default.
    changed: &'static str,
    /// Share of the flights that arrive.
    arrived: f64,
    /// Mean number of places at which a flight searched for another direction.
    escapes: f64,
    /// Mean time of the flights that arrive, s.
    seconds: f64,
}

/// Runs the study.
pub(crate) fn study(subject: &Subject, page: &mut Page, progress: &Progress) -> Result<Vec<String>> {
    let effort = subject.effort;
    let courses = trials::small_phantoms(effort, progress)?;
    let laid = measure(&courses, effort, progress)?;
    let d = MineSettings::default();
    page.text(&format!(
        "The same small phantoms ({}) with other mines; one parameter at a time differs from the default: {} mines, {} mm apart, that reach \
         {} mm. A flight without mines still keeps its heading; mines prevent it from turning back where the lumen looks shorter ahead than behind.",
        courses.len(),
        d.kept,
        d.spacing_mm,
        d.reach_mm
    ));
    page.table("mines", &table(&laid))?;
    let good = |changed: &str, value: &dyn Fn(&MineSettings) -> f64| {
        let arrive = laid.iter().filter(|l| l.changed == changed && l.arrived >= 1.0);
        let values: Vec<String> = arrive.map(|l| value(&l.settings).to_string()).collect();
        if values.is_empty() { "none".to_owned() } else { values.join(", ") }
    };
    let mut findings = vec![format!(
        "Every flight arrives with {} mines kept, with {} mm between them, and with a reach of {} mm.",
        good("number", &|s| s.kept as f64),
        good("spacing", &|s| s.spacing_mm),
        good("reach", &|s| s.reach_mm)
    )];
    findings.push(worth(effort, page, progress)?);
    Ok(findings)
}

/// Measures the benefit of mines where the lumen is not a plain tube: flights through drawings, from many points around the
/// start, without mines and with increasing numbers of them.
fn worth(effort: Effort, page: &mut Page, progress: &Progress) -> Result<String> {
    page.text(&format!(
        "Flights through drawings by tentacles, each from {} places up to 3 mm from its start, by number of mines kept: how many arrive, and the length of their path. A tube needs no mines. At a strand they select a side. In a wide pouch, whose exit lies beside its entrance, the default has too few: their trail of {:.0} mm is shorter than one round, so the camera flies the same circle again.",
        effort.choose(4, 12),
        trail_mm(&MineSettings::default()),
    ));
    let heads: Vec<String> = WORTH
        .iter()
        .flat_map(|kept| [format!("{kept} mines: arrive (%)"), format!("{kept} mines: path (mm)")])
        .collect();
    let heads: Vec<&str> = ["drawing"].into_iter().chain(heads.iter().map(String::as_str)).collect();
    let mut table = Table::new(&heads);
    // Drawings in which the number of mines decides whether a flight arrives.
    let mut decided = Vec::new();
    for (name, png) in &DRAWINGS {
        let drawing = Drawing::decode(name, png)?;
        let mut row = row![*name];
        let mut shares = Vec::new();
        for kept in WORTH {
            let ways = arrivals(&drawing, kept, effort)?;
            let arrived: Vec<f64> = ways.iter().flatten().copied().collect();
            let share = arrived.len() as f64 / ways.len().max(1) as f64;
            row.extend(row![(100.0 * share, 0), known(mean(&arrived), 0)]);
            shares.push(share);
        }
        progress.check()?;
        table.row(row);
        if shares.iter().any(|s| *s != shares[0]) {
            let reported: Vec<String> =
                WORTH.iter().zip(&shares).map(|(kept, s)| format!("{:.0} % with {kept}", 100.0 * s)).collect();
            decided.push(format!("{name} ({})", reported.join(", ")));
        }
    }
    page.table("mines-worth", &table)?;
    Ok(match decided[..] {
        [] => "The number of mines does not decide which flights through drawings arrive.".to_owned(),
        _ => format!("Drawings in which the number of mines decides which flights arrive: {}.", decided.join("; ")),
    })
}

/// Returns the length of the trail covered by mines, mm.
fn trail_mm(settings: &MineSettings) -> f64 {
    settings.kept as f64 * settings.spacing_mm
}

/// Returns the path lengths (mm) of flights through a drawing from points around its start; `None` for flights that do not arrive.
fn arrivals(drawing: &Drawing, kept: usize, effort: Effort) -> Result<Vec<Option<f64>>> {
    let settings =
        PlaneSettings { mines: Some(MineSettings { kept, ..MineSettings::default() }), ..PlaneSettings::default() };
    let starts = effort.choose(4, 12);
    let fly = |n: usize| {
        let mut flight = Flight::new(drawing.clone(), settings.clone())?;
        // A sunflower pattern: evenly over a disc of 3 mm.
        let (radius, angle) = (3.0 * (n as f64 / f64::from(starts)).sqrt(), 2.399_963 * n as f64);
        flight.start_at(flight.plan().start + DVec3::new(angle.cos(), angle.sin(), 0.0) * radius)?;
        while flight.state() == State::Flying {
            flight.step();
        }
        Ok((flight.state() == State::Arrived).then(|| flight.length_mm()))
    };
    (0..starts as usize).into_par_iter().map(fly).collect()
}

/// Flies the courses with each choice; a quick report uses every third.
fn measure(courses: &[Course], effort: Effort, progress: &Progress) -> Result<Vec<Laid>> {
    let d = MineSettings::default();
    let choices: Vec<(&str, MineSettings)> = (KEPT.map(|kept| ("number", MineSettings { kept, ..d })).into_iter())
        .chain(SPACING_MM.map(|spacing_mm| ("spacing", MineSettings { spacing_mm, ..d })))
        .chain(REACH_MM.map(|reach_mm| ("reach", MineSettings { reach_mm, ..d })))
        .collect();
    let seconds = effort.choose(SECONDS[0], SECONDS[1]);
    let measure = |(changed, settings): (&'static str, MineSettings)| {
        let scene = Scene { mines: Some(settings), ..Scene::default() };
        let flown = courses.iter().map(|c| trials::fly(c, &scene, seconds)).collect::<Result<Vec<_>>>()?;
        progress.check()?;
        let arrived: Vec<f64> = flown.iter().filter(|t| t.arrived()).map(|t| t.seconds).collect();
        Ok(Laid {
            settings,
            changed,
            arrived: arrived.len() as f64 / flown.len() as f64,
            escapes: mean(&flown.iter().map(|t| f64::from(t.escapes)).collect::<Vec<_>>()),
            seconds: mean(&arrived),
        })
    };
    choices
        .into_par_iter()
        .enumerate()
        .filter(|(n, _)| effort == Effort::Full || n % 3 == 0)
        .map(|c| measure(c.1))
        .collect()
}

/// Formats the results as a table.
fn table(laid: &[Laid]) -> Table {
    table!(for l in laid;
        "changed" => l.changed,
        "mines kept" => l.settings.kept,
        "spacing (mm)" => (l.settings.spacing_mm, 0),
        "reach (mm)" => (l.settings.reach_mm, 0),
        "flights that arrive (%)" => (100.0 * l.arrived, 0),
        "searches for another direction" => (l.escapes, 1),
        "mean time of arriving flights (s)" => known(l.seconds, 1),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plane::shipped;

    /// Mines are decisive at a strand across the view, and in a wide pouch whose exit is beside its entrance.
    #[test]
    fn mines_decide_at_strands_and_in_pouches() {
        let share = |name: &str, kept| {
            let ways = arrivals(&shipped::named(name).unwrap().unwrap(), kept, Effort::Quick).unwrap();
            ways.iter().flatten().count() as f64 / ways.len() as f64
        };
        assert_eq!([share("bridge", 0), share("bridge", 12)], [0.0, 1.0]);
        assert_eq!([share("pocket", 0), share("pocket", 12), share("pocket", 50)], [0.0, 0.0, 1.0]);
    }
}
