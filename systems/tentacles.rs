//! The guide that feels its way: tentacles keep off the wall and find the way on, mines keep from turning back.

use bevy_ecs::prelude::*;

use crate::components::camera::{Body, Heading, Pose};
use crate::components::flight::{Goal, Watch};
use crate::components::guide::{GuideThrust, MineField, Tentacles};
use crate::components::output::GuideName;
use crate::components::scan::RaySpace;
use crate::components::{App, FlightSystems, Slot};
use crate::dynamics::tentacles::{approach, steer};
use crate::error::Result;
use crate::render::first_crossing;

/// Plugs tentacles into the guide's slot.
pub fn plugin(app: &mut App) -> Result<()> {
    app.fill(Slot::Guide, "tentacles")?;
    app.world.insert_resource(GuideName("tentacles"));
    app.add_systems(FlightSystems::Guide, guide_by_tentacles);
    Ok(())
}

/// Decides on the way from what the tentacles told.
pub fn guide_by_tentacles(
    scan: Single<&RaySpace>,
    camera: Single<(
        &Pose,
        &Heading,
        &Body,
        &Tentacles,
        &mut GuideThrust,
        Option<&MineField>,
        Option<&Goal>,
        Option<&Watch>,
    )>,
) {
    let (pose, heading, body, tentacles, mut guide, mines, goal, watch) = camera.into_inner();
    let mines = mines.map(|m| (&m.mines, &m.settings));
    // Where the guide looks for another way, its whole trail is forbidden ground, not only the last few mines.
    let trail = watch.map_or((&[][..], 0.0), |w| w.rescue.forbidden());
    let settings = watch.map_or(tentacles.settings, |w| w.rescue.temper(&tentacles.settings));
    let s = steer(
        (&tentacles.directions, &tentacles.lengths),
        pose.position,
        heading.0,
        mines,
        trail,
        &settings,
        body.0.drag_per_s,
    );
    let limit = tentacles.settings.cruise_mm_s * body.0.drag_per_s;
    *guide = GuideThrust { thrust: s.thrust, limit, wall: s.wall, way: s.look, ..GuideThrust::default() };
    // A goal in plain sight draws the camera, as the paper's D_t does; behind a wall it does not.
    if let Some(goal) = goal
        && let Some((thrust, way)) = approach(pose.position, goal.at, &tentacles.settings, body.0.drag_per_s)
        && first_crossing(&scan.0, pose.position, way, pose.position.distance(goal.at)).is_none()
    {
        guide.thrust = thrust;
        guide.limit = thrust.length();
        guide.way = way;
    }
}
