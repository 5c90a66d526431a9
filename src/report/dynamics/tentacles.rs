//! The number of tentacles required: sensed against exact clearance, flights that arrive, and the time of a step.

use glam::DVec3;

use super::Subject;
use crate::app::Scene;
use crate::dynamics::tentacles::{TentacleSettings, directions};
use crate::error::Result;
use crate::fields::ClearanceFinder;
use crate::math::hash;
use crate::progress::Progress;
use crate::report::page::Page;
use crate::report::plot::{Plot, Point, Series};
use crate::report::table::{Table, known, table};
use crate::report::trials::{self, Course};
use crate::report::{Effort, mean, median, quantile};
use crate::space::first_crossing;

/// Numbers of tentacles, in a full and in a quick report.
const COUNTS: [usize; 11] = [3, 4, 6, 8, 16, 32, 64, 128, 256, 512, 1024];
const QUICK: [usize; 5] = [3, 8, 32, 128, 1024];
/// Number of sample points on each course.
const PLACES: u64 = 200;
/// Search radius of exact clearances, mm. It exceeds any half width of the lumen.
const EXACT_MM: f64 = 40.0;
/// Maximum duration of a flight in a quick and in a full report, simulated seconds. No flight of a quick report arrives later.
const SECONDS: [f64; 2] = [60.0, 120.0];

/// Results for one number of tentacles.
#[derive(Clone, Debug, PartialEq)]
struct Sensed {
    /// Number of tentacles.
    count: usize,
    /// Sensed minus exact distance to the wall, mm: median and 95th percentile. Never negative, since a ray cannot be shorter.
    error_mm: (f64, f64),
    /// Angle between the shortest tentacle and the direction to the nearest wall, degrees: median.
    angle_degrees: f64,
    /// Share of the flights that arrive.
    arrived: f64,
    /// Mean distance of the arriving flights from the centerline, as a share of the local radius.
    offset: f64,
    /// Wall-clock time of a step, µs.
    step_us: f64,
}

/// Runs the study.
pub(crate) fn study(subject: &Subject, page: &mut Page, progress: &Progress) -> Result<Vec<String>> {
    let effort = subject.effort;
    let courses = trials::small_phantoms(effort, progress)?;
    let sensed = measure(&courses, effort, progress)?;
    page.text(&format!(
        "Flights through small phantoms ({}; with folds, polyps and noise) by number of tentacles, and the shortest tentacle at places throughout the lumen compared with the exact clearance: D_s is never sensed too short, and its error falls with the \
         angle between two tentacles. A step is the whole simulation step, including the exact clearances of the body.",
        courses.len()
    ));
    page.table("tentacles", &table(&sensed))?;
    page.plot("tentacles-error", &plot(&sensed), "A point is a number of tentacles.")?;
    let least = sensed.iter().rev().take_while(|s| s.arrived >= 1.0).last();
    let default = TentacleSettings::default().count;
    let at = sensed.iter().find(|s| s.count == default);
    let reported = |s: &Sensed| {
        let (median, most) = s.error_mm;
        format!("{} sense D_s {median:.2} mm too long (95 %: {most:.2} mm), {:.0}° off", s.count, s.angle_degrees)
    };
    let needed = least.map_or_else(
        || "With no tested number of tentacles does every flight arrive.".to_owned(),
        |s| format!("With {} tentacles or more, every flight arrives.", s.count),
    );
    Ok(vec![at.map_or_else(|| needed.clone(), |s| format!("{needed} The default's {}.", reported(s)))])
}

/// Measures [`COUNTS`] tentacles ([`QUICK`] in a quick report) on phantoms, at points drawn around the true centerline.
fn measure(courses: &[Course], effort: Effort, progress: &Progress) -> Result<Vec<Sensed>> {
    let seconds = effort.choose(SECONDS[0], SECONDS[1]);
    let measure = |&count: &usize| {
        let (mut errors, mut angles) = (Vec::new(), Vec::new());
        for course in courses {
            sense(course, count, &mut errors, &mut angles);
        }
        let mut scene = Scene::default();
        scene.guides.edit::<TentacleSettings>(|t| t.count = count);
        let flown = courses.iter().map(|c| trials::fly(c, &scene, seconds)).collect::<Result<Vec<_>>>()?;
        let arrived: Vec<_> = flown.iter().filter(|t| t.arrived()).collect();
        progress.check()?;
        Ok(Sensed {
            count,
            error_mm: (median(&errors), quantile(&errors, 0.95)),
            angle_degrees: median(&angles),
            arrived: arrived.len() as f64 / flown.len() as f64,
            offset: mean(&arrived.iter().filter_map(|t| t.offset).collect::<Vec<_>>()),
            step_us: median(&flown.iter().map(|t| t.step_us).collect::<Vec<_>>()),
        })
    };
    COUNTS.iter().filter(|c| effort == Effort::Full || QUICK.contains(c)).map(measure).collect()
}

/// Compares the distances sensed by tentacles with the exact clearance at points around the centerline.
fn sense(course: &Course, count: usize, errors: &mut Vec<f64>, angles: &mut Vec<f64>) {
    let Some(truth) = &course.truth else { return };
    let finder = ClearanceFinder::new(course.volume.shared_voxels(), course.volume.transfer().iso() as f32, EXACT_MM);
    let all = directions(count);
    let reach = TentacleSettings::default().reach_mm;
    for n in 0..PLACES {
        let u = |k| hash::uniform(17, 8 * n + k);
        let i = ((u(0) * truth.centerline.len() as f64) as usize).min(truth.centerline.len() - 1);
        let aside = DVec3::new(u(1), u(2), u(3)) * 2.0 - 1.0;
        let at = truth.centerline[i] + aside * (0.6 * truth.radius_mm[i]);
        let exact = finder.at(at);
        if exact.mm < 1.0 || exact.toward == DVec3::ZERO {
            continue;
        }
        let felt = all.iter().map(|&d| (first_crossing(&course.volume, at, d, reach).unwrap_or(reach), d));
        if let Some((length, d)) = felt.min_by(|a, b| a.0.total_cmp(&b.0)) {
            errors.push(length - exact.mm);
            angles.push(d.angle_between(exact.toward).to_degrees());
        }
    }
}

/// Formats the results as a table.
fn table(sensed: &[Sensed]) -> Table {
    table!(for s in sensed;
        "tentacles" => s.count,
        "error of D_s, median (mm)" => (s.error_mm.0, 2),
        "error of D_s, 95 % (mm)" => (s.error_mm.1, 2),
        "error of its direction, median (degrees)" => (s.angle_degrees, 1),
        "flights that arrive (%)" => (100.0 * s.arrived, 0),
        "offset from the centerline (of the radius)" => known(s.offset, 3),
        "a step (µs)" => (s.step_us, 0),
    )
}

/// Plots the error of the sensed distance against the time of a step.
fn plot(sensed: &[Sensed]) -> Plot {
    let series = |name: &str, value: &dyn Fn(&Sensed) -> f64| {
        Series::line(name, sensed.iter().map(|s| Point { name: s.count.to_string(), x: s.step_us, y: value(s) }))
    };
    let both = vec![series("median", &|s| s.error_mm.0), series("95 %", &|s| s.error_mm.1)];
    Plot::new("Tentacles: error of the sensed distance", "a step (µs)", "error of D_s (mm)", both)
}
