//! A scan that cannot be flown: its slices are looked at, and a flight starts where the reader asks for it.

use std::time::Instant;

use glam::DVec3;
use winit::event_loop::ActiveEventLoop;

use super::Shell;
use super::open_scan::Stage;
use crate::error::Error;
use crate::host::window::controller::FlightController;
use crate::host::window::loading::Unflown;
use crate::host::window::unflown;

impl Shell {
    /// Shows the slices of a scan that cannot be flown, and why that is so.
    pub(super) fn look(&mut self, controller: &mut FlightController, unflown: Unflown, notes: &mut Vec<String>) {
        let why = unflown::in_words(&unflown.why);
        notes.insert(0, why.clone());
        controller.rest(why, Instant::now());
        self.layout_before = self.layout_before.or(self.workspace.show_slices());
        self.scan.unflown = Some(unflown);
    }

    /// Returns to the layout that was left to show slices, once they need not be shown.
    pub(super) fn return_to_layout(&mut self) {
        if let Some(layout) = self.layout_before.take() {
            self.workspace.choose(layout);
        }
    }

    /// Starts a flight in the gas at a place, world mm, if a scan is shown without one.
    pub(super) fn start_at(&mut self, place: DVec3, events: &ActiveEventLoop) {
        let Some(unflown) = self.scan.unflown.take() else { return };
        let prepare = (unflown.start_at)(place);
        // Its tag is taken out in place if nothing else holds the scan.
        drop(unflown);
        if let Stage::Flying(mut controller) = std::mem::replace(&mut self.scan.stage, Stage::Over) {
            self.framebuffer = controller.flight_mut().views().take_presenter();
        }
        self.left = self.scan.keeping.take();
        if let Err(e) = self.scan.load_again(prepare, &self.proxy) {
            return self.fail(e, events);
        }
        self.forget_pictures();
        self.ask_for_picture();
    }

    /// Returns the reason that a window shows for a scan that could not be opened.
    pub(super) fn failed_text(e: &Error) -> String {
        unflown::failed_in_words(e)
    }
}
