//! The readings and decisions of guides.

use std::sync::Arc;

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::dynamics::Potential;
use crate::dynamics::mines::{MineSettings, Mines};
use crate::dynamics::route::Route;
use crate::dynamics::tentacles::{TentacleSettings, directions};
use crate::fields::Distance;

/// The output of a guide: the interface between any navigation method and the forces.
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct GuideThrust {
    /// Acceleration along the path, world mm/s². Withdrawn during operator input and while the flight is paused.
    pub thrust: DVec3,
    /// Limit on the thrust and the mines together, mm/s²: the value that drag balances at cruise speed.
    pub limit: f64,
    /// Acceleration away from the wall, world mm/s². Always acts.
    pub wall: DVec3,
    /// Unit direction of the path ahead, world; zero if the guide knows none. The view turns there.
    pub look_direction: DVec3,
    /// True if the thrust is that of a plan and acts unchanged: it already includes the operator's speed and starts gently.
    pub exact: bool,
}

/// Acceleration that no guide can intend, mm/s²: a thousand times that of gravity.
const ABSURD: f64 = 1e7;

impl GuideThrust {
    /// The name of an invalid direction.
    pub(crate) const DIRECTION: &'static str = "direction";

    /// Removes invalid accelerations and directions: values that are not finite, and accelerations that are absurdly large.
    ///
    /// Returns the name of the invalid value, if there was one.
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
        // The length is arbitrary. Scale it first, so that the direction is kept.
        let longest = self.look_direction.abs().max_element();
        if !self.look_direction.is_finite() {
            (self.look_direction, reported) = (DVec3::ZERO, Some(Self::DIRECTION));
        } else if longest > 0.0 && !(1e-3..1e3).contains(&longest) {
            self.look_direction = (self.look_direction / longest).normalize_or_zero();
        }
        reported
    }
}

/// A planned path and the position on it.
///
/// An entity with this component is shown on the progress bar and can be moved to any position along the path.
#[derive(Component, Clone, Debug)]
#[require(GuideThrust)]
pub struct Planned {
    /// The path.
    pub route: Arc<Route>,
    /// Position along the path, mm.
    pub s_mm: f64,
    /// Distance ahead on the path that the view is directed at, mm.
    pub look_ahead_mm: f64,
    /// How often the operator has moved the camera to another position. A jump discards the body's previous motion.
    pub jumps: u32,
}

impl Planned {
    /// Creates a plan at the start of its route.
    pub fn new(route: Arc<Route>, look_ahead_mm: f64) -> Self {
        Self { route, s_mm: 0.0, look_ahead_mm, jumps: 0 }
    }
}

/// How far along the way the view reaches: see [`look_along_way`](crate::systems::looks::way::look_along_way).
#[derive(Component, Clone, Copy, Debug, PartialEq)]
#[require(GuideThrust)]
pub struct Gaze {
    /// Distance along the way to the place that is looked at, mm.
    pub reach_mm: f64,
    /// The number of jumps of the plan handled so far; `None` before the first look.
    pub jumps: Option<u32>,
}

impl Default for Gaze {
    fn default() -> Self {
        Self { reach_mm: Self::MOST_MM, jumps: None }
    }
}

impl Gaze {
    /// Minimum distance along the way that is looked at, mm: a nearer place has no steady direction.
    pub const LEAST_MM: f64 = 6.0;
    /// Maximum distance along the way that is looked at, mm.
    pub const MOST_MM: f64 = 80.0;
    /// With a shorter reach the flight slows down, mm …
    const SLOW_MM: f64 = 25.0;
    /// … at most to this share of its speed.
    const SLOWEST: f64 = 0.4;

    /// Returns the share of its speed at which a flight should go: less before a wall, where the view must turn first.
    pub fn pace(&self) -> f64 {
        (self.reach_mm / Self::SLOW_MM).clamp(Self::SLOWEST, 1.0)
    }
}

/// Marks a camera that its guide moves automatically; its flight is watched. Absent if the guide leaves everything to the operator.
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct Automatic;

/// A distance field that a guide shares with the step.
pub type Field = Arc<dyn Distance + Send + Sync>;

/// The paper's `V(x)`, for any guide that steers by it.
///
/// It acts on the body in addition to [`GuideThrust`], as a force that varies within a step, so an implicit method knows
/// its stiffness. The target's pull is withdrawn during operator input; the wall's push always acts.
#[derive(Component, Clone)]
#[require(GuideThrust)]
pub struct PotentialField {
    /// `C_t`, `C_s`, `p`.
    pub potential: Potential,
    /// `D_s`.
    pub wall: Field,
    /// `D_t`; `None` while there is no target.
    pub target: Option<Field>,
}

/// Sensory rays and their last readings.
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
    /// Creates tentacles without readings.
    pub fn new(settings: TentacleSettings) -> Self {
        let directions = directions(settings.count.max(3));
        Self { lengths: vec![0.0; directions.len()], directions, settings }
    }

    /// Returns the size in memory, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.directions.as_slice()) + size_of_val(self.lengths.as_slice())
    }
}

/// The mines behind the camera.
#[derive(Component, Clone, Debug)]
#[require(MinePush)]
pub struct MineField {
    /// Settings.
    pub settings: MineSettings,
    /// The mines.
    pub mines: Mines,
}

/// Acceleration from the mines, world mm/s².
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct MinePush(pub DVec3);
