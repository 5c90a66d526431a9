//! The colon laid flat in a flight: it follows the camera, and what is clicked on it is looked at in all views.

use std::time::Instant;

use super::FlightController;
use crate::components::camera::Pose;
use crate::dynamics::Attitude;
use crate::host::window::flat::{Flat, FlatInput};
use crate::host::window::intent::Intent;
use crate::render::{Frame, ImageSize};

impl FlightController {
    /// Does what a reader wants of the colon laid flat.
    pub(super) fn flat_input(&mut self, input: FlatInput, now: Instant) -> Option<Intent> {
        match input {
            FlatInput::Show => self.flat.want(&self.flight, &self.cleansing, &self.background, now),
            FlatInput::Scroll(share) => {
                let size = ImageSize::new(self.flat.frame().width(), self.flat.frame().height());
                self.flat.scroll(share, size, self.followed());
                self.attention = true;
            }
            FlatInput::Visit(pixel) => {
                let [place, middle] = self.flat.place(pixel, self.flat.frame().width())?;
                self.stop(now);
                self.travel = None;
                // From the middle of the lumen, as upright as the camera is now.
                let forward = (place - middle).try_normalize().unwrap_or(self.flight.pose().attitude.forward);
                let attitude = Attitude::new(forward, self.flight.pose().attitude.up);
                let pose = Pose { position: middle, attitude };
                let is_played = self.flight.setup().scene.play().is_some();
                if !is_played && !self.go_where_seen(pose, place, now) {
                    self.say("the flight cannot go to where that is seen", now);
                }
                self.slices.aim(&self.flight, place, 0.0);
                (self.quiet, self.attention) = (0, true);
                self.figures.touch();
            }
        }
        None
    }

    /// Returns what the map follows, world mm: the place that is pointed at, or the camera.
    fn followed(&self) -> glam::DVec3 {
        self.slices.cursor().unwrap_or(self.flight.pose().position)
    }

    /// Draws the map for its panel. Returns true if the picture is new.
    pub(crate) fn draw_flat(&mut self, size: ImageSize) -> bool {
        let at = self.followed();
        let along_mm = self.place.along_of(at).map(|a| a.mm);
        let is_scanned = self.cleansing.is_shown_as_scanned();
        self.flat.draw(&self.flight, is_scanned, (at, along_mm), size)
    }

    /// Returns the map as it was drawn last.
    pub(crate) fn flat_frame(&self) -> &Frame {
        self.flat.frame()
    }

    /// Returns the colon laid flat.
    pub(crate) fn own_flat(&self) -> &Flat {
        &self.flat
    }
}
