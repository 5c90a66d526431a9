//! Conservation without drag: energy in a well; momentum and angular momentum without forces.

use glam::DVec3;

use super::Subject;
use super::contenders::FIXED;
use super::precision::{TUBE, forces};
use crate::dynamics::integrators::Stepper;
use crate::dynamics::rigid::{RigidBodyState, Turning, free};
use crate::dynamics::step::integrate;
use crate::dynamics::{Attitude, Body, PotentialForce, STEP_HZ, STEP_S};
use crate::error::Result;
use crate::progress::Progress;
use crate::report::page::Page;
use crate::report::plot::{Plot, Point, Series};
use crate::report::table::{Table, row};

/// Runs the study.
pub(crate) fn study(subject: &Subject, page: &mut Page, progress: &Progress) -> Result<Vec<String>> {
    let effort = subject.effort;
    let seconds = effort.choose(5.0, 30.0);
    page.text(&format!(
        "Without drag and without a target the body swings across the tube for {seconds} s; the energy error at the end is relative to the initial energy above rest on the axis."
    ));
    let mut series = Vec::new();
    let mut at_flight = Vec::new();
    for (name, method) in FIXED {
        let drift = |h: f64| energy_drift(method, h, seconds);
        let points = [15.0, 30.0, 60.0, 120.0, 240.0, 480.0, 960.0].map(|hz: f64| {
            let drift = drift(1.0 / hz);
            Point::at(1.0 / hz, if drift.is_finite() { drift.abs().max(1e-16) } else { f64::NAN })
        });
        at_flight.push((name, drift(STEP_S)));
        series.push(Series::line(name, points));
        progress.check()?;
    }
    let title = format!("Error of the energy after {seconds} s without drag");
    let plot = Plot::new(title, "step / s", "share of the energy", series);
    page.plot("energy", &plot, "Lower is better. Methods that left the tube are not drawn.")?;
    let mut t =
        Table::new(&["method", "body", "momentum", "angular momentum", "energy of rotation", "orientation / rad"]);
    let mut worst = 0.0f64;
    for (name, method) in FIXED {
        for (shape, r, l) in [("needle", 1e-3, 2.9), ("flat", 1.49, 1e-3), ("default", 1.06, 2.12)] {
            let drifts = free_drift(method, r, l);
            worst = worst.max(drifts[0]).max(drifts[1]);
            let [momentum, angular, energy, orientation] = drifts.map(|d| (d, 16));
            t.row(row![name, shape, momentum, angular, energy, orientation]);
        }
        progress.check()?;
    }
    page.text(&format!(
        "Without forces, 1000 steps of 1/{STEP_HZ} s with a spin of 1e4 rad/s: relative change of momenta and energy, and the angle to the exact motion.",
    ));
    page.table("free-motion", &t)?;
    let reported: Vec<String> = at_flight.iter().map(|(name, d)| format!("{name} {d:+.0e}")).collect();
    Ok(vec![format!(
        "Without drag the relative energy error after {seconds} s in steps of 1/{STEP_HZ} s is: {}. Without forces momentum \
         and angular momentum stay within {worst:.0e} in every method, at a spin of 1e4 rad/s.",
        reported.join(", ")
    )])
}

/// Returns the relative error of the energy at the end.
fn energy_drift(method: &dyn Stepper, h: f64, seconds: f64) -> f64 {
    let body = Body { drag_per_s: 0.0, ..Body::default() };
    let force = PotentialForce { target: None, ..forces(1e4) };
    let rest = force.sample(TUBE.place(0.0, 0.0, 0.0)).energy;
    let energy =
        |m: &RigidBodyState| m.momentum.length_squared() / (2.0 * body.mass_g) + force.sample(m.position).energy - rest;
    let mut m = RigidBodyState::at_rest(TUBE.place(0.0, 4.0, 0.0), Attitude::new(DVec3::Z, DVec3::Y));
    m.momentum = DVec3::new(0.0, 20.0, 5.0);
    let begun = energy(&m);
    for _ in 0..(seconds / h).round() as u64 {
        m = integrate(method, &body, &m, &force, &Turning::FREE, h).0;
        if TUBE.across(m.position).length() > TUBE.radius || !m.is_finite() {
            return f64::INFINITY;
        }
    }
    energy(&m) / begun - 1.0
}

/// Returns the drift of momentum, angular momentum and rotational energy (shares) and of the orientation (rad) of a free cylinder.
fn free_drift(method: &dyn Stepper, radius: f64, length: f64) -> [f64; 4] {
    let (cylinder_radius_mm, cylinder_length_mm) = (Some(radius), Some(length));
    let body = Body { drag_per_s: 0.0, cylinder_radius_mm, cylinder_length_mm, ..Body::default() };
    let j = body.inertia();
    let mut m =
        RigidBodyState::at_rest(DVec3::new(50.0, -20.0, 7.0), Attitude::new(DVec3::new(0.3, 1.0, -0.2), DVec3::Z));
    m.momentum = DVec3::new(3.0, -40.0, 11.0);
    m.angular = j.momentum(DVec3::new(0.48, 0.6, 0.64) * 1e4, m.orientation * DVec3::Z);
    let (begun, h, steps) = (m, STEP_S, 1000);
    let energy = |m: &RigidBodyState| j.energy(m.angular, m.orientation * DVec3::Z);
    for _ in 0..steps {
        m = integrate(method, &body, &m, &DVec3::ZERO, &Turning::FREE, h).0;
    }
    let exact = free::turn(begun.orientation, begun.angular, &j, 0.0, h * f64::from(steps));
    let exact = RigidBodyState { orientation: exact, ..m };
    [
        (m.momentum - begun.momentum).length() / begun.momentum.length(),
        (m.angular - begun.angular).length() / begun.angular.length(),
        (energy(&m) / energy(&begun) - 1.0).abs(),
        super::precision::errors(&m, &exact)[1],
    ]
}
