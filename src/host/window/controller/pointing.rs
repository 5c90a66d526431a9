//! What is pointed at: one place that all views show, distances, and where the camera is taken.

use std::time::Instant;

use glam::DVec3;

use super::{FlightController, recordable};
use crate::components::camera::Pose;
use crate::components::input::{FlightCommand, HandCommand};
use crate::components::output::Picture;
use crate::components::slices::Orientation;
use crate::error::Result;
use crate::host::window::actions::ActionContext;
use crate::host::window::measures::Measures;
use crate::host::window::panels::SliceInput;
use crate::host::window::slices::Slices;
use crate::host::window::travel::Travel;
use crate::render::first_crossing;

impl FlightController {
    /// The slices that are shown.
    pub fn slices(&self) -> &Slices {
        &self.slices
    }

    /// Effect what a panel asks of the slices. Pointing at a place stops a flight that goes by itself.
    pub fn slice(&mut self, request: SliceInput, now: Instant) {
        let points = match request {
            SliceInput::Click(place) if self.measures.is_on() => return self.measure(place, now),
            // A drag that began with an end of a measure.
            SliceInput::Point(_) if self.measures.is_on() => return,
            SliceInput::Click(place) | SliceInput::Point(place) => Some(place),
            SliceInput::Scroll(..) => None,
            SliceInput::Pan(..) | SliceInput::Zoom(..) | SliceInput::Window(_) => {
                self.slices.ask(&mut self.flight, request);
                self.attention = true;
                return;
            }
        };
        self.stop(now);
        self.slices.ask(&mut self.flight, request);
        // Where the camera can be it goes along.
        if let Some(place) = points.filter(|_| self.flight.scene().play().is_none()) {
            self.go(place, now);
        }
        self.attention = true;
        self.quiet = 0;
    }

    /// Takes the camera to a place of the lumen where it fits, in another segment too; anywhere else it stays.
    fn go(&mut self, place: DVec3, now: Instant) {
        let Some(segment) = self.flight.lumen().segment_at(place) else { return };
        let other = self.flight.plan().segment.is_some_and(|s| s != segment);
        if other && !self.act(FlightCommand::Segment(segment), now) {
            return;
        }
        if other {
            self.say(format!("segment {} of {}", segment + 1, self.flight.lumen().segments.len()), now);
        }
        let pose = Pose { position: place, ..self.flight.pose() };
        if self.flight.act(go_to(pose)).is_ok() {
            self.travel = None;
        }
        // Where the camera came along is no place that it left.
        self.slices.point(&self.flight, place);
    }

    /// Whether something is drawn in the picture that is no part of what it says.
    pub fn has_marks(&self) -> bool {
        let measures = !self.measures.list().is_empty() || self.measures.begun().is_some();
        measures || self.slices.cursor().is_some()
    }

    /// Stops a flight that goes by itself, also one that has arrived or calls: where the camera is taken it stays.
    fn stop(&mut self, now: Instant) {
        if !self.is_by_hand() && !self.hand().paused && self.flight.scene().play().is_none() {
            self.act(HandCommand::Pause(true), now);
        }
    }

    /// What was measured.
    pub fn measures(&self) -> &Measures {
        &self.measures
    }

    /// Takes up what was measured the last time that this scan was open.
    pub fn set_measures(&mut self, measures: Measures) {
        self.measures = measures;
    }

    /// Has clicks measure, or not.
    pub fn switch_measuring(&mut self, at: ActionContext) {
        self.measures.switch();
        if self.measures.is_on() {
            self.stop(at.now);
            self.say("click both ends, in the flight or in a slice", at.now);
        }
    }

    /// Takes the last change of what was measured back.
    pub fn undo_measure(&mut self, at: ActionContext) {
        let kept = self.measures.undo();
        self.report_kept(kept, at.now);
    }

    /// Takes the last measure away.
    pub fn delete_last_measure(&mut self, at: ActionContext) {
        let kept = self.measures.delete_last();
        self.report_kept(kept, at.now);
    }

    fn measure(&mut self, place: DVec3, now: Instant) {
        self.attention = true;
        self.slices.point(&self.flight, place);
        match self.measures.click(place) {
            Ok(Some(made)) => self.say(made.text(), now),
            Ok(None) => {}
            Err(e) => self.report_kept(Err(e), now),
        }
    }

    /// Says that a measure is there for now alone.
    pub(super) fn report_kept(&mut self, kept: Result<()>, now: Instant) {
        if let Err(e) = kept {
            self.say(format!("not saved: {}: {}", e.what, e.why), now);
        }
    }

    /// The place of the wall that is seen at a point of the picture, pixels.
    fn seen(&self, [x, y]: [f64; 2]) -> Option<DVec3> {
        let view = self.flight.camera::<Picture>()?.view.as_ref()?;
        let ray = view.ray_at(x, y)?;
        let mm = first_crossing(self.flight.volume(), ray.origin, ray.direction, f64::INFINITY)?;
        Some(ray.origin + ray.direction * mm)
    }

    /// A click on the wall: an end of a measure, or the place that all views show.
    pub(super) fn click(&mut self, at: [f64; 2], now: Instant) {
        let Some(place) = self.seen(at) else { return };
        if self.measures.is_on() {
            return self.measure(place, now);
        }
        self.stop(now);
        self.slices.point(&self.flight, place);
        self.attention = true;
        self.quiet = 0;
    }

    /// Flies to a place of the wall that is seen, and looks at it.
    pub(super) fn look_at(&mut self, at: [f64; 2], now: Instant) {
        let Some(place) = self.seen(at).filter(|_| self.flight.scene().play().is_none()) else { return };
        self.stop(now);
        self.slices.point(&self.flight, place);
        self.travel = Some(Travel::to_look_at(self.flight.pose(), place, now));
        self.quiet = 0;
    }

    /// Takes the camera on to where it is being taken.
    pub(super) fn go_on(&mut self, now: Instant) {
        let Some(travel) = &self.travel else { return };
        let (pose, over) = travel.at(now);
        // Where it does not fit it stays: it looks from as near as it comes.
        if self.flight.act(go_to(pose)).is_err() || over {
            self.travel = None;
        }
        self.quiet = 0;
    }

    /// Sets the window of greys: its level and width, HU.
    pub fn window(&mut self, level: f64, width: f64) {
        self.slices.window(level, width);
    }

    /// The slices as they were at the beginning.
    pub fn reset_slices(&mut self, _: ActionContext) {
        self.slices.reset(&mut self.flight);
    }

    /// Thicker slices, and after the thickest one the plane alone.
    pub fn next_slab(&mut self, _: ActionContext) {
        self.slices.next_slab();
    }

    /// The mean, the greatest or the least of a thick slice.
    pub fn next_slab_kind(&mut self, _: ActionContext) {
        self.slices.next_slab_kind();
    }

    /// Whether a slice is shown.
    pub fn shows_slices(&self) -> bool {
        Orientation::ALL.iter().any(|o| self.slices.entity(*o).is_some())
    }
}

fn go_to(pose: Pose) -> FlightCommand {
    let [to, forward, up] =
        [pose.position, pose.attitude.forward, pose.attitude.up].map(|v| v.to_array().map(recordable));
    FlightCommand::Go { to, forward, up }
}
