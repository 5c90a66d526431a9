//! Adds a plug-in with settings and state to colvis: it measures how long the camera was near the wall.
//!
//! `cargo run --release --example own_plugin` (key O; headless: `-- fly --headless --record film.gif --overlay near_wall`)

use std::borrow::Cow;
use std::sync::Arc;

use colvis::app::{Canvas, FlightApp, Overlay};
use colvis::bevy_ecs::{self, prelude::*};
use colvis::components::camera::Contact;
use colvis::error::Result;
use colvis::render::Options;
use colvis::schedule::{App, FlightSystems, Main, Plugin};

/// Settings and state in one value, stored as a resource. In a scene file: `[near_wall]` `near_mm = 3.0`.
#[derive(Resource, Clone, Debug, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
struct NearWall {
    near_mm: f64,
    #[serde(skip)]
    steps: u32,
}

impl Default for NearWall {
    fn default() -> Self {
        Self { near_mm: 5.0, steps: 0 }
    }
}

impl Plugin for NearWall {
    fn name(&self) -> Cow<'static, str> {
        "near_wall".into()
    }
    fn with_options(&self, options: Options) -> Result<Option<Arc<dyn Plugin>>> {
        Ok(Some(Arc::new(options.read::<Self>("near_wall")?)))
    }
    fn build(&self, app: &mut App) -> Result<()> {
        app.world.insert_resource(self.clone());
        app.add_systems(FlightSystems::Watch, count);
        Ok(())
    }
}

fn count(contact: Single<&Contact, With<Main>>, mut near: ResMut<NearWall>) {
    near.steps += u32::from(contact.into_inner().clearance_mm < near.near_mm);
}

fn draw(flight: &FlightApp, canvas: &mut Canvas) {
    let near = flight.app().world.resource::<NearWall>();
    let text = format!("{:.1} s nearer than {} mm", f64::from(near.steps) / 120.0, near.near_mm);
    canvas.text([canvas.size()[0] / 2.0, canvas.size()[1] * 0.75], text, [120, 220, 140]);
}

fn main() -> std::process::ExitCode {
    let shown = Overlay { name: "near_wall", summary: "time near the wall", key: Some('o'), draw, ..Overlay::PLAIN };
    colvis::cli::Program::default().plugin(NearWall::default()).overlay(shown).run()
}
