//! Adds a look to colvis, which chooses where the camera looks while a guide flies it: this one swings from side to side, as with a
//! torch.
//!
//! `cargo run --release --example own_look -- fly --scene F.toml`, where the scene has `[view]` with `look = "swinging"`.

use colvis::bevy_ecs::prelude::*;
use colvis::components::clock::Clock;
use colvis::components::guide::GuideThrust;
use colvis::glam::{DQuat, DVec3};
use colvis::schedule::{FlightSystems, Look};

const LOOK: Look = Look::new("swinging", "looks from side to side", |app| {
    // Turns the guide's direction by up to half a radian, once in three seconds.
    app.add_systems(FlightSystems::Look, |clock: Res<Clock>, mut guides: Query<&mut GuideThrust>| {
        let angle = 0.5 * (clock.seconds() * std::f64::consts::TAU / 3.0).sin();
        for mut guide in &mut guides {
            guide.look_direction = DQuat::from_axis_angle(DVec3::Z, angle) * guide.look_direction;
        }
    });
    Ok(())
});

fn main() -> std::process::ExitCode {
    colvis::cli::Program::default().look(LOOK).run()
}

#[test]
fn a_flight_looks_elsewhere_and_goes_where_it_went() -> colvis::error::Result<()> {
    use colvis::app::{Catalog, FlightRequest, Scan, Scene};
    let catalog = Catalog::default().look(LOOK);
    catalog.check()?;
    let poses = |look: &str| -> colvis::error::Result<_> {
        let scene = Scene::parse(&format!("plugins = [\"path\"]\n[view]\nlook = \"{look}\""), &catalog)?;
        let mut flight = Scan::phantom(1)?.flight(scene, &FlightRequest::default())?;
        flight.fly(2.0)?;
        Ok(flight.pose())
    };
    let (plain, swinging) = (poses("ahead")?, poses("swinging")?);
    assert!(plain.position.distance(swinging.position) < 1e-9);
    assert!(plain.attitude.forward.angle_between(swinging.attitude.forward) > 0.05);
    assert!(Scene::parse("plugins = [\"path\"]\n[view]\nlook = \"away\"", &catalog).is_err());
    Ok(())
}
