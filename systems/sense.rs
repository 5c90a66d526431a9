//! Senses the surroundings. Tentacles are rays like those of the image, but only their length matters.

use bevy_ecs::prelude::*;
use glam::DVec3;
use rayon::prelude::*;

use crate::components::camera::Pose;
use crate::components::guide::Tentacles;
use crate::components::scan::Scan;
use crate::dynamics::tentacles::TentacleSettings;
use crate::error::Result;
use crate::schedule::{App, FlightSystems, Main};
use crate::space::{PreparedVolume, first_crossing};

/// Gives the camera tentacles, for any guide that uses them.
///
/// # Errors
/// Never fails.
pub fn plug(app: &mut App, settings: TentacleSettings) -> Result<()> {
    app.equip(Tentacles::new(settings));
    app.add_systems(FlightSystems::Sense, cast_tentacles);
    Ok(())
}

/// Casts all tentacles from the camera's position.
pub fn cast_tentacles(scan: Single<&Scan, With<Main>>, camera: Single<(&Pose, &mut Tentacles), With<Main>>) {
    let (pose, mut tentacles) = camera.into_inner();
    let Tentacles { settings, directions, lengths, .. } = &mut *tentacles;
    cast(&scan.0, pose.position, directions, settings.reach_mm, lengths);
}

/// Measures the free length from a point `at` (world mm) along each of the unit `directions`, mm, up to `reach`.
pub fn cast(volume: &PreparedVolume, at: DVec3, directions: &[DVec3], reach: f64, lengths: &mut [f64]) {
    lengths.par_iter_mut().zip(directions.par_iter()).with_min_len(32).for_each(|(length, &d)| {
        *length = first_crossing(volume, at, d, reach).unwrap_or(reach);
    });
}
