//! Simulated time: it is counted in whole steps and goes on at the end of each.

use bevy_ecs::prelude::*;

use crate::components::clock::Clock;
use crate::error::Result;
use crate::schedule::{App, FlightSystems};

/// Adds the clock to the scene.
pub fn plugin(app: &mut App) -> Result<()> {
    app.world.init_resource::<Clock>();
    app.add_systems(FlightSystems::Clock, tick);
    Ok(())
}

/// The step is done.
pub fn tick(mut clock: ResMut<Clock>) {
    clock.tick += 1;
}
