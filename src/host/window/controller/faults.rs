//! What plug-ins do wrong in a window: told, and gone on without.

use std::time::Instant;

use super::{FAULT_MESSAGE, FlightController};
use crate::components::input::FlightCommand;
use crate::error::{Error, Kind, Result};
use crate::output;

impl FlightController {
    /// Recovers from a panic of a plug-in: reports it and continues without the plug-in.
    ///
    /// # Errors
    /// Returns any other error.
    pub(super) fn recover(&mut self, e: Error, now: Instant) -> Result<()> {
        if e.kind != Kind::Fault {
            return Err(e);
        }
        self.report_fault(&e, now);
        let guide = self.flight.setup().scene.guide_name();
        if self.flight.app().inspect().is_off(guide) {
            let by_hand = self.flight.setup().scene.guides.iter().find(|g| !g.automatic).map(|g| g.name);
            if let Some(by_hand) = by_hand {
                self.flight.act(FlightCommand::Guide(by_hand.to_owned()))?;
            }
        }
        Ok(())
    }

    /// Reports that the scene makes no picture. That is shown until it makes one, and does not keep the window awake.
    pub(super) fn miss_picture(&mut self, e: &Error, now: Instant) {
        if self.pictureless.is_none() {
            self.report_fault(e, now);
            self.pictureless = Some(fault_text(e));
        }
    }

    pub(super) fn report_fault(&mut self, e: &Error, now: Instant) {
        let text = fault_text(e);
        // An error that recurs in every step is printed once.
        if self.reported.insert(text.clone()) {
            output::to_stderr(format_args!("note: {text}"));
        }
        self.message = Some((text, now + FAULT_MESSAGE));
        self.attention = true;
        self.quiet = 0;
    }
}

/// Returns a fault of a plug-in in words.
fn fault_text(e: &Error) -> String {
    format!("{}: {}; continuing without it", e.what, e.why)
}
