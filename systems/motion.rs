//! The equation of motion: sums the forces, moves the body as far as the wall allows, turns the view.

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::components::camera::{Acceleration, Body, Contact, Heading, Pose, Velocity};
use crate::components::clock::Clock;
use crate::components::flight::{Flight, State};
use crate::components::guide::{GuideThrust, MinePush};
use crate::components::input::Hand;
use crate::components::scan::Walls;
use crate::components::{App, FlightSystems};
use crate::dynamics::advance;
use crate::dynamics::heading::follow_velocity;
use crate::error::Result;

/// Time constant with which the view follows the way, s, and its greatest rate, rad/s.
const VIEW_S: f64 = 0.45;
const VIEW_RATE: f64 = 1.8;

/// Adds motion to the camera.
pub fn plugin(app: &mut App) -> Result<()> {
    app.add_systems(FlightSystems::Integrate, (sum_forces, move_body, turn_view).chain());
    Ok(())
}

/// Adds up what acts on the body. The operator's hand takes the place of the guide's thrust and of the mines.
pub fn sum_forces(
    clock: Res<Clock>,
    camera: Single<(&mut Acceleration, &Flight, Option<&Hand>, Option<&GuideThrust>, Option<&MinePush>)>,
) {
    let (mut sum, flight, hand, guide, mines) = camera.into_inner();
    let hand_on = hand.is_some_and(|h| h.paused || clock.tick < h.on_until);
    let guide_rests = hand_on || flight.state != State::Flying;
    // Stopped to look around: drag alone brings the body to rest, and nothing shifts it then.
    let stopped = hand.is_some_and(|h| h.paused && h.push == DVec3::ZERO);
    let mut total = hand.map_or(DVec3::ZERO, |h| h.acceleration);
    if let (Some(g), false) = (guide, stopped) {
        total += g.wall;
        if !guide_rests {
            // Mines steer; they must not make the flight faster than it is meant to be.
            let drive = g.thrust + mines.map_or(DVec3::ZERO, |m| m.0);
            total += drive.clamp_length_max(g.limit) * hand.map_or(1.0, |h| h.speed);
        }
    }
    sum.0 = if total.is_finite() { total } else { DVec3::ZERO };
}

/// One step of the body, clamped to free space.
pub fn move_body(
    clock: Res<Clock>,
    walls: Single<&Walls>,
    camera: Single<(&mut Pose, &mut Velocity, &mut Heading, &mut Contact, &mut Flight, &Acceleration, &Body)>,
) {
    let (mut pose, mut velocity, mut heading, mut contact, mut flight, acceleration, body) = camera.into_inner();
    let dt = clock.dt();
    let (v, displacement) = body.0.step(velocity.0, acceleration.0 * body.0.mass_g, dt);
    let moved = advance(&walls.0, pose.position, displacement, body.0.radius_mm);
    velocity.0 = match moved.blocked {
        // Inelastic: what went into the wall is gone.
        Some(into) => v - into * v.dot(into).max(0.0),
        None => v,
    };
    flight.length_mm += moved.position.distance(pose.position);
    pose.position = moved.position;
    *contact = Contact { clearance_mm: walls.0.at(moved.position).mm, blocked: moved.blocked.is_some() };
    heading.0 = follow_velocity(heading.0, velocity.0, dt);
}

/// Turns the view towards the way on, unless the operator looks around.
pub fn turn_view(
    clock: Res<Clock>,
    camera: Single<(&mut Pose, &Heading, &Flight, Option<&GuideThrust>, Option<&Hand>)>,
) {
    let (mut pose, heading, flight, guide, hand) = camera.into_inner();
    let Some(guide) = guide.filter(|g| g.way != DVec3::ZERO) else { return };
    if flight.state != State::Flying || hand.is_some_and(|h| h.paused || clock.tick < h.looking_until.max(h.on_until)) {
        return;
    }
    // Where the guide sees the lumen open, with a little of where the body goes, so that the view does not twitch when two
    // openings are alike.
    let target = heading.0 * 0.25 + guide.way;
    pose.attitude.turn_towards(target, VIEW_S, VIEW_RATE, clock.dt());
}
