//! Feels the surroundings: tentacles are rays like those of the image, but only their length is of interest.

use bevy_ecs::prelude::*;
use rayon::prelude::*;

use crate::components::camera::Pose;
use crate::components::guide::Tentacles;
use crate::components::scan::Scan;
use crate::dynamics::tentacles::TentacleSettings;
use crate::error::Result;
use crate::render::first_crossing;
use crate::schedule::{App, FlightSystems};

/// Gives the camera tentacles: for any guide that feels its way.
///
/// # Errors
/// None.
pub fn plug(app: &mut App, settings: TentacleSettings) -> Result<()> {
    app.equip(Tentacles::new(settings));
    app.add_systems(FlightSystems::Sense, cast_tentacles);
    Ok(())
}

/// Casts every tentacle from where the camera is.
pub fn cast_tentacles(scan: Single<&Scan>, camera: Single<(&Pose, &mut Tentacles)>) {
    let (pose, mut tentacles) = camera.into_inner();
    let Tentacles { settings, directions, lengths, .. } = &mut *tentacles;
    let reach = settings.reach_mm;
    let volume = &scan.0;
    lengths.par_iter_mut().zip(directions.par_iter()).with_min_len(32).for_each(|(length, &d)| {
        *length = first_crossing(volume, pose.position, d, reach).unwrap_or(reach);
    });
}
