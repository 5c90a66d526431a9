//! The operator's hand.

use std::collections::VecDeque;

use bevy_ecs::prelude::*;
use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::dynamics::hand;

/// One act of the operator, as it is recorded and replayed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Command {
    /// Pushes along right, up, forward of the view, each −1 to 1, until the next `Push`.
    Push([f64; 3]),
    /// Turns about up (to the right), right (upwards) and forward (clockwise), each −1 to 1, until the next `Turn`.
    Turn([f64; 3]),
    /// Turns the view once, degrees to the right and upwards (a mouse move).
    Look([f64; 2]),
    /// Rolls the view once, degrees clockwise (a mouse move).
    Roll(f64),
    /// Sets the view angle over the picture's shorter side, degrees, held to what the camera can show. It is a matter of
    /// the picture alone: a flight without one takes note of nothing.
    ViewAngle(f64),
    /// Stops to look around, or goes on.
    Pause(bool),
    /// Cruise speed as a multiple of the scene's.
    Speed(f64),
    /// Swaps the ends and turns round.
    Reverse,
    /// Hands over to another guide.
    Guide(String),
    /// Flies another segment of the lumen, counted from 0, from the end nearer to the rectum.
    Segment(usize),
    /// Sets out anew in the same segment, from the end that the flight was going to.
    OtherEnd,
    /// Goes to a share of the way, 0 to 1: of the plan, or without one of the way that was flown.
    Seek(f64),
    /// Takes the camera to a place of the lumen, world mm, looking so.
    Go {
        /// World, mm.
        to: [f64; 3],
        /// View direction.
        forward: [f64; 3],
        /// Up direction.
        up: [f64; 3],
    },
    /// Takes the flight up again after the guide called for help.
    Resume,
}

/// A command and the step before which it acts.
///
/// ```
/// use colvis::components::input::{Act, Command};
///
/// // A line of `--record-input`: from step 240 on the hand pushes to the right.
/// let act: Act = serde_json::from_str(r#"{"tick": 240, "command": {"push": [1.0, 0.0, 0.0]}}"#)?;
/// assert_eq!(act, Act { tick: 240, command: Command::Push([1.0, 0.0, 0.0]) });
/// # Ok::<(), serde_json::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Act {
    /// Step.
    pub tick: u64,
    /// What the operator did.
    pub command: Command,
}

/// Commands for the coming step, in order.
#[derive(Resource, Default, Debug)]
pub struct Inbox(pub VecDeque<Command>);

/// What the operator's hand asks for now.
#[derive(Component, Clone, Copy, Debug)]
pub struct Hand {
    /// Right, up, forward, each −1 to 1.
    pub push: DVec3,
    /// Yaw, pitch, roll, each −1 to 1.
    pub turn: DVec3,
    /// Whether the flight is paused.
    pub paused: bool,
    /// Multiple of the scene's cruise speed.
    pub speed: f64,
    /// Until this tick the hand counts as on: the guide does not thrust.
    pub on_until: u64,
    /// Until this tick the view is turned aside by the operator: it does not turn back to the way.
    pub looking_until: u64,
    /// Until this tick the operator has turned the view in any way. A roll alone does not keep the view from following the
    /// way, and stays when it does.
    pub turned_until: u64,
    /// Acceleration from the push, world mm/s².
    pub acceleration: DVec3,
    /// Angular velocity that the turn asks for, world rad/s.
    pub turning: DVec3,
    /// How much of the flight the guide has, 0 to 1: it goes and comes again gradually.
    pub guided: f64,
}

impl Default for Hand {
    fn default() -> Self {
        Self {
            push: DVec3::ZERO,
            turn: DVec3::ZERO,
            paused: false,
            speed: 1.0,
            on_until: 0,
            looking_until: 0,
            turned_until: 0,
            acceleration: DVec3::ZERO,
            turning: DVec3::ZERO,
            guided: 1.0,
        }
    }
}

impl Hand {
    /// What the guide's thrust is multiplied by: the operator's speed, eased in and out with the hand-over.
    pub fn pace(&self) -> f64 {
        self.speed * self.share()
    }

    /// How much of its thrust the guide has, 0 to 1.
    pub fn share(&self) -> f64 {
        hand::share(self.guided)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recordings_old_and_new_are_read_and_written_alike() {
        let old = include_str!("../../tests/inputs/hand.jsonl");
        let new = [
            r#"{"tick":1,"command":{"roll":-35.0}}"#,
            r#"{"tick":2,"command":{"view_angle":40.0}}"#,
            r#"{"tick":3,"command":{"turn":[0.0,0.0,-1.0]}}"#,
        ];
        for line in old.lines().chain(new) {
            let act: Act = serde_json::from_str(line).unwrap();
            assert_eq!(serde_json::to_string(&act).unwrap(), line);
        }
    }
}
