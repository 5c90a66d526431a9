//! The gaze of automatic flights: how often a view looks at a wall close by, and how fast it turns.

use std::sync::Arc;

use glam::DVec3;

use super::Subject;
use crate::app::{FlightRequest, Scan, Scene};
use crate::components::flight::State;
use crate::components::output::LogLine;
use crate::error::Result;
use crate::phantom::{Phantom, PhantomSettings, Size};
use crate::progress::Progress;
use crate::report::page::Page;
use crate::report::table::table;
use crate::report::{median, quantile};
use crate::schedule::Look;
use crate::space::{PreparedVolume, TransferFunction, first_crossing};
use crate::systems::looks;

/// Distance along the path between two evaluated places, mm.
const EVERY_MM: f64 = 5.0;
/// A view looks at a wall if the median depth in its middle is less than this, mm.
const NEAR_MM: f64 = 15.0;
/// The middle of a picture: this share of its width and height, in a picture of 90°.
const MIDDLE: f64 = 0.125;
/// Rays across the middle.
const RAYS: i32 = 9;
/// Maximum duration of a flight, simulated seconds.
const SECONDS: f64 = 600.0;

/// The evaluated flights: guide and look.
const FLIGHTS: [(&str, Look); 5] = [
    ("tentacles", looks::ahead::LOOK),
    ("potential", looks::ahead::LOOK),
    ("potential", looks::way::LOOK),
    ("path", looks::ahead::LOOK),
    ("path", looks::way::LOOK),
];

/// Statistics of a flight's views.
struct Judged {
    state: State,
    seconds: f64,
    places: usize,
    /// Share of the places whose view looks at a wall close by.
    near: f64,
    /// Angular speed, rad/s, and acceleration, rad/s²: 99th percentile and maximum.
    speed: [f64; 2],
    acceleration: [f64; 2],
}

/// Runs the study.
pub(crate) fn study(subject: &Subject, page: &mut Page, progress: &Progress) -> Result<Vec<String>> {
    let seeds = subject.effort.choose(1, 3);
    let mut courses: Vec<(String, PreparedVolume, bool)> = Vec::new();
    for seed in 1..=seeds {
        let settings = PhantomSettings {
            size: subject.effort.choose(Size::Small, Size::Standard),
            seed,
            ..PhantomSettings::default()
        };
        let phantom = Phantom::new(&settings);
        let volume = Arc::new(phantom.voxelise(&phantom.grid(), progress)?);
        courses.push((format!("phantom {seed}"), PreparedVolume::new(volume, TransferFunction::default()), false));
    }
    courses.extend(subject.scan.clone().map(|(title, volume)| (title, volume, true)));
    page.text(
        "Every 5 mm of the path, the median depth in the middle eighth of the picture (90°). Angular speed and acceleration are those \
         of the view, from one step of 1/120 s to the next. The scan is flown cleansed.",
    );
    let mut all = Vec::new();
    let mut worst = [(0.0f64, 0.0f64); 2];
    for (title, volume, is_scan) in &courses {
        let mut scan = Scan::prepared(volume.clone(), Arc::new(progress.clone()));
        if *is_scan {
            scan.cleanse()?;
        }
        for (guide, look) in FLIGHTS {
            for reverse in [false, true] {
                let judged = judge(&mut scan, guide, look, reverse)?;
                if guide != "tentacles" {
                    let w = &mut worst[usize::from(look.name == looks::way::LOOK.name)];
                    *w = (w.0.max(judged.near), w.1.max(judged.acceleration[0]));
                }
                all.push((title, guide, look.name, if reverse { "back" } else { "there" }, judged));
            }
        }
    }
    let table = table!(for (title, guide, look, way, j) in &all;
        "flight" => *title,
        "guide" => *guide,
        "look" => *look,
        "direction" => *way,
        "arrives" => j.state == State::Arrived,
        "simulated s" => (j.seconds, 0),
        "places" => j.places,
        "wall nearer than 15 mm (%)" => (100.0 * j.near, 1),
        "turn rate, 99 % (°/s)" => (j.speed[0].to_degrees(), 0),
        "turn rate, maximum (°/s)" => (j.speed[1].to_degrees(), 0),
        "angular acceleration, 99 % (°/s²)" => (j.acceleration[0].to_degrees(), 0),
        "angular acceleration, maximum (°/s²)" => (j.acceleration[1].to_degrees(), 0),
    );
    page.table("looking", &table)?;
    let [ahead, way] = worst;
    Ok(vec![format!(
        "Planned and potential flights that look along the path see a wall nearer than 15 mm at {:.1} % of their places at worst \
         ({:.1} % when they look ahead); 99 % of the time the view's angular acceleration is below {:.0} °/s² ({:.0}).",
        100.0 * way.0,
        100.0 * ahead.0,
        way.1.to_degrees(),
        ahead.1.to_degrees()
    )])
}

/// Flies, and evaluates the views.
fn judge(scan: &mut Scan, guide: &'static str, look: Look, reverse: bool) -> Result<Judged> {
    let scene = Scene { log: true, look: Some(look), ..Scene::guided_by(guide) };
    let mut flight = scan.flight(scene, &FlightRequest { reverse, ..FlightRequest::default() })?;
    let mut log = Vec::new();
    while flight.flight().state == State::Flying && flight.clock().seconds() < SECONDS {
        flight.step()?;
        log.append(&mut flight.take_log());
    }
    let dt = flight.clock().dt();
    let volume = &flight.setup().volume;
    let depths = depths(volume, &log);
    let [speed, acceleration] = turning(&log, dt);
    let high = |v: &[f64]| [quantile(v, 0.99), v.iter().copied().fold(0.0, f64::max)];
    let near = depths.iter().filter(|&&d| d < NEAR_MM).count() as f64 / depths.len().max(1) as f64;
    let (speed, acceleration) = (high(&speed), high(&acceleration));
    let (state, seconds) = (flight.flight().state, flight.clock().seconds());
    Ok(Judged { state, seconds, places: depths.len(), near, speed, acceleration })
}

/// Returns the median depth in the middle of the view, mm, each few mm of a flight.
fn depths(volume: &PreparedVolume, log: &[LogLine]) -> Vec<f64> {
    let (mut along, mut next, mut depths) = (0.0, 0.0, Vec::new());
    for (n, l) in log.iter().enumerate() {
        let at = DVec3::from_array(l.position);
        along += n.checked_sub(1).map_or(0.0, |m| at.distance(DVec3::from_array(log[m].position)));
        if along >= next {
            depths.push(depth(volume, at, l));
            next += EVERY_MM;
        }
    }
    depths
}

/// Returns the median depth in the middle of a view, mm.
fn depth(volume: &PreparedVolume, at: DVec3, line: &LogLine) -> f64 {
    let (forward, up) = (DVec3::from_array(line.forward), DVec3::from_array(line.up));
    let right = forward.cross(up);
    let tangent = |n: i32| MIDDLE * (2.0 * (f64::from(n) + 0.5) / f64::from(RAYS) - 1.0);
    let rays = (0..RAYS * RAYS).map(|n| {
        let direction = forward + right * tangent(n % RAYS) + up * tangent(n / RAYS);
        first_crossing(volume, at, direction, 1e3).unwrap_or(1e3)
    });
    median(&rays.collect::<Vec<_>>())
}

/// Returns the angular speeds, rad/s, and accelerations, rad/s², of the view.
fn turning(log: &[LogLine], dt: f64) -> [Vec<f64>; 2] {
    let rates: Vec<DVec3> = log
        .windows(2)
        .map(|w| {
            let [a, b] = [w[0].forward, w[1].forward].map(DVec3::from_array);
            let across = a.cross(b);
            across.normalize_or_zero() * (across.length().atan2(a.dot(b)) / dt)
        })
        .collect();
    let speeds = rates.iter().map(|r| r.length()).collect();
    [speeds, rates.windows(2).map(|w| w[0].distance(w[1]) / dt).collect()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::shared;
    use colvis_flight::testing::Room;

    fn line(t: f64, position: DVec3, forward: DVec3, up: DVec3) -> LogLine {
        LogLine {
            t,
            position: position.to_array(),
            forward: forward.to_array(),
            up: up.to_array(),
            velocity: [0.0; 3],
            clearance_mm: 1.0,
            state: State::Flying,
            guide: String::new(),
        }
    }

    #[test]
    fn a_view_that_turns_evenly_has_its_rate_and_no_acceleration() {
        let (dt, rate) = (1.0 / 120.0, 0.7);
        let turned = |n: u32| {
            let angle = rate * dt * f64::from(n);
            line(0.0, DVec3::ZERO, DVec3::new(angle.cos(), angle.sin(), 0.0), DVec3::Z)
        };
        let [speed, acceleration] = turning(&(0..40).map(turned).collect::<Vec<_>>(), dt);
        assert!(speed.iter().all(|s| (s - rate).abs() < 1e-9) && acceleration.iter().all(|a| *a < 1e-6));
        // The rate doubles at once: by 0.7 rad/s within a step.
        let log: Vec<LogLine> = [0, 1, 2, 4, 6].map(turned).into_iter().collect();
        let most = turning(&log, dt)[1].iter().copied().fold(0.0, f64::max);
        assert!((most - rate / dt).abs() < 1e-6, "{most}");
    }

    #[test]
    fn the_depth_is_that_of_the_wall_in_the_middle() {
        let room = Room::new([30, 80, 30]);
        let volume = room.scan();
        let at = DVec3::new(15.0, 20.0, 15.0);
        let d = depth(&volume, at, &line(0.0, at, DVec3::Y, DVec3::Z));
        assert!((d - 60.0).abs() < 1.0, "{d}");
        assert!((depth(&volume, at, &line(0.0, at, DVec3::X, DVec3::Z)) - 15.0).abs() < 0.5);
        // Places are counted along the way, not in time.
        let log: Vec<LogLine> =
            (0..100).map(|n| line(0.0, at + DVec3::Y * 0.2 * f64::from(n), DVec3::Y, DVec3::Z)).collect();
        assert_eq!(depths(&volume, &log).len(), 4);
    }

    #[test]
    #[ignore = "slow: flights by two guides, both ways"]
    fn flights_that_look_along_the_way_seldom_look_at_a_wall() {
        let (_, volume) = shared(&PhantomSettings::embedded(1));
        let volume = PreparedVolume::new(Arc::new(volume), TransferFunction::default());
        let mut scan = Scan::prepared(volume, Arc::new(Progress::new()));
        for guide in ["potential", "path"] {
            for reverse in [false, true] {
                let j = judge(&mut scan, guide, looks::way::LOOK, reverse).unwrap();
                assert!(j.state == State::Arrived && j.places > 100, "{guide} {reverse}: {} places", j.places);
                assert!(j.near <= 0.05, "{guide} {reverse}: {}", j.near);
                // The view turns at most at 1.8 rad/s.
                assert!(j.speed[1] < 1.8 && j.acceleration[0] < 2.5, "{:?} {:?}", j.speed, j.acceleration);
            }
        }
    }
}
