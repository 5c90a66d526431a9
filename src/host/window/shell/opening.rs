//! Opens another scan in the window.

use std::path::PathBuf;
use std::time::Instant;

use winit::event_loop::ActiveEventLoop;

use super::Shell;
use super::open_scan::{OpenScan, Stage};
use crate::host::window::Asked;
use crate::host::window::sheet::Sheet;
use crate::output;

impl Shell {
    /// Opens another scan instead of the open one, or adds a file of answers to it.
    pub(super) fn open_scan(&mut self, path: PathBuf, series: Option<usize>, events: &ActiveEventLoop) {
        if let Stage::Flying(c) = &mut self.scan.stage
            && path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"))
        {
            // No scan: answers to the candidates of this one.
            c.load_answers(&path, Instant::now());
            self.touched = true;
            return;
        }
        let is_flying = matches!(self.scan.stage, Stage::Flying(_)) && self.scan.unflown.is_none();
        self.open_asked(Asked { input: Some(path), series, is_flying, is_whole: false, beside: None }, events);
    }

    /// Opens a scan instead of the open one.
    pub(super) fn open_asked(&mut self, asked: Asked, events: &ActiveEventLoop) {
        if let Stage::Flying(c) = &mut self.scan.stage {
            // The open scan goes on if its file has gone.
            if asked.is_whole
                && let Some(path) = asked.input.as_ref().filter(|path| !path.exists())
            {
                c.say(format!("{} is not there any more", path.display()), Instant::now());
                self.touched = true;
                return;
            }
            if c.has_unkept() && !matches!(self.sheet, Some(Sheet::Open { .. })) {
                self.sheet = Some(Sheet::Open { asked });
                self.touched = true;
                return;
            }
        }
        let opening = match (self.open)(asked) {
            Ok(opening) => opening,
            Err(e) => {
                match &mut self.scan.stage {
                    Stage::Flying(c) => c.say(e.to_string(), Instant::now()),
                    Stage::Failed(shown) => *shown = e,
                    Stage::Loading(_) | Stage::Over => output::to_stderr(format_args!("note: {e}")),
                }
                self.touched = true;
                return;
            }
        };
        if let Err(e) = self.close() {
            output::to_stderr(format_args!("{e}"));
            self.outcome = std::mem::replace(&mut self.outcome, Ok(())).and(Err(e));
        }
        match OpenScan::load(opening, false, &self.proxy) {
            Ok(scan) => self.scan = scan,
            Err(e) => return self.fail(e, events),
        }
        self.forget_pictures();
        if let Some(window) = &self.window {
            window.set_title(&self.scan.title());
        }
        self.ask_for_picture();
    }

    /// Forgets what covers a scan that is closed, and its slices.
    pub(super) fn forget_pictures(&mut self) {
        // It was about the scan that was open.
        self.sheet = None;
        if let Some(framebuffer) = &mut self.framebuffer {
            framebuffer.forget_pictures();
        }
    }
}
