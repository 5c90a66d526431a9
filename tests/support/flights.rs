//! Flights through volumes, and measures of their quality.

use colvis::app::{FlightApp, FlightRequest, OpenOptions, Scan, Scene};
use colvis::components::flight::State;
use colvis::components::output::LogLine;
use colvis::phantom::Truth;
use colvis::volume::Volume;
use glam::DVec3;

/// Creates a scan for several flights, which share its flags and its lumen.
pub(crate) fn scan(volume: Volume) -> Scan {
    Scan::of(volume, &OpenOptions::default()).unwrap()
}

/// Creates a flight through a volume.
pub(crate) fn flight(volume: Volume, scene: Scene, request: &FlightRequest) -> FlightApp {
    scan(volume).flight(scene, request).expect("a flight")
}

/// Flies until the flight ends or `seconds` have passed. The scene must have a log.
pub(crate) fn fly(flight: &mut FlightApp, seconds: f64) -> Vec<LogLine> {
    let mut log = Vec::new();
    for _ in 0..(seconds * 120.0) as usize {
        flight.step().expect("a step");
        log.append(&mut flight.take_log());
        if flight.flight().state != State::Flying {
            break;
        }
    }
    log
}

/// How closely a flight followed a true centerline.
#[derive(Debug)]
pub(crate) struct Course {
    /// Share of the centerline's length that was passed inside the lumen.
    pub passed: f64,
    /// Mean distance from the centerline, as a share of the local radius.
    pub offset: f64,
    /// Least clearance, mm.
    pub clearance_mm: f64,
}

/// Compares a flight with the truth.
pub(crate) fn judge(log: &[LogLine], truth: &Truth) -> Course {
    let line: Vec<DVec3> = truth.centerline.clone();
    let radius = &truth.radius_mm;
    let places: Vec<DVec3> = log.iter().map(|l| DVec3::from_array(l.position)).collect();
    let nearest = |p: DVec3, all: &[DVec3]| {
        let d = |i: &usize| all[*i].distance_squared(p);
        (0..all.len()).min_by(|a, b| d(a).total_cmp(&d(b))).expect("points")
    };
    let (mut passed, mut all) = (0.0, 0.0);
    for (i, w) in line.windows(2).enumerate() {
        let length = w[0].distance(w[1]);
        all += length;
        let near = places[nearest(w[0], &places)];
        if near.distance(w[0]) <= radius[i] {
            passed += length;
        }
    }
    let offsets: f64 = places
        .iter()
        .map(|&p| {
            let i = nearest(p, &line);
            line[i].distance(p) / radius[i]
        })
        .sum();
    Course {
        passed: passed / all,
        offset: offsets / places.len() as f64,
        clearance_mm: log.iter().map(|l| l.clearance_mm).fold(f64::INFINITY, f64::min),
    }
}

/// Returns the greatest jerk (mm/s³) of the velocities in some lines of a log, by differences over its steps.
pub(crate) fn jerk(lines: &[LogLine]) -> f64 {
    let v: Vec<DVec3> = lines.iter().map(|l| DVec3::from_array(l.velocity)).collect();
    v.windows(3).map(|w| (w[2] - 2.0 * w[1] + w[0]).length() * 120.0 * 120.0).fold(0.0, f64::max)
}
