//! The scan entity: the volume, and what was derived from it because somebody needs it.

use std::sync::Arc;

use bevy_ecs::prelude::*;

use crate::dynamics::Route;
use crate::fields::{ClearanceFinder, TargetDistance, WallDistance};
use crate::render::PreparedVolume;

/// The volume, with what lets rays leap: what every system that feels or renders queries.
#[derive(Component, Clone)]
pub struct Scan(pub PreparedVolume);

/// Exact clearances around the body.
#[derive(Component)]
pub struct Walls(pub ClearanceFinder);

/// `D_s`, the distance to the wall, with its derivatives.
#[derive(Component, Clone)]
pub struct WallDistances(pub Arc<WallDistance>);

/// `D_t`, the distance to the goal along the lumen, with its derivatives.
#[derive(Component, Clone)]
pub struct TargetDistances(pub Arc<TargetDistance>);

/// The centerline from one end of the way to the other.
#[derive(Component, Clone)]
pub struct Centerline(pub Arc<Route>);
