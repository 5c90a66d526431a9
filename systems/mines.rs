//! Mines: laid behind the camera, they push it forward.

use bevy_ecs::prelude::*;

use crate::components::camera::{Heading, Pose};
use crate::components::guide::{MineField, MinePush, Tentacles};
use crate::dynamics::mines::{MineSettings, Mines};
use crate::dynamics::tentacles::Drive;
use crate::error::Result;
use crate::schedule::{App, FlightSystems, Main};

/// Lets the camera lay mines.
///
/// # Errors
/// Never fails.
pub fn plug(app: &mut App, settings: MineSettings) -> Result<()> {
    app.equip((MineField { settings, mines: Mines::default() }, MinePush::default()));
    app.add_systems(FlightSystems::Force, (lay_mines, push_by_mines).chain());
    Ok(())
}

/// Computes the push of the mines at the camera's position.
pub fn push_by_mines(camera: Single<(&Pose, &MineField, &mut MinePush), With<Main>>) {
    let (pose, field, mut push) = camera.into_inner();
    push.0 = field.mines.push(pose.position, &field.settings);
}

/// Lays a mine once the camera is far enough from the last one.
///
/// If mines alone drive the camera, the first mine is laid immediately, behind the direction in which the camera will set
/// out.
pub fn lay_mines(camera: Single<(&Pose, &Heading, &mut MineField, Option<&Tentacles>), With<Main>>) {
    let (pose, heading, mut field, tentacles) = camera.into_inner();
    let MineField { settings, mines } = &mut *field;
    if mines.is_empty() && tentacles.is_some_and(|t| t.settings.drive == Drive::Mines) {
        mines.lay_behind(pose.position, heading.0.normalize_or(pose.attitude.forward), settings);
    }
    mines.follow(pose.position, settings);
}
