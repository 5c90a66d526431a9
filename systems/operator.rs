//! The operator's hand: what it pushes, where it looks, whether it stops the flight.

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::components::camera::{Body, Heading, Pose};
use crate::components::clock::Clock;
use crate::components::flight::{Flight, State, Watch};
use crate::components::guide::MineField;
use crate::components::input::{Command, Hand, Inbox};
use crate::components::{App, FlightSystems};
use crate::error::Result;

/// Speed that a full push holds against the drag, mm/s: faster than the guide's cruise, so that the hand wins.
const PUSH_MM_S: f64 = 45.0;
/// Rate of a full turn, rad/s.
const TURN_RATE: f64 = 1.2;
/// The guide waits so long after the last push before it thrusts again, s.
const HAND_OFF_S: f64 = 0.4;
/// The guide lets go within so long after the hand is on, and has the flight again so long after it waited, s.
const LET_GO_S: f64 = 0.15;
const TAKE_UP_S: f64 = 0.8;
/// A push builds up and dies away with this time constant, s: no hand is faster, and a flight that jerks is no flight.
const PUSH_S: f64 = 0.06;
/// What is left of a push below this is none, mm/s².
const NO_PUSH: f64 = 1e-3;
/// The view stays where the operator turned it for so long, s.
const LOOK_S: f64 = 1.5;

/// Adds the operator to the camera.
pub fn plugin(app: &mut App) -> Result<()> {
    app.world.init_resource::<Inbox>();
    app.add_systems(FlightSystems::Input, take_commands);
    Ok(())
}

/// Applies the commands due in this step, and says what the hand that is held asks for.
pub fn take_commands(
    clock: Res<Clock>,
    mut inbox: ResMut<Inbox>,
    camera: Single<(
        &mut Hand,
        &mut Pose,
        &mut Heading,
        &mut Flight,
        &Body,
        Option<&mut Watch>,
        Option<&mut MineField>,
    )>,
) {
    let (mut hand, mut pose, mut heading, mut flight, body, mut watch, mut mines) = camera.into_inner();
    let after = |seconds: f64| clock.tick + (seconds * f64::from(clock.hz)).ceil() as u64;
    let unit = |v: [f64; 3]| DVec3::from_array(v.map(|x| if x.is_finite() { x.clamp(-1.0, 1.0) } else { 0.0 }));
    let mut touched = false;
    for command in inbox.0.drain(..) {
        match command {
            Command::Push(p) => hand.push = unit(p),
            Command::Turn(t) => hand.turn = unit(t),
            Command::Look([right, up]) if right.is_finite() && up.is_finite() => {
                let (axis_up, axis_right) = (pose.attitude.up, pose.attitude.right());
                pose.attitude.rotate(axis_up, -right.to_radians());
                pose.attitude.rotate(axis_right, up.to_radians());
                hand.looking_until = after(LOOK_S);
            }
            Command::Pause(p) => {
                hand.paused = p;
                touched = true;
            }
            Command::Speed(s) if s.is_finite() => hand.speed = s.clamp(0.1, 5.0),
            Command::Resume => touched = true,
            // The others rebuild the flight and never reach a system.
            _ => {}
        }
    }
    let frame = pose.attitude;
    let turn = hand.turn * TURN_RATE;
    hand.turning = frame.right() * turn.y - frame.up * turn.x + frame.forward * turn.z;
    if hand.turn != DVec3::ZERO {
        hand.looking_until = after(LOOK_S);
    }
    let push = frame.right() * hand.push.x + frame.up * hand.push.y + frame.forward * hand.push.z;
    let asked = push * (PUSH_MM_S * body.0.drag_per_s * hand.speed.max(0.3));
    hand.acceleration = asked + (hand.acceleration - asked) * (-clock.dt() / PUSH_S).exp();
    if asked == DVec3::ZERO && hand.acceleration.length() < NO_PUSH {
        hand.acceleration = DVec3::ZERO;
    }
    if push != DVec3::ZERO {
        hand.on_until = after(HAND_OFF_S);
        touched = true;
        // The guide goes on from where the hand leaves it, in the hand's direction.
        heading.0 = push.normalize_or_zero();
    }
    let away = hand.paused || clock.tick < hand.on_until || flight.state != State::Flying;
    let change = if away { -clock.dt() / LET_GO_S } else { clock.dt() / TAKE_UP_S };
    hand.guided = (hand.guided + change).clamp(0.0, 1.0);
    if touched {
        // What the operator does is no circling, and mines laid on the way there must not forbid it.
        if let Some(w) = watch.as_mut() {
            w.rescue.restart();
        }
        if let Some(m) = mines.as_mut() {
            m.mines.clear();
        }
        if flight.state == State::Operator {
            flight.state = State::Flying;
            flight.reason.clear();
        }
    }
}
