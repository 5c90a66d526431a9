//! The largest stable step without the clamp to free space, for stiffer walls and for a camera nearer to the wall.

use glam::DVec3;
use rayon::prelude::*;

use super::Subject;
use super::contenders::FIXED;
use super::precision::{TUBE, forces};
use crate::dynamics::integrators::Stepper;
use crate::dynamics::rigid::RigidBodyState;
use crate::dynamics::step::translate;
use crate::dynamics::{Attitude, Body, Forces, PotentialForce};
use crate::error::Result;
use crate::progress::Progress;
use crate::report::page::Page;
use crate::report::plot::{Plot, Point, Series};
use crate::report::table::{Cell, Table};

/// Longest tested step, s.
const LONGEST: f64 = 10.0;
/// Number of halvings tested.
const HALVINGS: i32 = 34;
/// Growth of a deviation above which a step counts as unstable.
const GROWN: f64 = 1.5;

/// Runs the study.
pub(crate) fn study(subject: &Subject, page: &mut Page, progress: &Progress) -> Result<Vec<String>> {
    let effort = subject.effort;
    let steps = effort.choose(150, 500);
    page.text(&format!(
        "A body in equilibrium is displaced slightly. The step counts as stable if the deviation never grows more than {GROWN} times in {steps} steps. Only the potential keeps it from the wall. Steps up to {LONGEST} s are tried in factors of two; implicit methods that reach the maximum are stable at every step."
    ));
    let constants: Vec<f64> = (-3..=9).map(|d| 10f64.powi(d)).collect();
    let stiff = map(&constants, steps, |&c_s| {
        let f = forces(c_s);
        (PotentialForce { target: None, ..f }, TUBE.place(0.0, 0.0, 0.0), 0.05)
    });
    progress.check()?;
    draw(
        page,
        "stable-step-by-wall",
        "Largest stable step on the axis",
        "wall constant C_s / g·mm²/s²",
        &constants,
        &stiff,
    )?;
    let clearances: Vec<f64> =
        (0..=effort.choose(6, 12)).map(|k| 5.0 * 10f64.powf(-3.25 * f64::from(k) / effort.choose(6.0, 12.0))).collect();
    let near = map(&clearances, steps, |&c| {
        let wall = PotentialForce { target: None, ..forces(100.0) };
        // At the outer side of the bend, where the wall is concave in both directions.
        let at = TUBE.place(0.0, TUBE.radius - c, 0.0);
        (PotentialForce { push: -wall.force(at), ..wall }, at, 0.01 * c)
    });
    draw(
        page,
        "stable-step-by-clearance",
        "Largest stable step, pushed towards the wall",
        "clearance / mm",
        &clearances,
        &near,
    )?;
    let always = |m: &[Vec<f64>], n: usize| m[n].iter().all(|&h| h >= LONGEST);
    let stable = (0..FIXED.len()).filter(|&n| always(&stiff, n) && always(&near, n)).map(|n| FIXED[n].0);
    let explicit: Vec<String> = (0..FIXED.len())
        .filter(|&n| !always(&stiff, n) || !always(&near, n))
        .map(|n| {
            format!(
                "{} {:.0e} s and {:.0e} s",
                FIXED[n].0,
                stiff[n][constants.len() - 1],
                near[n][clearances.len() - 1]
            )
        })
        .collect();
    Ok(vec![format!(
        "Stable at every step tried, up to {LONGEST} s, as C_s grows over twelve orders of magnitude to 1e9 and as the \
         clearance falls to {:.0e} mm: {}. The others end at (stiffest wall, least clearance): {}.",
        clearances[clearances.len() - 1],
        stable.collect::<Vec<_>>().join(", "),
        explicit.join("; ")
    )])
}

/// Returns the largest stable step, s, for each method and each value of a parameter; 0 if no step is stable.
fn map<F>(values: &[f64], steps: u32, case: F) -> Vec<Vec<f64>>
where
    F: Fn(&f64) -> (PotentialForce<'static>, DVec3, f64) + Sync,
{
    let each = |method: &dyn Stepper| -> Vec<f64> {
        values
            .par_iter()
            .map(|value| {
                let (force, at, deviation) = case(value);
                let stable = |h: f64| is_stable(method, &force, at, deviation, h, steps);
                // From short to long, up to the first unstable step.
                let all = (0..=HALVINGS).rev().map(|k| LONGEST * 0.5f64.powi(k));
                all.take_while(|&h| stable(h)).last().unwrap_or(0.0)
            })
            .collect()
    };
    FIXED.iter().map(|(_, method)| each(*method)).collect()
}

fn is_stable(method: &dyn Stepper, force: &dyn Forces, at: DVec3, deviation: f64, h: f64, steps: u32) -> bool {
    let body = Body::default();
    let moved = at + DVec3::new(-1.0, 0.4, 0.0).normalize() * deviation;
    let mut m = RigidBodyState::at_rest(moved, Attitude::new(DVec3::Z, DVec3::Y));
    (0..steps).all(|_| {
        m = translate(method, &body, &m, force, h).0;
        // Motion along the tube is free.
        let off = m.position - at;
        off.x.hypot(off.y) <= GROWN * deviation
    })
}

fn draw(page: &mut Page, file: &str, title: &str, x: &str, values: &[f64], map: &[Vec<f64>]) -> Result<()> {
    let points = |steps: &[f64]| values.iter().zip(steps).map(|(&x, &y)| Point::at(x, y)).collect::<Vec<_>>();
    let series = FIXED.iter().zip(map).map(|((name, _), steps)| Series::line(*name, points(steps)));
    let plot = Plot::new(title, x, "largest stable step / s", series.collect());
    page.plot(file, &plot, "Higher is better. Steps shorter than the shortest one tried are not shown.")?;
    let names: Vec<&str> = std::iter::once(x).chain(FIXED.iter().map(|f| f.0)).collect();
    let mut t = Table::new(&names);
    for (n, &value) in values.iter().enumerate() {
        t.row(std::iter::once(value).chain(map.iter().map(|m| m[n])).map(|v| Cell::Number(v, 7)).collect());
    }
    page.table(&format!("{file}-table"), &t)
}
