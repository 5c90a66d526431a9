//! Logs each step.

use bevy_ecs::prelude::*;
use glam::DVec3;

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

/// Appends the step that was just completed.
///
/// Values that a plug-in has made non-finite are not logged. The last valid value is logged instead, initially 0.
pub fn log_step(
    clock: Res<Clock>,
    guide: Res<GuideName>,
    mut log: ResMut<FlightLog>,
    camera: Single<(&Pose, &Flight, Option<&Velocity>, Option<&Contact>), With<Main>>,
    mut sound: Local<[DVec3; 4]>,
) {
    let (pose, flight, velocity, contact) = camera.into_inner();
    let moving = velocity.map_or(DVec3::ZERO, |v| v.0);
    let now = [pose.position, pose.attitude.forward, pose.attitude.up, moving];
    for (sound, now) in sound.iter_mut().zip(now).filter(|(_, now)| now.is_finite()) {
        *sound = now;
    }
    let [position, forward, up, velocity] = sound.map(|v| v.to_array());
    let clearance_mm = contact.map_or(0.0, |c| c.clearance_mm);
    log.0.push(LogLine {
        t: (clock.tick + 1) as f64 / f64::from(clock.hz),
        position,
        forward,
        up,
        velocity,
        clearance_mm: if clearance_mm.is_finite() { clearance_mm } else { 0.0 },
        state: flight.state,
        guide: guide.0.to_owned(),
    });
}
