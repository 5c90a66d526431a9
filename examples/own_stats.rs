//! Adds a plug-in to colvis that tells how a flight went: how near the camera came to the wall.
//!
//! `cargo run --release --example own_stats -- fly --headless --stats stats.json` writes it under `plugins`, `nearness`.

use std::borrow::Cow;

use colvis::bevy_ecs::{self, prelude::*};
use colvis::cli::Program;
use colvis::components::camera::Contact;
use colvis::error::Result;
use colvis::schedule::{App, FlightSystems, Main, Plugin};
use colvis::serde_json::{Value, json};

#[derive(Resource)]
struct Nearest(f64);

struct Nearness;

impl Plugin for Nearness {
    fn name(&self) -> Cow<'static, str> {
        "nearness".into()
    }

    fn build(&self, app: &mut App) -> Result<()> {
        app.world.insert_resource(Nearest(f64::INFINITY));
        app.add_systems(FlightSystems::Watch, watch);
        Ok(())
    }

    fn stats(&self, app: &App) -> Option<Value> {
        app.world.get_resource::<Nearest>().map(|nearest| json!({ "nearest_mm": nearest.0 }))
    }
}

fn watch(contact: Single<&Contact, With<Main>>, mut nearest: ResMut<Nearest>) {
    nearest.0 = nearest.0.min(contact.into_inner().clearance_mm);
}

fn main() -> std::process::ExitCode {
    Program::default().plugin(Nearness).run()
}

#[test]
fn it_tells_how_near() -> Result<()> {
    use colvis::app::{FlightRequest, Scan, Scene};
    let mut flight = Scan::phantom(1)?.flight(Scene::default().plug(Nearness)?, &FlightRequest::default())?;
    flight.fly(1.0)?;
    let (stats, outcome) = flight.plugin_stats();
    assert!(outcome.is_ok() && stats["nearness"]["nearest_mm"].as_f64().is_some_and(|mm| (0.0..30.0).contains(&mm)));
    Ok(())
}
