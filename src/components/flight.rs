//! Where a flight is going and how it stands.

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::dynamics::monitor::MonitorSettings;
use crate::dynamics::rescue::Rescue;

/// How a flight stands, as the log has it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum State {
    /// On the way.
    #[default]
    Flying,
    /// At its goal.
    Arrived,
    /// The guide calls for the operator.
    Operator,
    /// The simulated time is over.
    Ended,
}

/// How the flight stands, why and where.
#[derive(Component, Clone, Debug, Default)]
pub struct Flight {
    /// State.
    pub state: State,
    /// Why help is called for; empty otherwise.
    pub reason: String,
    /// Where that was, world mm.
    pub place: DVec3,
    /// Way flown, mm.
    pub length_mm: f64,
    /// Number of times the camera turned round at a dead end, since the flight set out.
    pub turns: u32,
    /// Number of places at which the guide looked for another way, since the flight set out.
    pub escapes: u32,
}

/// Where the flight ends.
#[derive(Component, Clone, Copy, Debug)]
pub struct Goal {
    /// World mm.
    pub at: DVec3,
    /// The camera has arrived within this of `at`, mm.
    pub within_mm: f64,
    /// The lumen's other end: a dead end there means that the flight set out the wrong way. World mm.
    pub other_end: DVec3,
}

/// Why the goal is not where the flight was asked to end: what there is to say when it is reached. None where it is.
#[derive(Component, Clone, Debug, Default)]
pub struct GoalMissed(pub Option<String>);

/// Segments of the lumen and which of them were flown.
#[derive(Component, Clone, Debug, Default)]
pub struct Flown {
    /// The one being flown; none for gas that is none of the lumen's segments.
    pub segment: Option<usize>,
    /// Those flown to their end.
    pub done: Vec<usize>,
}

impl Flown {
    /// Notes the present segment as flown where the flight has arrived.
    pub fn note(&mut self, state: State) {
        if let Some(n) = self.segment.filter(|n| state == State::Arrived && !self.done.contains(n)) {
            self.done.push(n);
        }
    }
}

/// A guide's call for help that is still to be answered: by the guide itself in the set
/// [`Answer`](crate::schedule::FlightSystems::Answer), else by the operator.
#[derive(Component, Clone, Debug, Default)]
pub struct HelpCall(pub Option<Help>);

/// What help is called for.
#[derive(Clone, Debug, PartialEq)]
pub struct Help {
    /// Why, as the operator reads it.
    pub reason: String,
    /// Where, world mm.
    pub place: DVec3,
}

/// Notices when a flight gets nowhere.
#[derive(Component, Clone, Debug)]
#[require(HelpCall)]
pub struct Watch {
    /// Settings.
    pub settings: MonitorSettings,
    /// What it has seen and does about it.
    pub rescue: Rescue,
}
