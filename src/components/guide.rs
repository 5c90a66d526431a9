//! What guides feel and decide.

use std::sync::Arc;

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::dynamics::Potential;
use crate::dynamics::mines::{MineSettings, Mines};
use crate::dynamics::route::Route;
use crate::dynamics::tentacles::{TentacleSettings, directions};
use crate::fields::Distance;

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
    pub look_direction: DVec3,
    /// The thrust is a plan's and acts as it is: it has the operator's speed in it, and comes in gently by itself.
    pub exact: bool,
}

/// An acceleration that no guide can mean, mm/s²: a thousand times that of gravity.
const ABSURD: f64 = 1e7;

impl GuideThrust {
    /// Takes away what is no acceleration or no direction: numbers that are not finite, and accelerations beyond all reason. What
    /// it was, if there was anything.
    pub fn sanitize(&mut self) -> Option<&'static str> {
        let absurd = |v: DVec3| !v.is_finite() || v.abs().max_element() > ABSURD;
        let mut reported = None;
        for (name, vector) in [("thrust", &mut self.thrust), ("wall force", &mut self.wall)] {
            if absurd(*vector) {
                (*vector, reported) = (DVec3::ZERO, Some(name));
            }
        }
        if self.limit.is_nan() || self.limit < 0.0 {
            (self.limit, reported) = (0.0, Some("limit"));
        }
        self.limit = self.limit.min(ABSURD);
        // Of any length: scaled first, so that it keeps its direction.
        let longest = self.look_direction.abs().max_element();
        if !self.look_direction.is_finite() {
            (self.look_direction, reported) = (DVec3::ZERO, Some("direction"));
        } else if longest > 0.0 && !(1e-3..1e3).contains(&longest) {
            self.look_direction = (self.look_direction / longest).normalize_or_zero();
        }
        reported
    }
}

/// A planned way and the place on it: whoever carries it is shown on the way's bar and can be taken to any place of it.
#[derive(Component, Clone, Debug)]
#[require(GuideThrust)]
pub struct Planned {
    /// The way.
    pub route: Arc<Route>,
    /// Place along the way, mm.
    pub s_mm: f64,
    /// The view is directed at the way this far ahead, mm.
    pub look_ahead_mm: f64,
    /// How often the operator has taken the camera elsewhere: nothing of how the body was moving is left then.
    pub jumps: u32,
}

impl Planned {
    /// A way that nobody has taken up yet.
    pub fn new(route: Arc<Route>, look_ahead_mm: f64) -> Self {
        Self { route, s_mm: 0.0, look_ahead_mm, jumps: 0 }
    }
}

/// On a camera whose guide moves it by itself: its flight is watched. A guide that leaves all to the operator has none.
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct Automatic;

/// A field of distances that a guide shares with the step.
pub type Field = Arc<dyn Distance + Send + Sync>;

/// The paper's `V(x)`, for any guide that steers by it: acts on the body beside [`GuideThrust`], and as a force that varies within a step, so that an
/// implicit method knows its stiffness. The target's pull is taken back while the operator's hand is on; the wall's push
/// acts always.
#[derive(Component, Clone)]
#[require(GuideThrust)]
pub struct PotentialField {
    /// `C_t`, `C_s`, `p`.
    pub potential: Potential,
    /// `D_s`.
    pub wall: Field,
    /// `D_t`; none while there is no target.
    pub target: Option<Field>,
}

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
}

impl Tentacles {
    /// Tentacles that have felt nothing yet.
    pub fn new(settings: TentacleSettings) -> Self {
        let directions = directions(settings.count.max(3));
        Self { lengths: vec![0.0; directions.len()], directions, settings }
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
