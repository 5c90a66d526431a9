//! The guide that leaves the steering to the operator: the body drifts to rest unless it is pushed.

use bevy_ecs::prelude::*;

use crate::components::guide::GuideThrust;
use crate::components::output::GuideName;
use crate::components::{App, FlightSystems, Slot};
use crate::error::Result;

/// Plugs the operator into the guide's slot.
pub fn plugin(app: &mut App) -> Result<()> {
    app.fill(Slot::Guide, "manual")?;
    app.world.insert_resource(GuideName("manual"));
    app.add_systems(FlightSystems::Guide, let_drift);
    Ok(())
}

/// Takes back whatever another guide wanted before.
pub fn let_drift(mut guides: Query<&mut GuideThrust>) {
    for mut guide in &mut guides {
        *guide = GuideThrust::default();
    }
}
