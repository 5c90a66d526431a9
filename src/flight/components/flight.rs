//! The goal and the state of a flight.

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::dynamics::monitor::MonitorSettings;
use crate::dynamics::rescue::Rescue;

/// The state of a flight, as written to the log.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum State {
    /// On the way.
    #[default]
    Flying,
    /// At the goal.
    Arrived,
    /// The guide calls for the operator.
    Operator,
    /// The simulated time is over.
    Ended,
}

/// The state of the flight, with the reason and the position of a call for help.
#[derive(Component, Clone, Debug, Default)]
pub struct Flight {
    /// State.
    pub state: State,
    /// Why help is needed; empty otherwise.
    pub reason: String,
    /// Where help is needed, or where the flight arrived or ended, world mm.
    pub place: DVec3,
    /// Distance flown, mm.
    pub length_mm: f64,
    /// Number of times the camera turned round at a dead end since the flight set out.
    pub turns: u32,
    /// Number of places at which the guide looked for another direction since the flight set out.
    pub escapes: u32,
}

/// The goal of the flight.
#[derive(Component, Clone, Copy, Debug)]
pub struct Goal {
    /// Position, world mm.
    pub at: DVec3,
    /// Distance from `at` within which the camera has arrived, mm.
    pub within_mm: f64,
    /// The lumen's other end, world mm. A dead end there means that the flight set out in the wrong direction.
    pub other_end: DVec3,
}

/// The message shown on arrival if the goal differs from the requested end; `None` if they coincide.
#[derive(Component, Clone, Debug, Default)]
pub struct GoalMissed(pub Option<String>);

/// The current segment of the lumen, and the segments flown so far.
#[derive(Component, Clone, Debug, Default)]
pub struct Flown {
    /// The segment being flown; `None` in gas that belongs to no segment of the lumen.
    pub segment: Option<usize>,
    /// Segments flown to their end.
    pub done: Vec<usize>,
}

impl Flown {
    /// Marks the current segment as flown if the flight has arrived.
    pub fn note(&mut self, state: State) {
        if let Some(n) = self.segment.filter(|n| state == State::Arrived && !self.done.contains(n)) {
            self.done.push(n);
        }
    }
}

/// A guide's call for help that has not been answered yet.
///
/// The guide itself may answer it in the set [`Answer`](crate::schedule::FlightSystems::Answer); otherwise the operator does.
#[derive(Component, Clone, Debug, Default)]
pub struct HelpCall(pub Option<Help>);

/// The reason and the position of a call for help.
#[derive(Clone, Debug, PartialEq)]
pub struct Help {
    /// The reason, as shown to the operator.
    pub reason: String,
    /// Position, world mm.
    pub place: DVec3,
}

/// The operator has taken over, or has moved the camera: what was counted or laid on the way so far no longer applies.
///
/// Each system observes it for its own components.
#[derive(EntityEvent, Clone, Copy, Debug)]
pub struct TakenOver {
    /// The camera.
    pub entity: Entity,
}

/// A guide has answered a call for help itself. The flight continues, and its progress is measured from here.
#[derive(EntityEvent, Clone, Copy, Debug)]
pub struct HelpAnswered {
    /// The camera.
    pub entity: Entity,
}

/// The flight sets off again, to leave a trap.
#[derive(EntityEvent, Clone, Copy, Debug)]
pub struct SetOff {
    /// The camera.
    pub entity: Entity,
    /// The new unit heading, world; `None` keeps the current one.
    pub heading: Option<DVec3>,
    /// True if the mines are cleared, so that they cannot hold the camera.
    pub clear_mines: bool,
}

/// Detects a flight that makes no progress.
#[derive(Component, Clone, Debug)]
#[require(HelpCall)]
pub struct Watch {
    /// Settings.
    pub settings: MonitorSettings,
    /// Detection and recovery.
    pub rescue: Rescue,
}
