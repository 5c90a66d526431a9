//! Commands of panels and of actions of other crates.

use std::path::PathBuf;
use std::time::Instant;

use super::{FlightController, recordable};
use crate::components::input::{Command, FlightCommand};
use crate::host::window::contract::Context;
use crate::host::window::intent::Intent;
use crate::host::window::overlay::HudState;

/// Longest message of another crate, characters.
const LONGEST: usize = 200;

impl FlightController {
    /// Executes a command, or tells why it is refused.
    pub(crate) fn command(&mut self, mut command: Command, now: Instant) {
        let mut is_finite = true;
        command.each_number(|x| {
            is_finite &= x.is_finite();
            *x = recordable(*x);
        });
        if !is_finite {
            // It would not be read back from a recording.
            self.say(format!("{}: one of its numbers is not finite", name_of(&command)), now);
            return;
        }
        match command {
            Command::Flight(FlightCommand::Guide(name)) => {
                match self.flight.setup().scene.guides.named(&name).map(|g| g.name) {
                    // What it needs is built while the flight goes on.
                    Some(guide) => self.hand_over(guide, now),
                    None => _ = self.act(FlightCommand::Guide(name), now),
                }
            }
            Command::Flight(FlightCommand::ViewAngle(degrees)) => self.change_angle(degrees, now),
            other => _ = self.act(other, now),
        }
    }

    /// Shows a message of another crate: its first line, shortened.
    pub(crate) fn say_for(&mut self, text: &str, now: Instant) {
        let line = text.lines().next().unwrap_or_default();
        self.say(line.chars().filter(|c| !c.is_control()).take(LONGEST).collect::<String>(), now);
    }

    /// Runs the action of another crate with this number. Returns what it asks for; `None` if it has not begun.
    pub(crate) fn begin_own(&mut self, n: usize, recent: &[PathBuf]) -> Option<Vec<Intent>> {
        let hud = HudState::default();
        let asked = self.own.begin(n, &Context::new(self, &self.actions, recent, &hud));
        self.attention = true;
        self.figures.touch();
        asked
    }
}

/// The name of a command in a recording.
fn name_of(command: &Command) -> String {
    match serde_json::to_value(command) {
        Ok(serde_json::Value::Object(named)) => named.keys().next().cloned().unwrap_or_default(),
        Ok(serde_json::Value::String(name)) => name,
        _ => "command".to_owned(),
    }
}
