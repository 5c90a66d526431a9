//! Pointing: the place that all views show, measures, and animated moves of the camera.

use std::time::Instant;

use glam::DVec3;

use super::{FlightController, recordable, which_segment};
use crate::components::camera::Pose;
use crate::components::input::{FlightCommand, HandCommand};
use crate::components::output::Picture;
use crate::components::slices::Orientation;
use crate::host::window::intent::{Intent, SliceInput};
use crate::host::window::travel::Travel;
use crate::space::first_crossing;

impl FlightController {
    /// Executes a pointer's input to a slice. Pointing at a place pauses a flight that moves automatically. Returns what is left for
    /// the window to do: start a flight, where there is none.
    pub(crate) fn slice(&mut self, request: SliceInput, now: Instant) -> Option<Intent> {
        let points = match request {
            SliceInput::Click(place) | SliceInput::SetOut(place) if self.measures.is_on() => {
                self.measure(place, now);
                return None;
            }
            SliceInput::Click(place) | SliceInput::SetOut(place) if self.measures_lesions() => {
                self.measure_lesion(place, now);
                return None;
            }
            // A drag that began at a place that was measured.
            SliceInput::Point(_) if self.measures.is_on() || self.measures_lesions() => return None,
            SliceInput::Click(place)
            | SliceInput::Point(place)
            | SliceInput::SetOut(place)
            | SliceInput::GoTo(place, _) => Some(place),
            SliceInput::Scroll(..) => None,
            SliceInput::Pan(..) | SliceInput::Zoom(..) | SliceInput::Window(_) => {
                self.slices.ask(&mut self.flight, request);
                self.attention = true;
                return None;
            }
        };
        self.stop(now);
        if let SliceInput::Click(place) = request {
            self.choose_body(place, now);
        }
        self.slices.ask(&mut self.flight, request);
        // If the camera fits there, it moves along.
        if let Some(place) = points.filter(|_| self.flight.setup().scene.play().is_none()) {
            self.go(place, now);
        }
        self.attention = true;
        self.quiet = 0;
        if let SliceInput::SetOut(place) = request { self.set_out_at(place, now) } else { None }
    }

    /// Moves the camera to a place in the lumen (world mm) if it fits there, even in another segment. Otherwise it stays.
    fn go(&mut self, place: DVec3, now: Instant) {
        let Some(segment) = self.flight.setup().lumen.segment_at(place) else { return };
        let other = self.flight.setup().plan.segment.is_some_and(|s| s != segment);
        if other && !self.act(FlightCommand::Segment(segment), now) {
            return;
        }
        if other {
            self.say(which_segment(segment, self.flight.setup().lumen.segments.len()), now);
        }
        let pose = Pose { position: place, ..self.flight.pose() };
        if self.flight.act(go_to(pose)).is_ok() {
            self.travel = None;
        }
        // The camera moved along, so it has not left the place.
        self.slices.point(&self.flight, place);
    }

    /// Pauses a flight that moves automatically, even if it has arrived or calls the operator, so that the camera stays where it
    /// is moved to.
    pub(super) fn stop(&mut self, now: Instant) {
        if !self.is_by_hand() && !self.hand().paused && self.flight.setup().scene.play().is_none() {
            self.act(HandCommand::Pause(true), now);
        }
    }

    #[cfg(test)]
    pub(crate) fn measure_between(&mut self, from: DVec3, to: DVec3) {
        for at in [from, to] {
            self.measures.click(at);
        }
        self.note_changes(Instant::now());
    }

    /// Switches measuring by clicks on or off.
    pub(super) fn switch_measuring(&mut self, now: Instant) {
        self.measures.switch();
        if self.measures.is_on() {
            self.leave_lesions();
            self.stop(now);
            self.say("click both ends, in the flight or in a slice", now);
        }
    }

    fn measure(&mut self, place: DVec3, now: Instant) {
        self.attention = true;
        self.slices.point(&self.flight, place);
        match self.measures.click(place) {
            Some(made) => {
                self.say(made.text(), now);
                if self.takes_diameter([made.from, made.to], now) {
                    self.measures.delete_last();
                    self.switch_measuring(now);
                }
                self.note_changes(now);
            }
            None => self.document.note_begun(),
        }
    }

    /// Returns the visible point of the wall at a pixel of the picture.
    pub(super) fn place_at(&self, [x, y]: [f64; 2]) -> Option<DVec3> {
        let view = self.flight.camera::<Picture>()?.view.as_ref()?;
        let ray = view.ray_at(x, y)?;
        let mm = first_crossing(self.flight.shown_scan(), ray.origin, ray.direction, f64::INFINITY)?;
        Some(ray.origin + ray.direction * mm)
    }

    /// Handles a click on the wall: it sets an end of a measure, or the place that all views show.
    pub(super) fn click(&mut self, at: [f64; 2], now: Instant) {
        let Some(place) = self.place_at(at) else { return };
        if self.measures.is_on() {
            return self.measure(place, now);
        }
        if self.measures_lesions() {
            return self.measure_lesion(place, now);
        }
        self.stop(now);
        self.slices.point(&self.flight, place);
        self.attention = true;
        self.quiet = 0;
    }

    /// Flies towards a visible point of the wall and looks at it.
    pub(super) fn look_at(&mut self, at: [f64; 2], now: Instant) {
        if self.flight.setup().scene.play().is_some() {
            return self.say("a log is replayed: the camera goes where it went", now);
        }
        let Some(place) = self.place_at(at) else { return self.say("no wall there to fly to", now) };
        self.stop(now);
        self.slices.point(&self.flight, place);
        self.travel = Some(Travel::to_look_at(self.flight.pose(), place, now));
        self.quiet = 0;
    }

    /// Advances the animated move of the camera.
    pub(super) fn go_on(&mut self, now: Instant) {
        let Some(travel) = &self.travel else { return };
        let (pose, over) = travel.at(now);
        // If it does not fit, it stops at the last position that did and looks from there.
        let fits = self.flight.act(go_to(pose)).is_ok();
        if !fits {
            self.say("as near as the camera can get", now);
        }
        if !fits || over {
            self.travel = None;
        }
        self.quiet = 0;
    }

    /// True if a slice is shown.
    pub(crate) fn shows_slices(&self) -> bool {
        Orientation::ALL.iter().any(|o| self.slices.entity(*o).is_some())
    }
}

pub(super) fn go_to(pose: Pose) -> FlightCommand {
    let [to, forward, up] =
        [pose.position, pose.attitude.forward, pose.attitude.up].map(|v| v.to_array().map(recordable));
    FlightCommand::Go { to, forward, up }
}
