//! Notices that the camera has arrived, or that it gets nowhere; the latter is tried to be mended, then the operator is
//! called.

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::components::camera::{Contact, Heading, Pose};
use crate::components::clock::Clock;
use crate::components::flight::{Flight, Goal, State, Watch};
use crate::components::guide::{MineField, Tentacles};
use crate::components::input::Hand;
use crate::components::{App, FlightSystems};
use crate::dynamics::monitor::Trouble;
use crate::error::Result;

/// A dead end within this of the lumen's other end means that the flight set out the wrong way, mm.
const WRONG_END_MM: f64 = 40.0;
/// So much of the way is looked through for it: the camera may have left the dead end before that was certain, mm.
const WRONG_END_BACK_MM: f64 = 120.0;
/// The guide looks for another way for so long, s, and so often in one flight.
const ESCAPE_S: f64 = 4.0;
const ESCAPES: u32 = 6;
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
        &Contact,
        &mut Flight,
        &mut Watch,
        &mut Heading,
        Option<&Goal>,
        Option<&Hand>,
        Option<&Tentacles>,
        Option<&mut MineField>,
    )>,
) {
    let (pose, contact, mut flight, mut watch, mut heading, goal, hand, tentacles, mut mines) = camera.into_inner();
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
    if tentacles.is_none() || hand.is_some_and(|h| h.paused || clock.tick < h.on_until) {
        watch.monitor.restart();
        return;
    }
    if watch.escaping_until.is_some_and(|t| clock.tick >= t) {
        watch.escaping_until = None;
    }
    let settings = watch.settings;
    let Some(trouble) = watch.monitor.follow(pose.position, clock.dt(), &settings) else { return };
    flight.place = pose.position;
    let was_at = |end: DVec3| watch.monitor.last_mm(WRONG_END_BACK_MM).any(|p| p.distance(end) < WRONG_END_MM);
    let wrong_end = goal.is_some_and(|g| was_at(g.other_end)) && watch.monitor.way_mm() > WRONG_END_MM;
    if flight.turns == 0 && wrong_end {
        flight.turns += 1;
        // Everything flown so far may, and must, be flown again.
        watch.monitor.restart();
        if let Some(m) = mines.as_mut() {
            m.mines.clear();
        }
        // A camera that was noticed on its way back has the right heading already.
        if trouble != Trouble::TurnedBack {
            heading.0 = longest_free(tentacles, -heading.0);
        }
    } else if flight.escapes < ESCAPES && watch.escaping_until.is_none() {
        flight.escapes += 1;
        watch.escaping_until = Some(clock.tick + (ESCAPE_S * f64::from(clock.hz)) as u64);
        watch.monitor.forgive();
        heading.0 = DVec3::ZERO;
    } else {
        flight.state = State::Operator;
        flight.reason = trouble.text().to_owned();
    }
}

fn longest_free(tentacles: Option<&Tentacles>, fallback: DVec3) -> DVec3 {
    tentacles
        .and_then(|t| t.directions.iter().zip(&t.lengths).max_by(|a, b| a.1.total_cmp(b.1)))
        .map_or(fallback, |(d, _)| *d)
}
