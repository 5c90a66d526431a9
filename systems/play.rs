//! Replays a log: the camera follows the logged poses, and no force acts on it.

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::components::camera::{Contact, Pose, Velocity};
use crate::components::clock::Clock;
use crate::components::flight::{Flight, State};
use crate::components::input::Hand;
use crate::components::play::Playback;
use crate::error::Result;
use crate::schedule::{App, FlightSystems, Main};

/// Puts a log in the guide's place.
///
/// # Errors
/// Never fails.
pub fn plug(app: &mut App, play: &Playback) -> Result<()> {
    app.camera().insert_if_new(play.clone());
    app.add_systems(FlightSystems::Integrate, follow_log);
    Ok(())
}

/// Moves the camera to its logged pose after this step. The operator may pause, change the speed and look around.
pub fn follow_log(
    clock: Res<Clock>,
    camera: Single<(&mut Pose, &mut Velocity, &mut Contact, &mut Flight, &mut Playback, Option<&Hand>), With<Main>>,
) {
    let (mut pose, mut velocity, mut contact, mut flight, mut play, hand) = camera.into_inner();
    let looking = hand.filter(|h| clock.tick < h.turned_until);
    // Mouse turns are already applied. Keys turn the view as long as they are held, even while the log is paused.
    if let Some(turning) = looking.map(|h| h.turning).filter(|t| *t != DVec3::ZERO) {
        pose.attitude.rotate(turning.normalize(), turning.length() * clock.dt());
    }
    if flight.state != State::Flying || hand.is_some_and(|h| h.paused) {
        velocity.0 = DVec3::ZERO;
        return;
    }
    let speed = hand.map_or(1.0, |h| h.speed);
    let over = play.go(clock.dt(), speed);
    let now = play.now();
    flight.length_mm += now.position.distance(pose.position);
    pose.position = now.position;
    if looking.is_none() {
        pose.attitude = now.attitude;
    }
    velocity.0 = now.velocity * speed;
    *contact = Contact { clearance_mm: now.clearance_mm, ..Contact::default() };
    if over {
        // However the logged flight ended, it has been shown to its end.
        flight.state = if play.last_state() == State::Arrived { State::Arrived } else { State::Ended };
        flight.place = now.position;
    }
}

#[cfg(test)]
#[path = "play_tests.rs"]
mod tests;
