//! The scan entity: the volume, and data derived from it on demand.

use std::sync::Arc;

use bevy_ecs::prelude::*;

use crate::dynamics::Route;
use crate::fields::{ClearanceFinder, TargetDistance, WallDistance};
use crate::space::PreparedVolume;

/// The prepared volume, which every system that senses or renders queries.
#[derive(Component, Clone)]
pub struct Scan(pub PreparedVolume);

/// Exact clearances near the body.
#[derive(Component)]
pub struct Walls(pub ClearanceFinder);

/// `D_s`, the distance to the wall, with its derivatives.
#[derive(Component, Clone)]
pub struct WallDistances(pub Arc<WallDistance>);

/// `D_t`, the distance to the goal along the lumen, with its derivatives.
#[derive(Component, Clone)]
pub struct TargetDistances(pub Arc<TargetDistance>);

/// The centerline from start to goal.
#[derive(Component, Clone)]
pub struct Centerline(pub Arc<Route>);
