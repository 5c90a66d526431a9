//! How to plug in a navigation system of one's own: the example of the README, which must compile and fly.

mod flying;

use bevy_ecs::prelude::*;
use colvis::app::Scene;
use colvis::app::plan::Wish;
use colvis::app::scene::OwnGuide;
use colvis::components::camera::{Body, Pose};
use colvis::components::flight::State;
use colvis::components::guide::{GuideThrust, Tentacles};
use colvis::components::output::GuideName;
use colvis::components::{App, FlightSystems, Slot};
use colvis::error::Result;
use colvis::phantom::{Settings, Size};
use flying::{flight, fly, phantom};

// README: begin
/// Flies where the longest tentacle points that does not lead back.
fn follow_the_longest(camera: Single<(&Pose, &Body, &Tentacles, &mut GuideThrust)>) {
    let (pose, body, tentacles, mut guide) = camera.into_inner();
    let ahead = |d: &glam::DVec3| d.dot(pose.attitude.forward) > 0.0;
    let felt = tentacles.directions.iter().zip(&tentacles.lengths).filter(|(d, _)| ahead(d));
    let Some((&way, _)) = felt.max_by(|a, b| a.1.total_cmp(b.1)) else { return };
    let limit = 30.0 * body.0.drag_per_s; // what drag balances at 30 mm/s
    *guide = GuideThrust { thrust: way * limit, limit, way, ..GuideThrust::default() };
}

fn longest(app: &mut App) -> Result<()> {
    app.fill(Slot::Guide, "longest")?;
    app.world.insert_resource(GuideName("longest"));
    app.add_systems(FlightSystems::Guide, follow_the_longest);
    Ok(())
}
// README: end

#[test]
fn it_flies() {
    let (volume, _) = phantom(&Settings { size: Size::Small, ..Settings::default() });
    let own_guide = Some(OwnGuide { plugins: &[colvis::systems::sense::plugin, longest], feels: true });
    let scene = Scene { own_guide, log: true, ..Scene::default() };
    let mut flight = flight(volume, scene, &Wish::default());
    let log = fly(&mut flight, 10.0);
    assert!(flight.flight().length_mm > 100.0, "{:?}", flight.flight());
    assert!(log.iter().all(|l| l.guide == "longest" && l.clearance_mm >= 1.5));
}

/// A guide that feels nothing and flies straight on until a wall holds it.
fn blind(app: &mut App) -> Result<()> {
    app.fill(Slot::Guide, "blind")?;
    app.world.insert_resource(GuideName("blind"));
    app.add_systems(FlightSystems::Guide, |mut guide: Single<&mut GuideThrust>| {
        **guide = GuideThrust { thrust: glam::DVec3::X * 180.0, limit: 180.0, ..GuideThrust::default() };
    });
    Ok(())
}

/// The watch is for every guide that flies by itself, with tentacles or without.
#[test]
fn a_guide_without_tentacles_is_watched_too() {
    let (volume, _) = phantom(&Settings { size: Size::Small, ..Settings::default() });
    let own_guide = Some(OwnGuide { plugins: &[blind], feels: false });
    let scene = Scene { own_guide, log: true, ..Scene::default() };
    let mut flight = flight(volume, scene, &Wish::default());
    let log = fly(&mut flight, 30.0);
    let f = flight.flight();
    assert!(f.state == State::Operator && f.reason.contains("hangs in place"), "{f:?}");
    // It was there for two seconds at most, and once more if it was told to turn round.
    let there = |l: &&colvis::components::output::LogLine| f.place.distance(l.position.into()) < 6.0;
    let seconds = log.iter().filter(there).count() as f64 / 120.0;
    assert!(seconds <= 2.2 * f64::from(1 + f.turns), "{seconds} s");
}

#[test]
fn the_readme_shows_this_very_code() {
    let source = include_str!("own_guide.rs");
    let code = source.split("// README: begin\n").nth(1).and_then(|s| s.split("// README: end").next()).unwrap();
    assert!(include_str!("../README.md").contains(code.trim()), "copy the code between the marks into README.md");
}
