//! Mines: laid behind the camera, pushing it on.

use bevy_ecs::prelude::*;

use crate::components::camera::Pose;
use crate::components::guide::{MineField, MinePush};
use crate::dynamics::mines::{MineSettings, Mines};
use crate::error::Result;
use crate::schedule::{App, FlightSystems};

/// Lets the camera lay mines.
///
/// # Errors
/// None.
pub fn plug(app: &mut App, settings: MineSettings) -> Result<()> {
    app.equip((MineField { settings, mines: Mines::default() }, MinePush::default()));
    app.add_systems(FlightSystems::Force, (lay_mines, push_by_mines).chain());
    Ok(())
}

/// What the mines exert at the camera's place.
pub fn push_by_mines(camera: Single<(&Pose, &MineField, &mut MinePush)>) {
    let (pose, field, mut push) = camera.into_inner();
    push.0 = field.mines.push(pose.position, &field.settings);
}

/// Lays a mine when the camera has come far enough from the last one.
pub fn lay_mines(camera: Single<(&Pose, &mut MineField)>) {
    let (pose, mut field) = camera.into_inner();
    let MineField { settings, mines } = &mut *field;
    mines.follow(pose.position, settings);
}
