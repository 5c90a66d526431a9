//! How many mines, how far apart, how far they reach: who arrives.

use crate::app::Scene;
use crate::dynamics::mines::MineSettings;
use crate::error::Result;
use crate::progress::Progress;
use crate::report::mean;
use crate::report::table::{Cell, Table};
use crate::report::trials::{self, Course};

/// What is changed, one at a time from the defaults.
const KEPT: [usize; 7] = [0, 1, 4, 8, 12, 50, 1000];
const SPACING_MM: [f64; 6] = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0];
const REACH_MM: [f64; 6] = [5.0, 10.0, 15.0, 25.0, 50.0, 100.0];
/// Simulated seconds of a flight at the most.
const SECONDS: f64 = 120.0;

/// What one choice of mines brings.
#[derive(Clone, Debug, PartialEq)]
pub struct Laid {
    /// Which.
    pub settings: MineSettings,
    /// What of it is not the default.
    pub changed: &'static str,
    /// Share of the flights that arrive.
    pub arrived: f64,
    /// Mean number of places at which a flight looked for another way.
    pub escapes: f64,
    /// Mean time of those that arrive, s.
    pub seconds: f64,
}

/// Flies the courses with each choice.
///
/// # Errors
/// Status 4 when interrupted.
pub fn study(courses: &[Course], progress: &Progress) -> Result<Vec<Laid>> {
    let d = MineSettings::default();
    let choices: Vec<(&str, MineSettings)> = (KEPT.map(|kept| ("number", MineSettings { kept, ..d })).into_iter())
        .chain(SPACING_MM.map(|spacing_mm| ("spacing", MineSettings { spacing_mm, ..d })))
        .chain(REACH_MM.map(|reach_mm| ("reach", MineSettings { reach_mm, ..d })))
        .collect();
    progress.stage("mines", choices.len() as u64);
    let measure = |(changed, settings): (&'static str, MineSettings)| {
        let scene = Scene { mines: Some(settings), ..Scene::default() };
        let flown = courses.iter().map(|c| trials::fly(c, &scene, SECONDS)).collect::<Result<Vec<_>>>()?;
        progress.advance(1)?;
        let arrived: Vec<f64> = flown.iter().filter(|t| t.arrived()).map(|t| t.seconds).collect();
        Ok(Laid {
            settings,
            changed,
            arrived: arrived.len() as f64 / flown.len() as f64,
            escapes: mean(&flown.iter().map(|t| f64::from(t.escapes)).collect::<Vec<_>>()),
            seconds: mean(&arrived),
        })
    };
    choices.into_iter().map(measure).collect()
}

/// As a table.
pub fn table(laid: &[Laid]) -> Table {
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
