//! Detects that the camera has arrived or makes no progress. In the second case it attempts recovery, then calls the operator.

use bevy_ecs::prelude::*;
use bevy_ecs::query::QueryData;

use crate::components::camera::{Body, Contact, Heading, Pose};
use crate::components::clock::Clock;
use crate::components::flight::{Flight, Goal, Help, HelpAnswered, HelpCall, SetOff, State, TakenOver, Watch};
use crate::components::guide::{Automatic, Tentacles};
use crate::components::input::Hand;
use crate::dynamics::monitor::MonitorSettings;
use crate::dynamics::rescue::{Rescue, RescueAction};
use crate::dynamics::trap::TentacleReading;
use crate::error::Result;
use crate::schedule::{App, FlightSystems, Main};

/// Time in the wall after which the operator is called, s: a guide may need a moment to push the body out.
const STUCK_S: f64 = 0.5;

/// Watches the flight to a goal.
///
/// A guide with a better answer than calling the operator gives it in the set [`Answer`](FlightSystems::Answer).
///
/// # Errors
/// Never fails.
pub fn plug(app: &mut App, settings: MonitorSettings, goal: Goal) -> Result<()> {
    app.equip((Watch { settings, rescue: Rescue::default() }, HelpCall::default(), goal));
    app.add_systems(FlightSystems::Watch, watch_flight);
    app.add_systems(FlightSystems::Call, call_operator.before(super::arrival::note_arrival));
    app.observe(restart_after_input).observe(restart_after_help);
    Ok(())
}

/// Starts over after operator input, which does not count as circling.
pub fn restart_after_input(taken: On<TakenOver>, mut cameras: Query<&mut Watch>) {
    if let Ok(mut watch) = cameras.get_mut(taken.entity) {
        watch.rescue.restart();
    }
}

/// Starts over after a guide has helped itself.
pub fn restart_after_help(answered: On<HelpAnswered>, mut cameras: Query<&mut Watch>) {
    if let Ok(mut watch) = cameras.get_mut(answered.entity) {
        watch.rescue.restart();
    }
}

/// The camera of a watched flight.
#[derive(QueryData)]
#[query_data(mutable)]
pub struct WatchedFlight {
    entity: Entity,
    pose: &'static Pose,
    body: &'static Body,
    heading: &'static Heading,
    contact: &'static Contact,
    flight: &'static mut Flight,
    watch: &'static mut Watch,
    call: &'static mut HelpCall,
    automatic: Has<Automatic>,
    goal: Option<&'static Goal>,
    hand: Option<&'static Hand>,
    tentacles: Option<&'static Tentacles>,
}

/// Updates the state of the flight.
pub fn watch_flight(clock: Res<Clock>, camera: Single<WatchedFlight, With<Main>>, mut commands: Commands) {
    let WatchedFlightItem {
        entity,
        pose,
        body,
        heading,
        contact,
        mut flight,
        mut watch,
        mut call,
        automatic,
        goal,
        hand,
        tentacles,
    } = camera.into_inner();
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
        flight.reason = "the camera is stuck in the wall or in a narrow lumen: no free space found".to_owned();
        return;
    }
    // There is nothing to watch without a guide that moves the camera, or while the operator has control.
    if !automatic || hand.is_some_and(|h| h.is_in_control(clock.tick)) {
        watch.rescue.restart();
        return;
    }
    let reading = tentacles.map(|t| TentacleReading {
        directions: &t.directions,
        lengths: &t.lengths,
        heading: heading.0,
        radius_mm: body.0.radius_mm,
    });
    let Watch { settings, rescue } = &mut *watch;
    // Only a guide with tentacles can set out in the wrong direction.
    let other_end = goal.filter(|_| tentacles.is_some()).map(|g| g.other_end);
    let before = (rescue.turns(), rescue.escapes());
    let order = rescue.follow(pose.position, clock.dt(), reading.as_ref(), other_end, settings);
    // The counts in `rescue` limit what the guide may still try, and restart whenever the operator takes part.
    flight.turns += rescue.turns() - before.0;
    flight.escapes += rescue.escapes() - before.1;
    match order {
        RescueAction::GoOn => {}
        RescueAction::SetOff { heading, clear_mines } => {
            commands.trigger(SetOff { entity, heading, clear_mines });
        }
        RescueAction::Call { trap, place } => {
            call.0 = Some(Help { reason: trap.text().to_owned(), place });
        }
    }
}

/// Calls the operator if no guide has answered a call for help.
pub fn call_operator(camera: Single<(&mut Flight, &mut HelpCall), With<Main>>) {
    let (mut flight, mut call) = camera.into_inner();
    if let Some(help) = call.0.take() {
        flight.state = State::Operator;
        flight.reason = help.reason;
        flight.place = help.place;
    }
}

#[cfg(test)]
#[path = "watch_tests.rs"]
mod tests;
