//! What guides feel and decide.

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::dynamics::mines::{MineSettings, Mines};
use crate::dynamics::tentacles::{TentacleSettings, directions};

/// What the guide wants: the socket between any navigation method and the forces.
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct GuideThrust {
    /// Acceleration along the way, world mm/s². Taken back while the operator's hand is on or the flight is paused.
    pub thrust: DVec3,
    /// The thrust and the mines together are held to this, mm/s²: what drag balances at cruise speed.
    pub limit: f64,
    /// Acceleration that keeps off the wall, world mm/s². Acts always.
    pub wall: DVec3,
    /// Unit direction of the way on, world; zero where the guide knows none. The view turns there.
    pub way: DVec3,
}

/// On a camera whose guide moves it by itself: its flight is watched. A guide that leaves all to the operator has none.
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct Automatic;

/// Sensory rays and what they last told.
#[derive(Component, Clone, Debug)]
#[require(GuideThrust)]
pub struct Tentacles {
    /// Settings.
    pub settings: TentacleSettings,
    /// Unit directions, world.
    pub directions: Vec<DVec3>,
    /// Free length along each direction, mm.
    pub lengths: Vec<f64>,
    /// The longest that leads on, mm.
    pub ahead_mm: f64,
}

impl Tentacles {
    /// Tentacles that have felt nothing yet.
    pub fn new(settings: TentacleSettings) -> Self {
        let directions = directions(settings.count.max(3));
        Self { lengths: vec![0.0; directions.len()], directions, settings, ahead_mm: 0.0 }
    }

    /// Memory.
    pub fn bytes(&self) -> usize {
        size_of_val(self.directions.as_slice()) + size_of_val(self.lengths.as_slice())
    }
}

/// Mines behind the camera.
#[derive(Component, Clone, Debug)]
#[require(MinePush)]
pub struct MineField {
    /// Settings.
    pub settings: MineSettings,
    /// The mines.
    pub mines: Mines,
}

/// What the mines exert, world mm/s².
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct MinePush(pub DVec3);
