//! Adds a guide to colvis, with settings, fields and a key like any built-in guide.
//!
//! `cargo run --release --example own_guide -- fly --guide downhill` (also `explain`, `--help`, key 5 in the window)

use colvis::bevy_ecs::{self, prelude::*};
use colvis::components::camera::{Body, Pose};
use colvis::components::guide::GuideThrust;
use colvis::components::scan::TargetDistances;
use colvis::dynamics;
use colvis::error::Result;
use colvis::fields::Distance;
use colvis::schedule::{App, FlightSystems, Guide, Needs};

/// The guide's settings. In a scene file: `[downhill]` `cruise_mm_s = 15.0`.
#[derive(Component, Clone, Debug, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Downhill {
    cruise_mm_s: f64,
}

impl Default for Downhill {
    fn default() -> Self {
        Self { cruise_mm_s: 20.0 }
    }
}

impl Guide for Downhill {
    const NAME: &'static str = "downhill";
    const SUMMARY: &'static str = "flies where the distance to the goal falls fastest";
    const KEY: Option<char> = Some('5');
    const NEEDS: Needs = Needs { distances: true, ..Needs::NOTHING };

    fn cruise_mm_s(&self, _: &dynamics::Body) -> f64 {
        self.cruise_mm_s
    }
    fn plug(&self, app: &mut App) -> Result<()> {
        app.equip(self.clone());
        app.add_systems(FlightSystems::Guide, steer);
        Ok(())
    }
}

fn steer(goal: Single<&TargetDistances>, camera: Single<(&Pose, &Body, &Downhill, &mut GuideThrust)>) {
    let (pose, body, settings, mut guide) = camera.into_inner();
    let Some(here) = goal.into_inner().0.sample(pose.position) else { return };
    let (direction, limit) = (-here.gradient.normalize_or_zero(), settings.cruise_mm_s * body.0.drag_per_s);
    *guide = GuideThrust { thrust: direction * limit, limit, look_direction: direction, ..GuideThrust::default() };
}

fn main() -> std::process::ExitCode {
    colvis::cli::Program::default().guide::<Downhill>().run()
}

#[test]
fn it_comes_nearer_to_the_goal() -> Result<()> {
    use colvis::app::{FlightRequest, Scan, Scene};
    let mut flight = Scan::phantom(1)?.flight(Scene::steered_by(Downhill::default()), &FlightRequest::default())?;
    Ok(assert!(flight.fly(3.0).is_ok() && flight.flight().length_mm > 40.0))
}
