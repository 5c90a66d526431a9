//! What an arrival means: the segment is flown, and where the goal that was asked for lies in other gas, the operator is
//! called.

use bevy_ecs::prelude::*;

use crate::components::flight::{Flight, Flown, GoalMissed, State};
use crate::error::Result;
use crate::schedule::{App, FlightSystems, Main};

/// Adds the arrival to the scene; what the flight falls short of is equipment of the camera.
pub fn plugin(app: &mut App) -> Result<()> {
    app.camera().insert_if_new(Flown::default());
    app.add_systems(FlightSystems::Call, note_arrival);
    Ok(())
}

/// Notes a segment that was flown to its end, and calls the operator at an end that is not the goal.
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
