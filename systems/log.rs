//! Writes down each step.

use bevy_ecs::prelude::*;

use crate::components::camera::{Contact, Pose, Velocity};
use crate::components::clock::Clock;
use crate::components::flight::Flight;
use crate::components::output::{FlightLog, GuideName, LogLine};
use crate::error::Result;
use crate::schedule::{App, FlightSystems, Main};

/// Adds the log to the scene.
pub fn plugin(app: &mut App) -> Result<()> {
    app.world.init_resource::<FlightLog>();
    app.add_systems(FlightSystems::Log, log_step);
    Ok(())
}

/// Appends the step that was just done.
pub fn log_step(
    clock: Res<Clock>,
    guide: Res<GuideName>,
    mut log: ResMut<FlightLog>,
    camera: Single<(&Pose, &Flight, Option<&Velocity>, Option<&Contact>), With<Main>>,
) {
    let (pose, flight, velocity, contact) = camera.into_inner();
    log.0.push(LogLine {
        t: (clock.tick + 1) as f64 / f64::from(clock.hz),
        position: pose.position.to_array(),
        forward: pose.attitude.forward.to_array(),
        up: pose.attitude.up.to_array(),
        velocity: velocity.map_or([0.0; 3], |v| v.0.to_array()),
        clearance_mm: contact.map_or(0.0, |c| c.clearance_mm),
        state: flight.state,
        guide: guide.0.to_owned(),
    });
}
