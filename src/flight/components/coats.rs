//! Coated spots of the wall, in the camera's picture.

use bevy_ecs::prelude::*;

use crate::render::wall_paint::SpotPaint;

/// Paints coated spots in the picture of the entity that has it.
#[derive(Component, Debug)]
pub struct CoatPaint(pub SpotPaint);
