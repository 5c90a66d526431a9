//! Errors in position and orientation against a reference solution, over time and over evaluations, and the measured order.

use std::time::Instant;

use glam::DVec3;

use super::Subject;
use super::contenders::{ADAPTIVE, FIXED, label};
use super::reference;
use super::tube::{RemainingLength, Tube};
use crate::dynamics::integrators::{Control, StepCost, Stepper};
use crate::dynamics::rigid::{RigidBodyState, Turning, angle, orientation};
use crate::dynamics::step::integrate;
use crate::dynamics::{Attitude, Body, Integrator, Potential, PotentialForce, STEP_HZ, STEP_S};
use crate::error::Result;
use crate::progress::Progress;
use crate::report::Effort;
use crate::report::page::Page;
use crate::report::plot::{Plot, Point, Series};
use crate::report::table::{Table, row, table};

/// Duration of the flight, s.
pub const SECONDS: f64 = 2.0;
/// Outer step of the adaptive methods, s.
const OUTER: f64 = 0.25;
/// Errors below these, mm and rad, may be those of the reference.
const FLOOR: [f64; 2] = [2.0 * reference::ACCURACY[0], reference::ACCURACY[1]];
/// Errors above this, mm or rad, do not indicate the order.
const CEILING: f64 = 0.2;

/// A measured flight.
#[derive(Debug)]
pub struct Case {
    /// The name in the report.
    pub name: &'static str,
    /// The potential's energy at the wall.
    pub wall_energy: f64,
}

/// The measured flights.
pub const CASES: [Case; 3] = [
    Case { name: "soft wall", wall_energy: 100.0 },
    Case { name: "middle wall", wall_energy: 1e4 },
    Case { name: "stiff wall", wall_energy: 1e6 },
];
/// The case whose orders are compared with theory. It is neither so soft that a few steps are exact to the last digit, nor so
/// stiff that low orders never reach their asymptotic regime.
const MIDDLE: usize = 1;

/// The tube of all flights. Its kink is rounded over a voxel.
pub(super) const TUBE: Tube = Tube { radius: 15.0, bend: 50.0, rounding: 0.7 };
/// The remaining path length in it.
pub(super) const WAY: RemainingLength = RemainingLength { tube: TUBE, end: 3.0 };

/// Returns the force of a case. Its reach spans the tube, so that all derivatives exist everywhere on the path.
pub fn forces(wall_energy: f64) -> PotentialForce<'static> {
    let potential = Potential { wall_energy, reach_mm: 20.0, ..Potential::default() };
    PotentialForce { potential, wall: Some(&TUBE), target: Some(&WAY), push: DVec3::ZERO }
}

/// Returns the initial state of the flights: off the axis, moving, and slowly tumbling.
pub fn start(body: &Body) -> RigidBodyState {
    let position = TUBE.place(0.0, 1.0, -0.6);
    let q = orientation(Attitude::new(DVec3::Z, DVec3::Y));
    let angular = body.inertia().momentum(DVec3::new(0.5, -0.4, 1.2), q * DVec3::Z);
    RigidBodyState { position, momentum: DVec3::new(-2.0, 3.0, 20.0) * body.mass_g, orientation: q, angular }
}

/// Returns the rotation of the view during the flights. It is large enough to be far from linear, otherwise high orders would not
/// be visible.
pub fn turning() -> Turning {
    Turning::towards(DVec3::new(0.5, 0.3, -0.8), 0.45, 1.8)
}

/// A measured quantity of a flight.
type Number = fn(&Run) -> f64;

/// One flight by one method.
struct Run {
    case: usize,
    method: &'static str,
    adaptive: bool,
    /// Step, s, or tolerance.
    setting: f64,
    position: f64,
    orientation: f64,
    microseconds: f64,
    rates: f64,
    cut_short: bool,
}

/// Runs the study.
pub(crate) fn study(subject: &Subject, page: &mut Page, progress: &Progress) -> Result<Vec<String>> {
    let effort = subject.effort;
    let body = Body::default();
    let (begun, turn) = (start(&body), turning());
    let mut runs = Vec::new();
    for (number, case) in CASES.iter().enumerate() {
        let force = forces(case.wall_energy);
        let truth = reference::solve(&body, &begun, &force, &turn, SECONDS);
        progress.check()?;
        let doublings = effort.choose(8, 11);
        for (name, method) in FIXED {
            for k in 0..doublings {
                let steps = 30u32 << k;
                let run = measure(number, method, SECONDS / f64::from(steps), steps, &truth, effort);
                runs.push(Run { method: name, ..run });
            }
            progress.check()?;
        }
        for (name, make) in ADAPTIVE {
            for k in 1..effort.choose(7, 10) {
                let tolerance = 10f64.powi(-k);
                let method = make(Control { tolerance, most_parts: 100_000 });
                let run = measure(number, &*method, OUTER, (SECONDS / OUTER) as u32, &truth, effort);
                runs.push(Run { method: name, adaptive: true, setting: tolerance, ..run });
            }
            progress.check()?;
        }
    }
    write(&runs, page)
}

fn measure(case: usize, method: &dyn Stepper, h: f64, steps: u32, truth: &RigidBodyState, effort: Effort) -> Run {
    let body = Body::default();
    let (force, turn) = (forces(CASES[case].wall_energy), turning());
    let mut times = Vec::new();
    let mut end = start(&body);
    let mut cost = StepCost::default();
    for _ in 0..effort.choose(2, 3) {
        let begun = Instant::now();
        (end, cost) = (start(&body), StepCost::default());
        for _ in 0..steps {
            let (next, took) = integrate(method, &body, &end, &force, &turn, h);
            end = next;
            cost.add(took);
        }
        times.push(begun.elapsed().as_secs_f64() * 1e6);
    }
    let [position, orientation] = errors(&end, truth);
    Run {
        case,
        method: "",
        adaptive: false,
        setting: h,
        position,
        orientation,
        microseconds: times.iter().copied().fold(f64::INFINITY, f64::min),
        rates: f64::from(cost.rates + cost.jacobians),
        cut_short: cost.cut_short,
    }
}

/// Returns the distance in mm and the angle in rad.
pub fn errors(a: &RigidBodyState, b: &RigidBodyState) -> [f64; 2] {
    [a.position.distance(b.position), angle(a.orientation, b.orientation)]
}

/// Returns the order measured between successive halvings, from the finest pair that the reference resolves.
fn measured_order(runs: &[&Run], floor: f64, error: impl Fn(&Run) -> f64) -> Option<f64> {
    let pairs = runs.windows(2).rev();
    let resolved = |r: &Run| error(r) > floor && error(r) < CEILING;
    pairs.filter(|p| resolved(p[0]) && resolved(p[1])).map(|p| (error(p[0]) / error(p[1])).log2()).next()
}

/// Writes plots and tables. Returns the findings.
fn write(runs: &[Run], page: &mut Page) -> Result<Vec<String>> {
    let [mm, rad] = reference::ACCURACY;
    page.text(&format!(
        "Flights of {SECONDS} s in a bent tube of radius {} mm, the kink of D_s rounded over {} mm. The reference is the \
         fifth order of Dormand and Prince in {} steps a second. The program's tests hold it to {mm:.0e} mm and {rad:.0e} \
         rad against diffsol's Tsitouras 5(4) at a tolerance of 1e-13 in other coordinates (the quaternion itself), and \
         to 2e-9 mm against its BDF at 1e-11. Evaluations are those of forces, torques and their derivatives.",
        TUBE.radius,
        TUBE.rounding,
        reference::STEPS_PER_SECOND
    ));
    for (number, case) in CASES.iter().enumerate() {
        plot(runs, number, case, page)?;
    }
    let orders = write_orders(runs, page)?;
    write_runs(runs, page)?;
    Ok(std::iter::once(orders).chain(default_finding(runs)).collect())
}

/// Writes the plots of one case: errors over time and over evaluations.
fn plot(runs: &[Run], number: usize, case: &Case, page: &mut Page) -> Result<()> {
    const TIME: &str = "time of the flight / µs";
    const POSITION: &str = "error in position / mm";
    const ORIENTATION: &str = "error in orientation / rad";
    let kinds: [(&str, &str, &str, Number, Number); 3] = [
        ("position-time", TIME, POSITION, |r| r.microseconds, |r| r.position),
        ("orientation-time", TIME, ORIENTATION, |r| r.microseconds, |r| r.orientation),
        ("position-evaluations", "evaluations", POSITION, |r| r.rates, |r| r.position),
    ];
    let names: Vec<&'static str> = FIXED.iter().map(|f| f.0).chain(ADAPTIVE.iter().map(|a| a.0)).collect();
    for (file, x, y, across, up) in kinds {
        let series = names.iter().map(|&name| {
            let shown = runs.iter().filter(|r| r.case == number && r.method == name && up(r) < 1e3).enumerate();
            // Only every fourth point has a label, as more labels would overlap.
            let label = |n: usize, r: &Run| if n.is_multiple_of(4) { setting(r) } else { String::new() };
            Series::line(name, shown.map(|(n, r)| Point { x: across(r), y: up(r).max(1e-12), name: label(n, r) }))
        });
        let title = format!("{}: {y} over {x}", case.name);
        let plot = Plot { front: true, ..Plot::new(title, x, y, series.collect()) };
        let file = format!("{}-{file}", case.name.replace(' ', "-"));
        page.plot(&file, &plot, "Labels give the step or tolerance; the grey band marks the Pareto front.")?;
    }
    Ok(())
}

/// Writes the table of measured orders. Returns their deviation from theory.
fn write_orders(runs: &[Run], page: &mut Page) -> Result<String> {
    let mut t = Table::new(&["wall", "method", "theory", "order in position", "order in orientation"]);
    let mut worst = (0.0f64, String::new());
    let mut orders = 0;
    for (name, method) in FIXED {
        let mine: Vec<&Run> = runs.iter().filter(|r| r.case == MIDDLE && r.method == name).collect();
        let seen =
            [measured_order(&mine, FLOOR[0], |r| r.position), measured_order(&mine, FLOOR[1], |r| r.orientation)];
        for (what, order) in ["position", "orientation"].into_iter().zip(seen) {
            let Some(order) = order else { continue };
            let off = (order - f64::from(method.order())).abs();
            orders += 1;
            if off >= worst.0 {
                worst = (off, format!("{name} in {what}, {order:.2}"));
            }
        }
        t.row(row![CASES[MIDDLE].name, name, (f64::from(method.order()), 0), (seen[0], 2), (seen[1], 2)]);
    }
    page.table("orders", &t)?;
    Ok(format!(
        "{orders} measured orders of {} methods are within {:.2} of theory (the furthest is {}).",
        FIXED.len(),
        worst.0,
        worst.1
    ))
}

/// Writes the table of all flights.
fn write_runs(runs: &[Run], page: &mut Page) -> Result<()> {
    let t = table!(for r in runs;
        "wall" => CASES[r.case].name,
        "method" => r.method,
        "step / s or tolerance" => (r.setting, 6),
        "error in position / mm" => (r.position, 10),
        "error in orientation / rad" => (r.orientation, 10),
        "time / µs" => (r.microseconds, 1),
        "evaluations" => (r.rates, 0),
        "bound reached" => r.cut_short,
    );
    page.table("precision", &t)
}

/// Summarises the error and time of each method at a flight's step, and the reason for the default.
fn default_finding(runs: &[Run]) -> Vec<String> {
    let near = |r: &Run| (r.setting / STEP_S).ln().abs();
    let at = |case: usize, name: &str| {
        let mine = runs.iter().filter(|r| r.case == case && r.method == name && !r.adaptive);
        mine.min_by(|a, b| near(a).total_cmp(&near(b)))
    };
    let each = FIXED.iter().filter_map(|(name, _)| Some((*name, [at(0, name)?, at(1, name)?, at(2, name)?])));
    let micro = |r: &Run| r.microseconds * r.setting / SECONDS;
    let error = |r: &Run| if r.position < 1e3 { format!("{:.0e}", r.position) } else { "unstable".to_owned() };
    let reported: Vec<String> = each
        .clone()
        .map(|(name, r)| {
            format!("{name} {}, {}, {} mm in {:.1} µs", error(r[0]), error(r[1]), error(r[2]), micro(r[0]))
        })
        .collect();
    let default = Integrator::default();
    let mine = each.clone().find(|(name, _)| *name == label(default));
    let euler = each.clone().find(|(name, _)| *name == label(Integrator::BackwardEuler));
    let mut findings = vec![format!(
        "At the flight's step of 1/{STEP_HZ} s, against a soft, middle and stiff wall: {}.",
        reported.join("; ")
    )];
    if let (Some((name, mine)), Some((other, euler))) = (mine, euler) {
        findings.push(format!(
            "The default is {name}: it is linearly implicit, stable at every step tried however stiff the wall, has no iteration that could fail, and takes {:.1} µs a step. At 1/{STEP_HZ} s its error is {} mm; that of {other}, which only damps harder, is {}. No explicit method is stable for every wall.",
            micro(mine[0]),
            error(mine[1]),
            error(euler[1]),
        ));
    }
    findings
}

fn setting(r: &Run) -> String {
    if r.adaptive { format!("{:.0e}", r.setting) } else { format!("{:.1} ms", r.setting * 1e3) }
}
