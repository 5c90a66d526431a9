//! Traps in three dimensions: the drawn ones, and two lumens between which a guide cannot decide.

use bevy_ecs::prelude::*;
use colvis::app::{FlightApp, Scene};
use colvis::components::camera::Pose;
use colvis::components::flight::State;
use colvis::components::guide::GuideThrust;
use colvis::dynamics::Body;
use colvis::dynamics::tentacles::TentacleSettings;
use colvis::dynamics::trap::Trap;
use colvis::error::Result;
use colvis::plane::drawing::Drawing;
use colvis::plane::shipped::{DRAWINGS, named};
use colvis::progress::Progress;
use colvis::render::ImageSize;
use colvis::report::trials::Course;
use colvis::schedule::{App, FlightSystems, Guide};
use colvis::systems::sense;
use glam::DVec3;

use crate::support::flights::fly;

/// Creates a flight in three dimensions from a drawing's start to its goal.
fn through(drawing: &Drawing, scene: Scene) -> FlightApp {
    let Course { volume, lumen, plan, .. } = Course::drawn(drawing, &Progress::new()).unwrap();
    FlightApp::new(volume, lumen, plan, scene).unwrap()
}

#[test]
#[ignore = "slow: a flight through each drawn lumen"]
fn the_same_traps_in_three_dimensions() {
    let mut wrong = Vec::new();
    for (name, _) in DRAWINGS {
        // With a third dimension the guide has more room: most traps do not catch it.
        let want = [("ring", Trap::Circling), ("neck", Trap::Narrow)].into_iter().find(|w| w.0 == name).map(|w| w.1);
        let drawing = named(name).unwrap().unwrap();
        let mut flight = through(&drawing, Scene { log: true, ..Scene::default() });
        let log = fly(&mut flight, 120.0);
        let f = flight.flight();
        let least = log.iter().map(|l| l.clearance_mm).fold(f64::INFINITY, f64::min);
        println!(
            "{name}: {:?} {} at {:.0}, {:.1} s, {} escapes, least clearance {least:.2}",
            f.state,
            f.reason,
            f.place,
            flight.clock().seconds(),
            f.escapes
        );
        assert!(least >= 1.5, "{name}: perforated");
        if name == "neck" {
            assert!(f.place.distance(DVec3::new(82.0, 30.0, 0.0)) < 3.0, "the neck is at {}", f.place);
        }
        let known = want.map_or((State::Arrived, ""), |t| (State::Operator, t.text()));
        if (f.state, f.reason.as_str()) != known {
            wrong.push(name);
        }
    }
    assert!(wrong.is_empty(), "not as known: {wrong:?}");
}

/// Where a lumen divides into two that are 90° apart, mm.
const PARTING: DVec3 = DVec3::new(60.0, 40.0, 0.0);

/// At this distance from the middle it is inside one of them, mm.
const IN_IT_MM: f64 = 5.0;

/// A guide that takes the upper path until it is inside, then the lower one, and so on: the dithering of section 3.1.1.
#[derive(Clone, Debug, Default, serde::Deserialize)]
struct Torn {
    feels: bool,
}

impl Guide for Torn {
    const NAME: &'static str = "torn";
    const SUMMARY: &'static str = "cannot decide";

    fn cruise_mm_s(&self, _: &Body) -> f64 {
        30.0
    }

    fn plug(&self, app: &mut App) -> Result<()> {
        if self.feels {
            sense::plug(app, TentacleSettings::default())?;
        }
        app.add_systems(FlightSystems::Guide, dither);
        Ok(())
    }
}

fn dither(camera: Single<(&Pose, &mut GuideThrust)>, mut up: Local<bool>) {
    let (pose, mut guide) = camera.into_inner();
    let off = pose.position - PARTING;
    if off.x > 0.0 && off.y.abs() > IN_IT_MM {
        *up = off.y < 0.0;
    }
    let mouth = PARTING + DVec3::new(7.0, if *up { 7.0 } else { -7.0 }, 0.0);
    let direction = (mouth - pose.position).normalize_or_zero();
    *guide =
        GuideThrust { thrust: direction * 180.0, limit: 180.0, look_direction: direction, ..GuideThrust::default() };
}

/// Dithering between two lumens is detected within two seconds, where they divide. A guide with tentacles searches for
/// another path before the operator is called.
#[test]
fn dithering_between_two_lumens_is_told_in_three_dimensions() {
    let (w, h) = (240, 160);
    let inside = |n: usize| {
        let (x, y) = ((n % w) as f64 / 2.0 - PARTING.x, (n / w) as f64 / 2.0 - PARTING.y);
        let stem = (-52.0..0.0).contains(&x) && y.abs() <= 7.0;
        stem || (-4.0..32.0).contains(&x) && (y.abs() - x.max(0.0)).abs() <= 8.0
    };
    let mut wye = Drawing::new("wye", ImageSize::new(w, h), (0..w * h).map(inside).collect()).unwrap();
    (wye.start, wye.goal) = (Some(DVec3::new(12.0, 40.25, 0.0)), Some(DVec3::new(89.0, 11.0, 0.0)));
    for feels in [false, true] {
        let mut flight = through(&wye, Scene { log: true, ..Scene::steered_by(Torn { feels }) });
        let (mut log, mut told) = (Vec::new(), None);
        for _ in 0..120 * 60 {
            if flight.flight().state != State::Flying {
                break;
            }
            flight.step().unwrap();
            log.append(&mut flight.take_log());
            if flight.flight().state != State::Flying || flight.flight().escapes > 0 {
                told.get_or_insert(log.len());
            }
        }
        let (f, told) = (flight.flight(), told.expect("it is told"));
        // It dithers from its second turn on: a single turn may have a reason.
        let off = |n: usize| DVec3::from(log[n].position) - PARTING;
        let turns = |&n: &usize| {
            let [a, b, c] = [off(n - 1).y, off(n).y, off(n + 1).y];
            off(n).x > 0.0 && b.abs() > IN_IT_MM && (b - a) * (c - b) < 0.0
        };
        let second = (1..log.len() - 1).filter(turns).nth(1).expect("it turns");
        println!("{f:?}, told after {told} steps, swaying from {second} on");
        assert_eq!((f.state, f.reason.as_str()), (State::Operator, Trap::Dithering.text()));
        assert!(f.place.distance(PARTING) < 8.0, "told at {}", f.place);
        assert_eq!(f.escapes > 0, feels);
        assert!(told <= second + 240, "first told after {told} steps");
    }
}
