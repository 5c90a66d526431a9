//! Handles arrivals: marks the segment as flown, and calls the operator if the requested goal is in other gas.

use bevy_ecs::prelude::*;

use crate::components::flight::{Flight, Flown, GoalMissed, State};
use crate::error::Result;
use crate::schedule::{App, FlightSystems, Main};

/// Adds arrival handling to the scene and the components it needs to the camera.
pub fn plugin(app: &mut App) -> Result<()> {
    app.camera().insert_if_new(Flown::default());
    app.add_systems(FlightSystems::Call, note_arrival);
    Ok(())
}

/// Marks a segment flown to its end, and calls the operator if that end is not the goal.
pub fn note_arrival(camera: Single<(&mut Flight, &mut Flown, &GoalMissed), With<Main>>) {
    let (mut flight, mut flown, goal_missed) = camera.into_inner();
    if flight.state != State::Arrived {
        return;
    }
    flown.note(flight.state);
    if let Some(why) = &goal_missed.0 {
        flight.state = State::Operator;
        flight.reason = format!("the gas ends here: {why}");
    }
}
