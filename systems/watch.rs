//! Notices that the camera has arrived, or that it gets nowhere; the latter is tried to be mended, then the operator is
//! called.

use bevy_ecs::prelude::*;

use crate::components::camera::{Body, Contact, Heading, Pose};
use crate::components::clock::Clock;
use crate::components::flight::{Flight, Goal, State, Watch};
use crate::components::guide::{Automatic, MineField, Planned, PotentialSettings, Tentacles};
use crate::components::input::Hand;
use crate::components::{App, FlightSystems};
use crate::dynamics::rescue::Order;
use crate::dynamics::trap::Felt;
use crate::error::Result;

/// The operator is called when the body was stuck in the wall for so long, s: a guide may need a moment to push it out.
const STUCK_S: f64 = 0.5;

/// A potential's wall yields so often in one flight, for so long, s.
const YIELDS: u32 = 6;
const YIELD_S: f64 = 4.0;
/// A plan is narrow where it leaves the body no more than this on each side, mm; looked for so far ahead, mm.
const NARROW_MM: f64 = 0.5;
const NARROW_AHEAD_MM: f64 = 15.0;

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
        (Option<&Tentacles>, Option<&Planned>, Option<&mut PotentialSettings>),
        Option<&mut MineField>,
    )>,
) {
    let (pose, body, contact, mut flight, mut watch, mut heading, automatic, goal, hand, guides, mut mines) =
        camera.into_inner();
    let (tentacles, planned, mut potential) = guides;
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
    // Only who feels their way can set out the wrong way.
    let other_end = goal.filter(|_| tentacles.is_some()).map(|g| g.other_end);
    let before = (rescue.turns(), rescue.escapes());
    let order = rescue.follow(pose.position, clock.dt(), felt.as_ref(), other_end, settings);
    // The rescue's own counts are what the guide may still do: they begin anew whenever the operator takes part.
    flight.turns += rescue.turns() - before.0;
    flight.escapes += rescue.escapes() - before.1;
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
            // The wall's part of a potential gives way before the operator is called.
            if let Some(p) = potential.as_mut().filter(|p| p.yields < YIELDS) {
                p.yields += 1;
                flight.escapes += 1;
                p.yields_until = clock.tick + (YIELD_S * f64::from(clock.hz)) as u64;
                rescue.restart();
                return;
            }
            flight.state = State::Operator;
            flight.reason = planned.and_then(|p| narrow(p, body.0.radius_mm)).unwrap_or_else(|| trap.text().to_owned());
            flight.place = place;
        }
    }
}

/// Whether a plan leads where the body does not fit, as the operator reads it.
fn narrow(planned: &Planned, radius_mm: f64) -> Option<String> {
    let ahead = (0..(NARROW_AHEAD_MM as i32)).map(|n| planned.route.clearance(planned.s_mm + f64::from(n)));
    let least = ahead.fold(f64::INFINITY, f64::min);
    (least < radius_mm + NARROW_MM).then(|| {
        format!("the way ahead narrows to {:.1} mm across, the camera has {:.1} mm", 2.0 * least, 2.0 * radius_mm)
    })
}
