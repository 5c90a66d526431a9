//! The cost of the clamp that keeps every step out of the wall: accuracy and time.

use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;

use super::Subject;
use super::contenders::FIXED;
use super::precision::{TUBE, errors, forces, start, turning};
use super::tube::Tube;
use crate::dynamics::advance;
use crate::dynamics::integrators::{Rosenbrock, Stepper};
use crate::dynamics::rigid::RigidBodyState;
use crate::dynamics::step::{integrate, step};
use crate::dynamics::{Body, PotentialForce};
use crate::error::Result;
use crate::fields::ClearanceFinder;
use crate::phantom::{Phantom, PhantomSettings, Size};
use crate::progress::Progress;
use crate::report::page::Page;
use crate::report::table::{Table, row};
use crate::report::{Effort, median, quantile};

/// Duration of a flight, s.
const SECONDS: f64 = 2.0;

/// Selects whether the clamp stops a flight at the wall.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Clamp {
    On,
    Off,
}

/// Runs the study.
pub(crate) fn study(subject: &Subject, page: &mut Page, progress: &Progress) -> Result<Vec<String>> {
    let effort = subject.effort;
    page.text(
        "Two flights of two seconds, each compared with itself in steps of 1/7680 s. Free: that of the soft wall above, which \
         touches nothing. Pushed: the operator pushes so hard towards the wall that the camera would leave without the clamp; it slides along the wall. The clamp uses exact distances.",
    );
    let mut t = Table::new(&[
        "method",
        "step / s",
        "free: error without clamp / mm",
        "free: with clamp / mm",
        "pushed: error with clamp / mm",
        "pushed: deepest in the wall without clamp / mm",
    ]);
    let free = fly(&Rosenbrock, DVec3::ZERO, 1.0 / 7680.0, Clamp::Off).0;
    let push = DVec3::new(1500.0, 300.0, 0.0);
    let pushed = fly(&Rosenbrock, push, 1.0 / 7680.0, Clamp::On).0;
    let mut added = 0.0f64;
    for (name, method) in FIXED {
        for hz in [15.0, 30.0, 120.0, 480.0] {
            let h = 1.0 / hz;
            let [off, on] =
                [Clamp::Off, Clamp::On].map(|clamp| errors(&fly(method, DVec3::ZERO, h, clamp).0, &free)[0]);
            added = added.max(on - off);
            let slid = errors(&fly(method, push, h, Clamp::On).0, &pushed)[0];
            let deepest = fly(method, push, h, Clamp::Off).1;
            t.row(row![name, (h, 4), (off, 4), (on, 4), (slid, 4), (deepest, 4)]);
        }
        progress.check()?;
    }
    page.table("clamp", &t)?;
    let [free_us, touching_us] = clamp_times(effort, progress)?;
    Ok(vec![format!(
        "In free flight the clamp adds at most {added:.0e} mm to any method's error at any of these steps, because a step within the free distance is taken whole; it takes {free_us:.0} µs a step in mid-lumen of a phantom and \
         {touching_us:.0} µs while pushed against its wall (medians, exact clearances of the voxels around the body)."
    )])
}

/// Returns the final state of a flight, and its largest penetration of the wall, mm.
fn fly(method: &dyn Stepper, push: DVec3, h: f64, clamp: Clamp) -> (RigidBodyState, f64) {
    let body = Body::default();
    let force = PotentialForce { push, ..forces(100.0) };
    let turn = turning();
    let mut m = start(&body);
    let mut deepest = 0.0f64;
    for _ in 0..(SECONDS / h).round() as u32 {
        m = match clamp {
            Clamp::On => step(method, &body, &m, &force, &turn, &TUBE, h).motion,
            Clamp::Off => integrate(method, &body, &m, &force, &turn, h).0,
        };
        deepest = deepest.max(depth(&TUBE, m.position));
    }
    (m, deepest)
}

fn depth(tube: &Tube, at: DVec3) -> f64 {
    (tube.across(at).length() + Body::default().radius_mm - tube.radius).max(0.0)
}

/// Measures the time of the clamp in the middle of a phantom's lumen and against its wall, µs.
fn clamp_times(effort: Effort, progress: &Progress) -> Result<[f64; 2]> {
    let phantom = Phantom::new(&PhantomSettings { size: Size::Small, ..PhantomSettings::default() });
    let truth = phantom.truth();
    let walls = ClearanceFinder::new(Arc::new(phantom.voxelise(&phantom.grid(), progress)?), -650.0, 11.0);
    let places: Vec<DVec3> = truth.centerline.iter().copied().step_by(effort.choose(40, 10)).collect();
    let time = |from: &dyn Fn(DVec3) -> DVec3, by: DVec3| {
        let times: Vec<f64> = places
            .iter()
            .map(|&p| {
                let at = from(p);
                let begun = Instant::now();
                std::hint::black_box(advance(&walls, at, by, 1.5));
                begun.elapsed().as_secs_f64() * 1e6
            })
            .collect();
        // Load on the machine only adds time.
        quantile(&times, 0.25).min(median(&times))
    };
    let touching = |p: DVec3| advance(&walls, p, DVec3::new(0.0, 1.0, 0.3) * 100.0, 1.5).position;
    Ok([time(&|p| p, DVec3::new(0.1, 0.2, 0.1)), time(&touching, DVec3::new(0.0, 0.25, 0.1))])
}
