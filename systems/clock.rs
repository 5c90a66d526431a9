//! Simulated time, counted in whole steps and advanced at the end of each.

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

/// Advances the clock by one step.
pub fn tick(mut clock: ResMut<Clock>) {
    clock.tick += 1;
}
