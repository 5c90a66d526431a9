//! Steady flight along the axis, where `D_s` has its kink: a poor solution chatters across it.

use glam::DVec3;

use super::Subject;
use super::contenders::FIXED;
use super::precision::TUBE;
use super::tube::{RemainingLength, Tube};
use crate::dynamics::integrators::{Integrator, Stepper};
use crate::dynamics::rigid::{RigidBodyState, Turning};
use crate::dynamics::step::integrate;
use crate::dynamics::{Attitude, Body, Potential, PotentialForce, STEP_HZ, STEP_S};
use crate::error::Result;
use crate::progress::Progress;
use crate::report::page::Page;
use crate::report::table::{Table, row};

/// Step of the flight, s, its length in steps, and the number of final steps that are evaluated.
const STEP: f64 = STEP_S;
const STEPS: usize = 6 * STEP_HZ as usize;
const LOOKED_AT: usize = STEPS / 2;

/// Runs the study.
pub(crate) fn study(_: &Subject, page: &mut Page, progress: &Progress) -> Result<Vec<String>> {
    page.text(&format!(
        "Six seconds along the axis in steps of 1/{STEP_HZ} s, with a wall that acts beyond the axis (p = 20 mm in a tube of 15 mm), so that its force reverses at the kink of D_s. Lateral jerk is the root mean square of the third difference of the position across the tube over the last three seconds; offset is the mean distance from the axis. \
         The kink is sharp, rounded over a tenth of a voxel of 0.7 mm, or over a whole voxel, as interpolation does.",
    ));
    let mut t = Table::new(&["method", "rounding / mm", "C_s / g·mm²/s²", "lateral jerk / mm/s³", "offset / mm"]);
    let mut worst = Vec::new();
    for (name, method) in FIXED {
        let mut most = 0.0f64;
        for rounding in [0.0, 0.07, 0.7] {
            for wall_energy in [1e2, 1e4] {
                let [jerk, offset] = fly(method, rounding, wall_energy);
                most = if jerk.is_nan() { f64::INFINITY } else { most.max(jerk) };
                let [jerk, offset] = [jerk, offset].map(|v| if v.is_nan() { f64::INFINITY } else { v });
                t.row(row![name, (rounding, 2), (wall_energy, 0), (jerk, 3), (offset, 4)]);
            }
        }
        worst.push((name, most));
        progress.check()?;
    }
    page.table("lateral-jerk", &t)?;
    let reported: Vec<String> = worst.iter().map(|(name, j)| format!("{name} {j:.3}")).collect();
    let default = Integrator::default();
    let [jerk, _] = fly(default.stepper(), TUBE.rounding, 1e2);
    Ok(vec![format!(
        "Lateral jerk in steady flight over the kink of the centerline, the largest of six, in mm/s³: {}; the default, {}, \
         has {jerk:.3} on a field rounded over a voxel.",
        reported.join(", "),
        default.name()
    )])
}

/// Returns lateral jerk, mm/s³, and offset, mm.
fn fly(method: &dyn Stepper, rounding: f64, wall_energy: f64) -> [f64; 2] {
    let tube = Tube { rounding, ..TUBE };
    let remaining = RemainingLength { tube, end: 8.0 };
    let potential = Potential { wall_energy, reach_mm: 20.0, ..Potential::default() };
    let force = PotentialForce { potential, wall: Some(&tube), target: Some(&remaining), push: DVec3::ZERO };
    let body = Body::default();
    let mut m = RigidBodyState::at_rest(tube.place(-1.5, 0.3, -0.2), Attitude::new(DVec3::Z, DVec3::Y));
    let mut across = Vec::new();
    let mut offset = 0.0;
    for n in 0..STEPS {
        m = integrate(method, &body, &m, &force, &Turning::FREE, STEP).0;
        if n >= STEPS - LOOKED_AT {
            // In the tube's frame, where a steady flight is at rest.
            let a = tube.across(m.position);
            let out = DVec3::new(m.position.x, 0.0, m.position.z).normalize_or(DVec3::X);
            across.push(DVec3::new(a.dot(out), a.y, 0.0));
            offset += a.length() / LOOKED_AT as f64;
        }
    }
    let jerks = across.windows(4).map(|p| (p[3] - p[2] * 3.0 + p[1] * 3.0 - p[0]) / STEP.powi(3));
    let (sum, count) = jerks.fold((0.0, 0.0), |(s, n), j| (s + j.length_squared(), n + 1.0));
    [(sum / count).sqrt(), offset]
}
