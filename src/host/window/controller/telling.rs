//! The kinds of gas in a flight: shown, clicked on, and changed by the reader.

use std::time::Instant;

use glam::DVec3;

use super::{FlightController, which_segment};
use crate::app::flight::Onward;
use crate::components::flight::State;
use crate::fields::lumen::GasKind;
use crate::host::window::kinds::{Found, name};

impl FlightController {
    /// Shows or hides the kinds of gas in the slices.
    pub(crate) fn show_kinds(&mut self, shown: bool, now: Instant) {
        self.kinds.show(shown, &self.flight, &self.background, now);
        self.colour_slices();
        let told = match (shown, self.kinds.tint()) {
            (false, _) => "kinds of gas: hidden",
            (true, None) => "finding the kinds of gas ...",
            (true, Some(_)) => "kinds of gas: click on a body in a slice to change its kind",
        };
        self.say(told, now);
    }

    pub(super) fn colour_slices(&mut self) {
        self.slices.tint(self.kinds.tint());
        self.quiet = 0;
        self.attention = true;
    }

    /// Chooses the body of gas at a place, if kinds are shown.
    pub(super) fn choose_body(&mut self, place: DVec3, now: Instant) {
        if !self.kinds.is_shown() {
            return;
        }
        if let Some(told) = self.kinds.choose(place, self.flight.setup().volume.voxels()) {
            self.say(told, now);
        }
        self.colour_slices();
    }

    /// Gives a kind to the chosen body of gas, or takes back what was given.
    pub(crate) fn tell_kind(&mut self, kind: Option<GasKind>, now: Instant) {
        if self.kinds.tell(kind, &self.flight, &self.background, now) {
            let what = kind.map_or("automatic", name);
            self.say(format!("{what}: updating the lumen ..."), now);
            self.note_changes(now);
        } else {
            self.say("it has that kind already", now);
        }
        self.colour_slices();
    }

    /// Takes the kinds that were found, and lets the flight go on in its new lumen.
    pub(super) fn take_kinds(&mut self, now: Instant) {
        let Some(Found { anew, told, .. }) = self.kinds.take(now) else { return };
        self.colour_slices();
        let Some((lumen, fields)) = anew else {
            return self.say("kinds of gas: click on a body in a slice to change its kind", now);
        };
        let arrived = self.flight.flight().state == State::Arrived;
        let text = match self.flight.tell(lumen, told, fields) {
            Err(e) => format!("the flight keeps its lumen: {}: {}", e.what, e.why),
            Ok(onward) => {
                let segments = self.flight.setup().lumen.segments.len();
                let all = if segments == 1 { "1 segment".to_owned() } else { format!("{segments} segments") };
                let here = which_segment(self.flight.setup().plan.segment.unwrap_or(0), segments);
                match onward {
                    Onward::Same(_) if self.unflown.is_some() => {
                        format!("the lumen has {all} now: double-click into it to start there")
                    }
                    Onward::Same(_) if arrived => {
                        format!("the lumen has {all} now{}", self.actions.hint("next", "flies to the next"))
                    }
                    Onward::Same(_) => format!("the lumen has {all} now; the flight continues in its segment"),
                    Onward::Changed(_) => {
                        format!("the flown gas has changed: starting again in the {here}")
                    }
                    Onward::Elsewhere(_) => {
                        let undo = self.actions.hint("undo", "undoes it");
                        format!("this gas is no longer colon: starting in the {here}{undo}")
                    }
                    Onward::Nowhere => "no gas is left that may be colon: the flight keeps its lumen".to_owned(),
                }
            }
        };
        self.say(text, now);
        self.figures.touch();
    }
}
