//! A system, and its headless test in a world with known distances: `cargo test --example test_one_system`, or run it.

use colvis::bevy_ecs::{self, prelude::*};
use colvis::components::camera::{Pose, Velocity};
use colvis::components::scan::Walls;
use colvis::error::Result;
use colvis::glam::DVec3;
use colvis::schedule::{App, FlightSystems, Main};
use colvis::testing::{Room, TestApp, digest};

/// The system under test: warns while the camera would reach the wall within half a second.
#[derive(Component, Default, Debug, PartialEq)]
struct Warning {
    on: bool,
    /// How often it has come on.
    times: u32,
}

fn plug(app: &mut App) {
    app.equip(Warning::default()).add_systems(FlightSystems::Watch, warn);
}

fn warn(walls: Single<&Walls, With<Main>>, camera: Single<(&Pose, &Velocity, &mut Warning), With<Main>>) {
    let (walls, (pose, velocity, mut warning)) = (walls.into_inner(), camera.into_inner());
    let on = walls.0.at(pose.position).mm < 0.5 * velocity.0.length();
    warning.times += u32::from(on && !warning.on);
    warning.on = on;
}

/// Steps towards the wall and away again. Returns when the warning was on, and a digest of all positions.
fn there_and_back() -> Result<(Vec<bool>, u64)> {
    let room = Room::new([20, 60, 20]);
    let mut test = TestApp::new(&room);
    plug(&mut test.app);
    test.app.equip(Velocity(DVec3::Y * 10.0));
    let mut on = Vec::new();
    let places = [20.0, 6.0, 4.0, 4.0, 8.0].map(|gap| room.centre().with_y(room.size_mm().y - gap));
    for place in places {
        test.place(place);
        test.steps(1)?;
        on.push(test.get::<Warning>().on);
    }
    assert_eq!(test.get::<Warning>().times, 1, "it came on once");
    Ok((on, digest(places.iter().flat_map(|p| p.to_array()))))
}

#[test]
fn it_warns_within_half_a_second_of_the_wall() {
    let (on, _) = there_and_back().unwrap();
    assert_eq!(on, [false, false, true, true, false], "10 mm/s for half a second are 5 mm");
}

#[test]
fn it_is_the_same_each_time() {
    assert_eq!(there_and_back().unwrap(), there_and_back().unwrap());
}

fn main() -> Result<()> {
    let (on, digest) = there_and_back()?;
    println!("warned in steps {on:?}; the positions have the digest {digest:016x}");
    Ok(())
}
