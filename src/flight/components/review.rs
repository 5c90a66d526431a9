//! A review: a tour past the places of the wall that a flight has missed.

use bevy_ecs::prelude::*;
use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::guide::GuideThrust;

/// After this many stops in a row that were not reached, the operator is called: the next one would not be reached either.
const FAILS: u32 = 2;

/// A place that a review visits.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReviewStop {
    /// Position of the camera, world mm.
    pub at: [f64; 3],
    /// The place of the wall to look at from there, world mm; `null` to fly past without a pause.
    pub look_at: Option<[f64; 3]>,
}

impl ReviewStop {
    /// Creates a stop, its coordinates rounded to 0.001 mm so that a recording repeats them exactly.
    pub fn new(at: DVec3, look_at: Option<DVec3>) -> Self {
        let rounded = |p: DVec3| p.to_array().map(|x| (x * 1000.0).round() / 1000.0);
        Self { at: rounded(at), look_at: look_at.map(rounded) }
    }
}

/// A stop of the planned tour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TourStop {
    /// Position along the tour's route, mm.
    pub s_mm: f64,
    /// The place of the wall to look at, world mm; `None` to fly past.
    pub look_at: Option<DVec3>,
    /// Maximum time since the previous stop, s, so that a tour never hangs.
    pub limit_s: f64,
}

/// The tour that the camera is on: see [`look_at_stops`](crate::systems::looks::review::look_at_stops).
#[derive(Component, Clone, Debug, Default)]
#[require(GuideThrust)]
pub struct Review {
    /// The stops in the order of the tour.
    pub stops: Vec<TourStop>,
    /// Index of the stop that is next.
    pub next: usize,
    /// Number of stops that were looked at, or flown past if there is nothing to look at.
    pub reached: usize,
    /// Number of stops that are visited after those of this plan.
    pub later: usize,
    /// Number of stops in a row whose time was over before the camera got there.
    pub failed: u32,
    /// Where the camera was when the time of the last stop was over, world mm; `None` once it has got to another one.
    pub hung: Option<DVec3>,
    /// True if the rest of the tour must be planned anew, because the camera hangs.
    pub replan: bool,
    /// Time at this stop, s; `None` on the way.
    pub held_s: Option<f64>,
    /// Time since the last stop, s.
    pub spent_s: f64,
    /// Share of its speed at which the flight should go.
    pub pace: f64,
    /// The number of jumps of the plan handled so far.
    pub jumps: u32,
}

impl Review {
    /// Creates a tour at its start.
    pub fn new(stops: Vec<TourStop>) -> Self {
        Self { stops, pace: 1.0, ..Self::default() }
    }

    /// Continues from `s_mm` along the route, after the operator has moved the camera there.
    pub fn go_on_from(&mut self, s_mm: f64) {
        self.next = self.stops.iter().position(|s| s.s_mm >= s_mm).unwrap_or(self.stops.len());
        (self.held_s, self.spent_s) = (None, 0.0);
        (self.failed, self.hung, self.replan) = (0, None, false);
    }

    /// Returns the number of stops that are left.
    pub fn left(&self) -> usize {
        self.stops.len().saturating_sub(self.next) + self.later
    }

    /// Moves on to the next stop. `done` is true if this one was seen.
    pub fn leave(&mut self, done: bool) {
        self.pass(done);
        (self.failed, self.hung, self.replan) = (0, None, false);
    }

    /// Moves on to the next stop, past one that the plan has left behind.
    pub fn skip(&mut self) {
        self.pass(false);
    }

    /// Gives up the next stop, because the camera hangs at `place` (world mm). Returns true if the operator is needed: a second stop in a
    /// row was not reached.
    pub fn fail(&mut self, place: DVec3) -> bool {
        self.pass(false);
        self.hung = Some(place);
        self.failed += 1;
        self.replan = self.failed < FAILS;
        !self.replan
    }

    fn pass(&mut self, done: bool) {
        self.next += 1;
        self.reached += usize::from(done);
        (self.held_s, self.spent_s, self.pace) = (None, 0.0, 1.0);
    }
}
