//! A deterministic test of one system: build a world with only what the system touches, step it, and check the results.
//!
//! `cargo test --release --example test_one_system`

use bevy_ecs::prelude::*;
use colvis::components::camera::Pose;
use colvis::components::clock::Clock;
use colvis::components::guide::{MineField, MinePush};
use colvis::dynamics::Attitude;
use colvis::dynamics::mines::MineSettings;
use colvis::error::Result;
use colvis::schedule::{App, FlightSystems};
use colvis::systems::{clock, mines};
use glam::DVec3;

/// Stands in for `motion`: moves the camera by a millimetre a step.
fn move_on(mut pose: Single<&mut Pose>) {
    pose.position.x += 1.0;
}

/// Number of mines after `steps` steps, and the push they exert.
fn laid(steps: usize) -> Result<(usize, DVec3)> {
    let mut app = App::new();
    app.camera().insert(Pose { position: DVec3::ZERO, attitude: Attitude::new(DVec3::X, DVec3::Z) });
    mines::plug(&mut app, MineSettings { kept: 4, spacing_mm: 8.0, ..MineSettings::default() })?;
    clock::plugin(&mut app)?;
    app.add_systems(FlightSystems::Integrate, move_on);
    app.build()?;
    for _ in 0..steps {
        app.step()?;
    }
    assert_eq!(app.world.resource::<Clock>().tick, steps as u64);
    let count = app.camera_get::<MineField>().map_or(0, |m| m.mines.len());
    Ok((count, app.camera_get::<MinePush>().map_or(DVec3::ZERO, |p| p.0)))
}

fn main() -> Result<()> {
    let (count, push) = laid(100)?;
    println!("{count} mines, which push by {push} mm/s²");
    Ok(())
}

#[test]
fn the_last_few_mines_push_on() {
    let (count, push) = laid(100).unwrap();
    assert_eq!(count, 4, "the last few are kept");
    assert!(push.x > 0.0 && push.y == 0.0 && push.z == 0.0, "forward: {push}");
    assert_eq!(laid(100).unwrap(), (count, push), "the same again");
}
