//! A scan that cannot be flown: its slices are looked at, and a flight starts where the reader asks for it.

use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use winit::event_loop::ActiveEventLoop;

use super::{Shell, Stage, load};
use crate::error::{Error, Result};
use crate::host::window::controller::FlightController;
use crate::host::window::loading::Unflown;
use crate::host::window::{Resume, unflown};
use crate::progress::Progress;

impl Shell {
    /// Shows the slices of a scan that cannot be flown, and why that is so.
    pub(super) fn look(&mut self, controller: &mut FlightController, unflown: Unflown, notes: &mut Vec<String>) {
        let why = unflown::in_words(&unflown.why);
        notes.insert(0, why.clone());
        controller.rest(why, Instant::now());
        self.layout_before = self.layout_before.or(self.workspace.show_slices());
        self.unflown = Some(unflown);
    }

    /// Returns to the layout that was left to show slices, once they need not be shown.
    pub(super) fn return_to_layout(&mut self) {
        if let Some(layout) = self.layout_before.take() {
            self.workspace.choose(layout);
        }
    }

    /// Returns why the scan that the window was opened with was never flown, if it was shown without a flight.
    ///
    /// # Errors
    /// Returns that reason.
    pub(super) fn as_unflown(&self) -> Result<()> {
        match self.unflown.as_ref().filter(|_| self.is_first) {
            Some(unflown) => Err(unflown.why.clone()),
            None => Ok(()),
        }
    }

    /// Starts a flight in the gas at a place, world mm, if a scan is shown without one.
    pub(super) fn start_at(&mut self, place: DVec3, events: &ActiveEventLoop) {
        let Some(unflown) = self.unflown.take() else { return };
        let prepare = (unflown.start_at)(place);
        // Its tag is taken out in place if nothing else holds the scan.
        drop(unflown);
        if let Stage::Flying(mut controller) = std::mem::replace(&mut self.stage, Stage::Over) {
            self.framebuffer = controller.flight_mut().views().take_presenter();
        }
        self.left = self.keeping.take();
        self.progress = Arc::new(Progress::new());
        match load(prepare, &self.progress, &self.proxy) {
            Ok(loading) => self.stage = Stage::Loading(loading),
            Err(e) => return self.fail(e, events),
        }
        if self.resume.keeps() {
            self.resume = Resume::Nothing;
        }
        self.forget_pictures();
        self.ask_for_picture();
    }

    /// Returns the reason that a window shows for a scan that could not be opened.
    pub(super) fn failed_text(e: &Error) -> String {
        unflown::failed_in_words(e)
    }
}
