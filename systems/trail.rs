//! Records where the flight has been: for coverage, for flying back and for the progress bar.

use bevy_ecs::prelude::*;

use crate::components::camera::Pose;
use crate::components::flight::{Flight, State};
use crate::components::guide::Planned;
use crate::components::trail::Trail;
use crate::error::Result;
use crate::schedule::{App, FlightSystems, Main};

/// Adds the trail to the camera.
pub fn plugin(app: &mut App) -> Result<()> {
    app.camera().insert_if_new(Trail::default());
    app.add_systems(FlightSystems::Trail, follow_trail);
    Ok(())
}

/// Records the view after a step, and its position along the path: by the plan, or by the distance flown.
pub fn follow_trail(camera: Single<(&Pose, &Flight, &mut Trail, Option<&Planned>), With<Main>>) {
    let (pose, flight, mut trail, planned) = camera.into_inner();
    let planned = planned.map(|p| (p.s_mm, p.route.length_mm()));
    trail.follow((pose.position, pose.attitude), flight.length_mm, planned);
    match flight.state {
        State::Arrived => trail.arrive(),
        State::Operator => trail.call(),
        State::Flying | State::Ended => {}
    }
}
