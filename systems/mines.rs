//! Mines: laid behind the camera, they push it forward.

use bevy_ecs::prelude::*;

use crate::components::camera::{Heading, Pose};
use crate::components::flight::{SetOff, TakenOver};
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
    app.observe(clear_mines).observe(lay_first_mine);
    Ok(())
}

/// Clears the mines after operator input: they must not block the path that the operator took.
pub fn clear_mines(taken: On<TakenOver>, mut cameras: Query<&mut MineField>) {
    if let Ok(mut field) = cameras.get_mut(taken.entity) {
        field.mines.clear();
    }
}

/// Clears the mines when the flight sets off again, if they would hold the camera, and lays the first new one if mines alone
/// drive it.
pub fn lay_first_mine(off: On<SetOff>, mut cameras: Query<(&Pose, &mut MineField, Option<&Tentacles>)>) {
    let Ok((pose, mut field, tentacles)) = cameras.get_mut(off.entity) else { return };
    let MineField { settings, mines } = &mut *field;
    mines.set_off(pose.position, off.heading, off.clear_mines, are_alone(tentacles), settings);
}

/// Returns true if mines alone drive the camera.
fn are_alone(tentacles: Option<&Tentacles>) -> bool {
    tentacles.is_some_and(|t| t.settings.drive == Drive::Mines)
}

/// Computes the push of the mines at the camera's position.
pub fn push_by_mines(camera: Single<(&Pose, &MineField, &mut MinePush), With<Main>>) {
    let (pose, field, mut push) = camera.into_inner();
    push.0 = field.mines.push(pose.position, &field.settings);
}

/// Lays a mine once the camera is far enough from the last one. Without any, mines that alone drive the camera need one behind
/// the direction in which it will set out.
pub fn lay_mines(camera: Single<(&Pose, &Heading, &mut MineField, Option<&Tentacles>), With<Main>>) {
    let (pose, heading, mut field, tentacles) = camera.into_inner();
    let MineField { settings, mines } = &mut *field;
    mines.lay(pose.position, heading.0.normalize_or(pose.attitude.forward), are_alone(tentacles), settings);
}
