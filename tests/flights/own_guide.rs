//! A custom guide has all the features of a built-in one. `examples/own_guide.rs` is such a guide as a program.

use bevy_ecs::prelude::*;
use colvis::app::explain::explain;
use colvis::app::{Catalog, FlightRequest, Scene};
use colvis::components::camera::{Body, Pose};
use colvis::components::flight::State;
use colvis::components::guide::{GuideThrust, Tentacles};
use colvis::components::input::FlightCommand;
use colvis::components::scan::{Centerline, TargetDistances};
use colvis::dynamics;
use colvis::dynamics::tentacles::TentacleSettings;
use colvis::error::{Error, Result};
use colvis::phantom::{PhantomSettings, Size};
use colvis::schedule::{App, FlightSystems, Guide, Needs};
use colvis::systems::sense;

use crate::support::flights::{flight, fly};
use crate::support::phantom::phantom;

/// Flies in the direction of the longest tentacle that does not lead back.
fn follow_the_longest(camera: Single<(&Pose, &Body, &Tentacles, &mut GuideThrust)>) {
    let (pose, body, tentacles, mut guide) = camera.into_inner();
    let ahead = |d: &glam::DVec3| d.dot(pose.attitude.forward) > 0.0;
    let felt = tentacles.directions.iter().zip(&tentacles.lengths).filter(|(d, _)| ahead(d));
    let Some((&direction, _)) = felt.max_by(|a, b| a.1.total_cmp(b.1)) else { return };
    let limit = 30.0 * body.0.drag_per_s; // the speed at which drag balances it is 30 mm/s
    *guide = GuideThrust { thrust: direction * limit, limit, look_direction: direction, ..GuideThrust::default() };
}

#[derive(Clone, Debug, Default, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Longest {}

impl Guide for Longest {
    const NAME: &'static str = "longest";
    const SUMMARY: &'static str = "follows the longest tentacle";

    fn cruise_mm_s(&self, _: &dynamics::Body) -> f64 {
        30.0
    }

    fn plug(&self, app: &mut App) -> Result<()> {
        sense::plug(app, TentacleSettings::default())?;
        app.add_systems(FlightSystems::Guide, follow_the_longest);
        Ok(())
    }
}

#[test]
fn it_flies() {
    let (volume, _) = phantom(&PhantomSettings { size: Size::Small, ..PhantomSettings::default() });
    let scene = Scene { log: true, ..Scene::steered_by(Longest {}) };
    let mut flight = flight(volume, scene, &FlightRequest::default());
    let log = fly(&mut flight, 10.0);
    assert!(flight.flight().length_mm > 150.0, "{:?}", flight.flight());
    assert!(log.iter().all(|l| l.guide == "longest" && l.clearance_mm >= 1.5));
}

/// A guide without sensors that flies straight on until a wall stops it.
#[derive(Clone, Debug, Default, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Blind {}

impl Guide for Blind {
    const NAME: &'static str = "blind";
    const SUMMARY: &'static str = "flies straight on";

    fn cruise_mm_s(&self, _: &dynamics::Body) -> f64 {
        30.0
    }

    fn plug(&self, app: &mut App) -> Result<()> {
        app.add_systems(FlightSystems::Guide, |mut guide: Single<&mut GuideThrust>| {
            **guide = GuideThrust { thrust: glam::DVec3::X * 180.0, limit: 180.0, ..GuideThrust::default() };
        });
        Ok(())
    }
}

/// Every automatic guide is watched, with or without tentacles.
#[test]
fn a_guide_without_tentacles_is_watched_too() {
    let (volume, _) = phantom(&PhantomSettings { size: Size::Small, ..PhantomSettings::default() });
    let scene = Scene { log: true, ..Scene::steered_by(Blind {}) };
    let mut flight = flight(volume, scene, &FlightRequest::default());
    let log = fly(&mut flight, 30.0);
    let f = flight.flight();
    assert!(f.state == State::Operator && f.reason.contains("makes no progress"), "{f:?}");
    // It was there for two seconds at most, and for the same time again after each turn.
    let there = |l: &&colvis::components::output::LogLine| f.place.distance(l.position.into()) < 6.0;
    let seconds = log.iter().filter(there).count() as f64 / 120.0;
    assert!(seconds <= 2.2 * f64::from(1 + f.turns), "{seconds} s");
}

/// A guide that requests everything that can be built, with custom settings.
#[derive(Clone, Debug, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Planner {
    cruise_mm_s: f64,
}

impl Default for Planner {
    fn default() -> Self {
        Self { cruise_mm_s: 20.0 }
    }
}

impl Guide for Planner {
    const NAME: &'static str = "planner";
    const SUMMARY: &'static str = "plans";
    const KEY: Option<char> = Some('5');
    const NEEDS: Needs = Needs { distances: true, centerline: true, ..Needs::NOTHING };

    fn check(&self) -> Result<()> {
        if self.cruise_mm_s > 0.0 {
            Ok(())
        } else {
            Err(Error::usage("planner.cruise_mm_s", "is not above 0", "give one"))
        }
    }

    fn cruise_mm_s(&self, _: &dynamics::Body) -> f64 {
        self.cruise_mm_s
    }

    fn plug(&self, app: &mut App) -> Result<()> {
        assert!(app.scan_get::<Centerline>().is_some() && app.scan_get::<TargetDistances>().is_some());
        app.add_systems(FlightSystems::Guide, fly_down_the_target);
        Ok(())
    }
}

/// Flies in the direction in which the distance to the goal falls fastest.
fn fly_down_the_target(target: Single<&TargetDistances>, camera: Single<(&Pose, &Body, &mut GuideThrust)>) {
    use colvis::fields::Distance;
    let (pose, body, mut guide) = camera.into_inner();
    let direction =
        target.into_inner().0.sample(pose.position).map_or(glam::DVec3::ZERO, |s| -s.gradient.normalize_or_zero());
    let limit = 20.0 * body.0.drag_per_s;
    *guide = GuideThrust { thrust: direction * limit, limit, look_direction: direction, ..GuideThrust::default() };
}

/// For a custom guide, as for a built-in one, fields come and go with the guide, scene files can set its settings, and
/// the operator can hand over to it and take control back.
#[test]
fn it_has_fields_settings_and_its_place_among_the_guides() {
    let (volume, _) = phantom(&PhantomSettings { size: Size::Small, ..PhantomSettings::default() });
    let mut scene = Scene { operator: true, ..Scene::guided_by("manual") };
    let catalog = Catalog::default().guide::<Planner>();
    scene.guides = catalog.guides.clone();
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("s.toml");
    std::fs::write(&file, "plugins = [\"planner\"]\n[planner]\ncruise_mm_s = 12.5").unwrap();
    assert_eq!(Scene::read(&file, &catalog).unwrap().cruise_mm_s(), 12.5);
    std::fs::write(&file, "plugins = [\"planner\"]\n[planner]\ncruise_mm_s = -1").unwrap();
    assert!(Scene::read(&file, &catalog).is_err());
    let mut flight = flight(volume, scene, &FlightRequest::default());
    assert!(flight.setup().fields.walls().is_none() && flight.setup().fields.target().is_none());
    flight.act(FlightCommand::Guide("planner".to_owned())).unwrap();
    assert!(flight.setup().fields.walls().is_some() && flight.setup().fields.route().is_some());
    let told = explain(&flight);
    assert!(told.built.iter().any(|b| b.part == "target distance field"));
    flight.fly(5.0).unwrap();
    assert!(flight.flight().length_mm > 50.0 && flight.setup().scene.guide_name() == "planner");
    flight.act(FlightCommand::Guide("manual".to_owned())).unwrap();
    assert!(flight.setup().fields.walls().is_none() && flight.setup().fields.target().is_none());
}
