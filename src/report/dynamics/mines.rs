//! How the number of mines, their spacing and their reach change which flights arrive.

use crate::app::Scene;
use crate::dynamics::mines::MineSettings;
use crate::error::Result;
use crate::progress::Progress;
use crate::report::page::Page;
use crate::report::table::{Cell, Table};
use crate::report::trials::{self, Course};
use crate::report::{Effort, mean};

/// The settings that are tried, one change at a time from the defaults.
const KEPT: [usize; 7] = [0, 1, 4, 8, 12, 50, 1000];
const SPACING_MM: [f64; 6] = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0];
const REACH_MM: [f64; 6] = [5.0, 10.0, 15.0, 25.0, 50.0, 100.0];
/// Simulated seconds of a flight at the most.
const SECONDS: f64 = 120.0;

/// The results of one choice of mines.
#[derive(Clone, Debug, PartialEq)]
struct Laid {
    /// The choice.
    settings: MineSettings,
    /// Which setting differs from the default.
    changed: &'static str,
    /// Share of the flights that arrive.
    arrived: f64,
    /// Mean number of places at which a flight looked for another way.
    escapes: f64,
    /// Mean time of those that arrive, s.
    seconds: f64,
}

/// The study.
///
/// # Errors
/// Those of the whole report.
pub fn study(effort: Effort, page: &mut Page, progress: &Progress) -> Result<Vec<String>> {
    let courses = trials::small_phantoms(effort, progress)?;
    let laid = measure(&courses, effort, progress)?;
    let d = MineSettings::default();
    page.text(&format!(
        "The same {} phantoms with other mines, one thing changed at a time from the default: {} mines, {} mm apart, that reach \
         {} mm. A flight without mines still keeps to its heading; what mines add is that it does not turn back where the lumen \
         looks shorter ahead than behind.",
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
    Ok(vec![format!(
        "Every flight arrives with {} mines kept, with {} mm between them, and with a reach of {} mm.",
        good("number", &|s| s.kept as f64),
        good("spacing", &|s| s.spacing_mm),
        good("reach", &|s| s.reach_mm)
    )])
}

/// Flies the courses with each choice, for a quick report with every third.
fn measure(courses: &[Course], effort: Effort, progress: &Progress) -> Result<Vec<Laid>> {
    let d = MineSettings::default();
    let choices: Vec<(&str, MineSettings)> = (KEPT.map(|kept| ("number", MineSettings { kept, ..d })).into_iter())
        .chain(SPACING_MM.map(|spacing_mm| ("spacing", MineSettings { spacing_mm, ..d })))
        .chain(REACH_MM.map(|reach_mm| ("reach", MineSettings { reach_mm, ..d })))
        .collect();
    let measure = |(changed, settings): (&'static str, MineSettings)| {
        let scene = Scene { mines: Some(settings), ..Scene::default() };
        let flown = courses.iter().map(|c| trials::fly(c, &scene, SECONDS)).collect::<Result<Vec<_>>>()?;
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
        .into_iter()
        .enumerate()
        .filter(|(n, _)| effort == Effort::Full || n % 3 == 0)
        .map(|c| measure(c.1))
        .collect()
}

/// The results as a table.
fn table(laid: &[Laid]) -> Table {
    let mut table = Table::new(&[
        "changed",
        "mines kept",
        "spacing (mm)",
        "reach (mm)",
        "flights that arrive (%)",
        "other ways looked for",
        "time of those (s)",
    ]);
    for l in laid {
        table.row(vec![
            l.changed.into(),
            Cell::Number(l.settings.kept as f64, 0),
            Cell::Number(l.settings.spacing_mm, 0),
            Cell::Number(l.settings.reach_mm, 0),
            Cell::Number(100.0 * l.arrived, 0),
            Cell::Number(l.escapes, 1),
            if l.seconds.is_nan() { Cell::None } else { Cell::Number(l.seconds, 1) },
        ]);
    }
    table
}
