//! The patient's other position: opened beside the first one, shown, and worked in instead.

use std::time::Instant;

use super::open_scan::{OpenScan, Placed, Stage};
use super::{Ready, Shell};
use crate::components::input::HandCommand;
use crate::error::Result;
use crate::host::window::contract::WindowView;
use crate::host::window::framebuffer::Framebuffer;
use crate::host::window::interface::WindowSize;
use crate::host::window::keeping::Keeping;
use crate::host::window::keys::HeldKeys;
use crate::host::window::overlay::Content;
use crate::host::window::stroke::Pressed;
use crate::host::window::{Asked, Resume, unflown};
use crate::output;
use crate::render::ImageSize;

impl Shell {
    /// Opens a scan as the patient's second position, instead of the one that is open as such.
    pub(super) fn open_second(&mut self, asked: Asked) {
        let is_second = self.scan.is_second;
        let asked = Asked { beside: self.scan.input.clone().map(|path| (path, self.scan.series)), ..asked };
        let opened = (self.open)(asked).and_then(|opening| OpenScan::load(opening, false, &self.proxy));
        match opened {
            Ok(mut scan) => {
                let mut closed = Ok(());
                if let Some(mut before) = self.other.take() {
                    closed = before.close(&mut None);
                }
                if let Err(e) = closed {
                    output::to_stderr(format_args!("{e}"));
                    self.outcome = std::mem::replace(&mut self.outcome, Ok(())).and(Err(e));
                }
                // Beside the second one, it takes the place of the first.
                scan.is_second = !is_second;
                self.other = Some(scan);
            }
            Err(e) => self.say(e.to_string()),
        }
        self.touched = true;
    }

    fn say(&mut self, text: String) {
        match &mut self.scan.stage {
            Stage::Flying(c) => c.say(text, Instant::now()),
            Stage::Loading(_) | Stage::Failed(_) | Stage::Over => output::to_stderr(format_args!("note: {text}")),
        }
    }

    /// Opens the second position that the window was asked for, and handles the end of its loading.
    ///
    /// # Errors
    /// Returns status 1 if the system cannot start threads.
    pub(super) fn take_off_other(&mut self) -> Result<()> {
        if matches!(self.scan.stage, Stage::Flying(_))
            && let Some(asked) = self.second.take()
        {
            self.open_second(asked);
        }
        let Some(mut other) = self.other.take() else { return Ok(()) };
        let loaded = if let Stage::Loading(loading) = &mut other.stage { loading.take() } else { None };
        let landed = match loaded {
            Some(Ok(ready)) => self.land(&mut other, ready),
            Some(Err(e)) => {
                other.stage = Stage::Failed(e);
                Ok(())
            }
            None => Ok(()),
        };
        self.other = Some(other);
        self.touched = true;
        landed
    }

    /// Lets the flight through the other position wait where it begins, or was left.
    fn land(&mut self, other: &mut OpenScan, ready: Ready) -> Result<()> {
        let Ready { mut flight, session, notes, unflown, is_whole, is_anew } = ready;
        notes.iter().for_each(|note| output::to_stderr(format_args!("note: the other position: {note}")));
        if is_anew && other.resume == Resume::Everything {
            other.resume = Resume::Nothing;
        }
        let now = Instant::now();
        let is_guided = flight.setup().scene.guide().is_some();
        let mut keeping = Keeping::of(session, other.resume, is_guided, now);
        keeping.reads_whole(is_whole);
        keeping.resume(&mut flight, other.resume);
        let mut controller = self.controller(flight, self.overlays.clone(), other)?;
        keeping.equip(&mut controller);
        let warned = keeping.warning();
        warned.iter().for_each(|w| output::to_stderr(format_args!("note: the other position: {w}")));
        other.keeping = Some(keeping);
        match unflown {
            Some(unflown) => {
                controller.rest(unflown::in_words(&unflown.why), now);
                other.unflown = Some(unflown);
            }
            // It waits for the reader.
            None => controller.flight_mut().act(HandCommand::Pause(true)).unwrap_or(()),
        }
        other.stage = Stage::Flying(Box::new(controller));
        Ok(())
    }

    /// Works in the patient's other position from now on: keys, lists and slices are its own.
    ///
    /// # Errors
    /// Returns status 1 if the picture cannot be shown.
    pub(super) fn work_in_other(&mut self, now: Instant) -> Result<()> {
        let said = match self.other.as_ref().map(|other| &other.stage) {
            Some(Stage::Flying(_)) => None,
            Some(Stage::Loading(_)) => Some("the other position is being read"),
            Some(Stage::Failed(_) | Stage::Over) => Some("the other position could not be read"),
            None => Some("there is no other position: open one beside this scan (File, or --second)"),
        };
        let (Some(other), None) = (&mut self.other, said) else {
            self.say(said.unwrap_or_default().to_owned());
            return Ok(());
        };
        let mut framebuffer = None;
        if let Stage::Flying(c) = &mut self.scan.stage {
            c.steer(HeldKeys::let_go, now);
            framebuffer = c.flight_mut().views().take_presenter::<Framebuffer>();
        }
        self.pressed = Pressed::default();
        std::mem::swap(&mut self.scan, other);
        let presented = (std::mem::take(&mut other.placed).presented, std::mem::take(&mut self.scan.placed).presented);
        (other.placed, self.scan.placed) = (
            Placed { presented: presented.0, ..Placed::default() },
            Placed { presented: presented.1, ..Placed::default() },
        );
        let position = which(&self.scan);
        if let (Some(mut framebuffer), Stage::Flying(c)) = (framebuffer, &mut self.scan.stage) {
            framebuffer.forget_pictures();
            if let Some(shown) = other.image() {
                framebuffer.show_other(shown);
            }
            let camera = c.flight().app().camera_id();
            c.flight_mut().views().present_to(camera, framebuffer)?;
            c.say(format!("working in the {position} position"), now);
        }
        if let Some(window) = &self.window {
            window.set_title(&self.scan.title());
        }
        self.touched = true;
        self.ask_for_picture();
        Ok(())
    }

    /// Returns what there is of the other position, for panels.
    pub(super) fn other_content(&mut self, size: WindowSize, now: Instant) -> Option<Content> {
        self.other.as_mut()?.content(Some(size), now)
    }

    /// Lets the other position go on if it is shown, and renders its picture if that is new. `is_busy` tells whether the picture of the
    /// position that is worked in is rendered, too: they share the time of a frame. Returns true for a new picture.
    ///
    /// # Errors
    /// As [`FlightController::advance`](crate::host::window::controller::FlightController::advance).
    pub(super) fn other_picture(&mut self, is_busy: bool, now: Instant) -> Result<bool> {
        let [.., width, height] = self.scan.placed.other_at;
        let Some(Stage::Flying(c)) = self.other.as_mut().map(|other| &mut other.stage) else { return Ok(false) };
        let mut is_new = false;
        if width * height > 0 {
            c.advance(now)?;
            c.share_frames(is_busy);
            let due = c.prepare(ImageSize::new(width, height), &[], now)?;
            is_new = due.is_some();
            c.show(due)?;
        }
        if let Stage::Flying(own) = &mut self.scan.stage {
            own.share_frames(is_new);
        }
        Ok(is_new)
    }

    /// Returns when work is due for the other position, if it is shown.
    pub(super) fn next_of_other(&self) -> Option<Instant> {
        let [.., width, height] = self.scan.placed.other_at;
        match self.other.as_ref().map(|other| &other.stage)? {
            Stage::Loading(_) => Some(self.due),
            Stage::Flying(_) if width * height == 0 => None,
            Stage::Flying(c) if c.rests() => c.next(),
            Stage::Flying(_) => Some(self.due),
            Stage::Failed(_) | Stage::Over => None,
        }
    }
}

impl OpenScan {
    /// Returns what there is of it, for panels.
    pub(super) fn content(&mut self, size: Option<WindowSize>, now: Instant) -> Option<Content> {
        match &mut self.stage {
            Stage::Loading(loading) => Some(loading.content()),
            Stage::Failed(e) => Some(Content::Failed { text: unflown::failed_in_words(e) }),
            Stage::Flying(controller) => {
                if let Some(size) = size {
                    controller.scaled(size.pixels_a_point());
                }
                Some(Content::Flight(Box::new(controller.hud(now))))
            }
            Stage::Over => None,
        }
    }
}

/// Names a position.
fn which(scan: &OpenScan) -> &'static str {
    if scan.is_second { "second" } else { "first" }
}
