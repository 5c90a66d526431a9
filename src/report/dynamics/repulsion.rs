//! How far repulsion alone takes a flight (paper, section 3.2), compared with the default and with the default without mines.

use glam::DVec3;
use rayon::prelude::*;

use super::Subject;
use crate::app::Scene;
use crate::dynamics::mines::MineSettings;
use crate::dynamics::tentacles::TentacleSettings;
use crate::error::Result;
use crate::fields::{Distance, TargetDistance};
use crate::phantom::{PhantomSettings, Size};
use crate::plane::drawing::Drawing;
use crate::plane::shipped::DRAWINGS;
use crate::progress::Progress;
use crate::report::page::Page;
use crate::report::table::{Table, table};
use crate::report::trials::{self, Course, Trial};
use crate::report::{Effort, mean};

/// The shipped scene that is flown.
const PAPER: &str = include_str!("../../../assets/scenes/paper.toml");
/// Maximum duration of a flight, simulated seconds. The paper's scene is slow in wide places.
const SECONDS: f64 = 300.0;
/// Drawings in a quick report.
const QUICK: [&str; 3] = ["bends", "bridge", "pocket"];

/// Flights through one course.
struct Flown {
    kind: &'static str,
    course: String,
    scene: &'static str,
    /// The furthest progress, as a share of the path to the goal along the lumen.
    reached: f64,
    trial: Trial,
}

/// Runs the study.
pub(crate) fn study(subject: &Subject, page: &mut Page, progress: &Progress) -> Result<Vec<String>> {
    let paper = Scene::parse(PAPER, &crate::app::Catalog::default())?;
    let (t, m) = (paper.guides.get::<TentacleSettings>(), paper.mines.unwrap_or_default());
    let d = MineSettings::default();
    page.text(&format!(
        "\"Repulsion alone\" is the scene assets/scenes/paper.toml: no thrust, no cruise speed, no attraction by a visible goal. The wall \
         repels within {} mm with {} mm/s² (C_s = {} mm²/s²), as sensed by {} tentacles, and the last {} mines, {} mm apart, push \
         with {} mm/s² each, within {} mm. Drag alone limits the speed. The default thrusts along the direction that its tentacles find open and keeps {} mines; the third is the same without mines. The watch is on in all three: in a trap it sends the camera another way; where mines drive, it does so with one more mine behind the camera. \"Reached\" is the farthest place, as a share of the length along the lumen. Drawings are flown in three dimensions, 18 mm high.",
        t.wall_mm,
        t.wall_push,
        t.wall_push * t.wall_mm,
        t.count,
        m.kept,
        m.spacing_mm,
        m.push,
        m.reach_mm,
        d.kept
    ));
    let scenes = [
        ("repulsion alone", paper),
        ("default", Scene::default()),
        ("default, no mines", Scene { mines: None, ..Scene::default() }),
    ];
    let mut all = Vec::new();
    for (kind, name, course) in courses(subject, progress)? {
        let to_goal = course.to_goal(progress)?;
        let flown = scenes.par_iter().map(|(scene_name, scene)| {
            let trial = trials::fly(&course, scene, SECONDS)?;
            let reached = reached(&trial, course.plan.start, &to_goal);
            progress.check()?;
            Ok(Flown { kind, course: name.clone(), scene: scene_name, reached, trial })
        });
        all.extend(flown.collect::<Result<Vec<_>>>()?);
    }
    page.table("repulsion", &table(&all))?;
    let kinds = ["phantoms", "scan", "drawings"];
    Ok(kinds.iter().filter_map(|kind| finding(kind, &all, &scenes.each_ref().map(|s| s.0))).collect())
}

/// Returns the courses: small phantoms, one of full size and the scan, each in both directions, and the drawings.
fn courses(subject: &Subject, progress: &Progress) -> Result<Vec<(&'static str, String, Course)>> {
    let mut there = Vec::new();
    for (n, course) in trials::small_phantoms(subject.effort, progress)?.into_iter().enumerate() {
        there.push(("phantoms", format!("small phantom {}", n + 1), course));
    }
    if subject.effort == Effort::Full {
        let settings = PhantomSettings { size: Size::Standard, ..PhantomSettings::default() };
        there.push(("phantoms", "standard phantom".to_owned(), Course::phantom(&settings, progress)?));
    }
    if let Some((title, volume)) = &subject.scan {
        there.push(("scan", title.clone(), Course::new(volume.clone(), None, progress)?));
    }
    let mut all = Vec::new();
    for (kind, name, course) in there {
        let back = course.reversed(progress)?;
        all.push((kind, name.clone(), course));
        all.push((kind, format!("{name}, back"), back));
    }
    let drawn = |name: &&str| subject.effort == Effort::Full || QUICK.contains(name);
    for (name, png) in DRAWINGS.iter().filter(|d| drawn(&d.0)) {
        all.push(("drawings", (*name).to_owned(), Course::drawn(&Drawing::decode(name, png)?, progress)?));
    }
    Ok(all)
}

/// Returns the furthest progress of a flight, as a share of the path from its start.
fn reached(trial: &Trial, start: DVec3, to_goal: &TargetDistance) -> f64 {
    let left = |p: DVec3| to_goal.sample(p).map_or(f64::INFINITY, |s| s.mm);
    let least = trial.places.iter().map(|p| left(*p)).fold(f64::INFINITY, f64::min);
    if trial.arrived() { 1.0 } else { (1.0 - least / left(start)).clamp(0.0, 1.0) }
}

fn table(all: &[Flown]) -> Table {
    let ends = |t: &Trial| match t.arrived() {
        true => "arrives".to_owned(),
        false if t.reason.is_empty() => "time is over".to_owned(),
        false => t.reason.clone(),
    };
    table!(for f in all;
        let t = &f.trial;
        "course" => &f.course,
        "scene" => f.scene,
        "reached (%)" => (100.0 * f.reached, 0),
        "ends" => ends(t),
        "time (s)" => (t.seconds, 1),
        "flown (mm)" => (t.length_mm, 0),
        "searches for another direction" => t.escapes as usize,
        "least clearance (mm)" => (t.clearance_mm.0, 1),
        "mean clearance (mm)" => (t.clearance_mm.1, 1),
        "offset from the centerline (of the radius)" => (t.offset, 3),
        "jerk (mm/s³)" => (t.jerk, 0),
    )
}

/// Summarises the flights of one kind; `None` if there are none.
fn finding(kind: &str, all: &[Flown], scenes: &[&str]) -> Option<String> {
    let reported = |scene: &&str| {
        let of: Vec<&Flown> = all.iter().filter(|f| f.kind == kind && f.scene == *scene).collect();
        let arrived = of.iter().filter(|f| f.trial.arrived()).count();
        let reached = mean(&of.iter().map(|f| 100.0 * f.reached).collect::<Vec<_>>());
        format!("{scene} {arrived} of {} arrive, {reached:.0} % of the path reached", of.len())
    };
    let any = all.iter().any(|f| f.kind == kind);
    any.then(|| format!("Flights of {kind}: {}.", scenes.iter().map(reported).collect::<Vec<_>>().join("; ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Repulsion alone flies a phantom to its end. Without mines nothing moves.
    #[test]
    #[ignore = "slow: a flight by repulsion alone, 120 s"]
    fn repulsion_alone_flies_a_phantom() {
        let progress = Progress::new();
        let settings = PhantomSettings { size: Size::Small, seed: 2, ..PhantomSettings::default() };
        let course = Course::phantom(&settings, &progress).unwrap();
        let paper = Scene::parse(PAPER, &crate::app::Catalog::default()).unwrap();
        let trial = trials::fly(&course, &paper, 120.0).unwrap();
        assert!(trial.arrived(), "{}", trial.reason);
        let to_goal = course.to_goal(&progress).unwrap();
        assert_eq!(reached(&trial, course.plan.start, &to_goal), 1.0);
        // Mines without push provide no propulsion.
        let idle = Scene { mines: paper.mines.map(|m| MineSettings { push: 0.0, ..m }), watch: None, ..paper };
        let trial = trials::fly(&course, &idle, 10.0).unwrap();
        assert!(reached(&trial, course.plan.start, &to_goal) < 0.05, "the wall alone moves nothing far");
    }
}
