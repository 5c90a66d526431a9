//! What several tests of flights share.

use std::path::PathBuf;
use std::process::{Command, Output};
use std::sync::Arc;

use colvis::app::plan::{self, Wish};
use colvis::app::{FlightApp, Scene};
use colvis::components::flight::State;
use colvis::components::output::LogLine;
use colvis::fields::lumen;
use colvis::phantom::{Phantom, Settings, Truth};
use colvis::progress::Progress;
use colvis::render::{PreparedVolume, TransferFunction};
use colvis::volume::Volume;
use glam::DVec3;

/// The program under test.
pub fn colvis() -> Command {
    Command::new(env!("CARGO_BIN_EXE_colvis"))
}

/// Runs the program and returns what it said; prints it when the status is not as wanted.
pub fn run(args: &[&str], status: i32) -> Output {
    let out = colvis().args(args).output().expect("the program can be run");
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(status), "colvis {args:?} said: {said}");
    assert_eq!(said.lines().filter(|l| l.starts_with("error: ")).count(), usize::from(status != 0), "{said}");
    out
}

/// A file of the test data, if it is there; says so if not.
pub fn data(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("COLVIS_TEST_DATA").map_or_else(|| PathBuf::from("../shared/data"), PathBuf::from);
    let path = folder.join(name);
    if !path.exists() {
        eprintln!("skipped: there is no {}", path.display());
        return None;
    }
    Some(path)
}

/// A phantom with its truth.
pub fn phantom(settings: &Settings) -> (Volume, Truth) {
    let phantom = Phantom::new(settings);
    let volume = phantom.voxelise(&phantom.grid(), &Progress::new()).expect("not cancelled");
    let truth = phantom.truth();
    (volume, truth)
}

/// A flight through a volume.
pub fn flight(volume: Volume, scene: Scene, wish: &Wish) -> FlightApp {
    let progress = Progress::new();
    let space = PreparedVolume::new(Arc::new(volume), TransferFunction::default());
    let lumen = Arc::new(lumen::find(space.volume(), &progress).expect("a lumen"));
    let plan = plan::plan(&space, &lumen, wish, scene.body.radius_mm, &progress).expect("a plan");
    FlightApp::new(space, lumen, plan, scene, None).expect("a flight")
}

/// Flies until the flight ends by itself, or for `seconds`; the scene must have a log.
pub fn fly(flight: &mut FlightApp, seconds: f64) -> Vec<LogLine> {
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

/// How well a flight followed a true centerline.
#[derive(Debug)]
pub struct Course {
    /// Share of the centerline's length that was passed within the lumen.
    pub passed: f64,
    /// Mean distance from the centerline as a share of the local radius.
    pub offset: f64,
    /// Least clearance, mm.
    pub clearance_mm: f64,
}

/// Judges a flight by the truth.
pub fn judge(log: &[LogLine], truth: &Truth) -> Course {
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

/// A test takes of these what it needs, and what it leaves is not dead: another one takes it.
const _: () = {
    let _ = (colvis, run, data, phantom, flight, fly, judge);
    let _ = |c: Course| (c.passed, c.offset, c.clearance_mm);
};
