//! Notices that the camera has arrived, or that it gets nowhere; the latter is tried to be mended, then the operator is
//! called.

use bevy_ecs::prelude::*;

use crate::components::camera::{Body, Contact, Heading, Pose};
use crate::components::clock::Clock;
use crate::components::flight::{Flight, Goal, State, Watch};
use crate::components::guide::{Automatic, MineField, Tentacles};
use crate::components::input::Hand;
use crate::components::{App, FlightSystems};
use crate::dynamics::rescue::Order;
use crate::dynamics::trap::Felt;
use crate::error::Result;

/// The operator is called when the body was stuck in the wall for so long, s: a guide may need a moment to push it out.
const STUCK_S: f64 = 0.5;

/// Adds the watch to the scene.
pub fn plugin(app: &mut App) -> Result<()> {
    app.add_systems(FlightSystems::Watch, watch_flight);
    Ok(())
}

/// Updates the state of the flight.
pub fn watch_flight(
    clock: Res<Clock>,
    camera: Single<(
        &Pose,
        &Body,
        &Contact,
        &mut Flight,
        &mut Watch,
        &mut Heading,
        Has<Automatic>,
        Option<&Goal>,
        Option<&Hand>,
        Option<&Tentacles>,
        Option<&mut MineField>,
    )>,
) {
    let (pose, body, contact, mut flight, mut watch, mut heading, automatic, goal, hand, tentacles, mut mines) =
        camera.into_inner();
    if flight.state != State::Flying {
        return;
    }
    if let Some(goal) = goal
        && pose.position.distance(goal.at) <= goal.within_mm
    {
        flight.state = State::Arrived;
        flight.place = pose.position;
        return;
    }
    if f64::from(contact.stuck_steps) * clock.dt() >= STUCK_S && hand.is_none_or(|h| clock.tick >= h.on_until) {
        flight.state = State::Operator;
        flight.place = pose.position;
        flight.reason =
            "the camera is in the wall, or the lumen is narrower than it is, and no way out was found".to_owned();
        return;
    }
    // Without a guide that moves the camera there is nothing to watch, nor while the operator has it.
    if !automatic || hand.is_some_and(|h| h.paused || clock.tick < h.on_until) {
        watch.rescue.restart();
        return;
    }
    let felt = tentacles.map(|t| Felt {
        directions: &t.directions,
        lengths: &t.lengths,
        heading: heading.0,
        radius_mm: body.0.radius_mm,
    });
    let Watch { settings, rescue } = &mut *watch;
    let order = rescue.follow(pose.position, clock.dt(), felt.as_ref(), goal.map(|g| g.other_end), settings);
    (flight.turns, flight.escapes) = (rescue.turns(), rescue.escapes());
    match order {
        Order::GoOn => {}
        Order::SetOff { heading: to, clear_mines } => {
            if let Some(to) = to {
                heading.0 = to;
            }
            if let Some(m) = mines.as_mut().filter(|_| clear_mines) {
                m.mines.clear();
            }
        }
        Order::Call { trap, place } => {
            flight.state = State::Operator;
            flight.reason = trap.text().to_owned();
            flight.place = place;
        }
    }
}
