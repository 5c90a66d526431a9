//! What lies behind the wall, in the camera's picture.

use std::sync::Arc;

use bevy_ecs::prelude::*;

use crate::render::translucency::{Translucency, TranslucencySettings};
use crate::render::wall_paint::{PaintedArea, Pictured};
use crate::render::{Distances, PreparedVolume, View};
use crate::volume::Volume;

/// Colours the wall in the picture of the entity that has it by what lies behind it.
#[derive(Component, Clone, Debug)]
pub struct Translucent {
    /// Finds the colours.
    pub translucency: Translucency,
    /// The part of the picture that is coloured.
    pub area: PaintedArea,
    /// The scan as scanned, or a part of it on the same lattice, whatever the picture shows.
    pub scanned: Arc<Volume>,
}

impl Translucent {
    /// Creates it for a whole picture.
    pub fn new(settings: TranslucencySettings, scanned: Arc<Volume>) -> Self {
        Self { translucency: Translucency::new(settings), area: PaintedArea::Whole, scanned }
    }

    /// Colours a picture of `volume`, whose pixels are those of `view`. `distances` are those of its renderer, if it has them.
    pub fn paint(
        &mut self,
        volume: &PreparedVolume,
        view: &View,
        distances: Option<Distances<'_>>,
        frame: &mut crate::render::Frame,
    ) {
        let scanned = Some(&self.scanned).filter(|s| !std::ptr::eq(&***s, volume.voxels()));
        self.translucency.paint(Pictured { volume, scanned, view, distances }, self.area, frame);
    }
}
