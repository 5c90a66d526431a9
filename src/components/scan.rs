//! The scan entity.

use std::sync::Arc;

use bevy_ecs::prelude::*;

use crate::fields::ClearanceFinder;
use crate::render::PreparedVolume;
use crate::volume::Volume;

/// The volume, shared with whoever reads it.
#[derive(Component, Clone)]
pub struct Scan(pub Arc<Volume>);

/// The volume made ready for rays, with its homogeneous-region flags.
#[derive(Component)]
pub struct RaySpace(pub PreparedVolume);

/// Exact clearances around the body.
#[derive(Component)]
pub struct Walls(pub ClearanceFinder);
