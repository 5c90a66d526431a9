//! Screenshots: of all views, and of the flight's picture alone.

use std::io::Write;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use super::FlightController;
use crate::error::Result;
use crate::host::window::intent::ActionContext;
use crate::host::window::photograph::Photograph;
use crate::host::window::screenshot;
use crate::host::window::screenshot_renderer::Traced;
use crate::render::Frame;

/// How long the path of a screenshot is shown: it must be read.
pub(super) const PATH_MESSAGE: Duration = Duration::from_secs(8);

impl FlightController {
    /// Sets the folder of screenshots; the platform's folder for pictures if `None`.
    pub(crate) fn set_screenshots(&mut self, folder: Option<PathBuf>) {
        self.screenshots = folder;
    }

    /// Saves the flight's picture without anything over it.
    pub(crate) fn take_screenshot(&mut self, at: ActionContext) {
        if at.window.pixels() == 0 {
            self.say("the flight is not shown", at.now);
            return;
        }
        self.view_renderer.order_to_save(&self.flight, at.window);
        self.say("saving the image", at.now);
    }

    /// Saves all views, once the flight's picture is complete.
    pub(crate) fn photograph(&mut self, views: Option<Photograph>, now: Instant) {
        let Some(views) = views else { return self.say("no view is shown", now) };
        match views.flight() {
            Some(size) => {
                self.view_renderer.order_photograph(&self.flight, size, views);
                self.say("saving the screenshot", now);
            }
            None => {
                let saved = self.save_image(&views.with(None));
                self.tell_saved(saved, now);
            }
        }
    }

    /// Saves a picture, with the views around it if they were asked for, and prints its pose.
    fn save(&mut self, traced: Traced, now: Instant) {
        let Traced { request, frame } = traced;
        let saved = match request.views {
            Some(views) => self.save_image(&Photograph::clone(&views).with(Some(&frame))),
            None => self.save_image(&frame),
        };
        if saved.is_ok() {
            let pose = screenshot::pose_json(&request.pose, request.camera, request.fov_degrees);
            // The reader of the poses may have closed standard output, but the picture is saved.
            let _ = writeln!(std::io::stdout(), "{pose}");
        }
        self.tell_saved(saved, now);
    }

    fn save_image(&self, image: &Frame) -> Result<PathBuf> {
        screenshot::save(image, &screenshot::folder(self.screenshots.as_deref())?)
    }

    fn tell_saved(&mut self, saved: Result<PathBuf>, now: Instant) {
        let text = saved.map_or_else(|e| e.to_string(), |path| format!("saved {}", path.display()));
        self.message = Some((text, now + PATH_MESSAGE));
        self.attention = true;
    }

    /// Saves the screenshots that are still being rendered, at the end.
    pub(crate) fn save_the_rest(&mut self) {
        for traced in self.view_renderer.all_to_save() {
            self.save(traced, Instant::now());
        }
    }

    pub(super) fn save_traced(&mut self, now: Instant) {
        for traced in self.view_renderer.take_to_save() {
            self.save(traced, now);
        }
    }
}
