//! Feels the surroundings: tentacles are rays like those of the image, of which only the length is asked.

use bevy_ecs::prelude::*;
use rayon::prelude::*;

use crate::components::camera::Pose;
use crate::components::guide::Tentacles;
use crate::components::scan::RaySpace;
use crate::components::{App, FlightSystems};
use crate::error::Result;
use crate::render::first_crossing;

/// Adds tentacles to the camera of the scene.
pub fn plugin(app: &mut App) -> Result<()> {
    app.add_systems(FlightSystems::Sense, cast_tentacles);
    Ok(())
}

/// Casts every tentacle from where the camera is.
pub fn cast_tentacles(scan: Single<&RaySpace>, camera: Single<(&Pose, &mut Tentacles)>) {
    let (pose, mut tentacles) = camera.into_inner();
    let Tentacles { settings, directions, lengths, .. } = &mut *tentacles;
    let reach = settings.reach_mm;
    let space = &scan.0;
    lengths.par_iter_mut().zip(directions.par_iter()).with_min_len(32).for_each(|(length, &d)| {
        *length = first_crossing(space, pose.position, d, reach).unwrap_or(reach);
    });
}
