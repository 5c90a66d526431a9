//! Renders a flight's image for a window. It has as much detail as the frame time allows while the camera moves, is refined at
//! rest, and is not rendered again once it is complete.

use std::sync::Arc;
use std::time::Instant;

use bevy_ecs::prelude::Entity;

use super::job::WakeUp;
use super::moving::{Moving, MovingPictures};
use super::photograph::Photograph;
use super::screenshot_renderer::{PictureRequest, ScreenshotRenderer, Traced};
use crate::app::FlightApp;
use crate::components::camera::Pose;
use crate::components::output::{FrameCache, Picture};
use crate::error::Result;
use crate::host::frames::FrameStats;
use crate::render::adaptive::FrameBudget;
use crate::render::adaptive::{FRAME, SAMPLES, cost, cost_shown};
use crate::render::{CameraModel, Detail, Frame, ImageSize, Light, Quality, Settings};
use crate::schedule::note;

/// Positions closer than this count as equal, mm.
const SAME_MM: f64 = 1e-3;

/// The inputs of an image. While they stay the same, nothing has to be rendered again.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Shown {
    pose: Pose,
    /// View angle, degrees.
    fov_degrees: f64,
    camera: CameraModel,
    /// The scan, if it is not that which is flown through.
    scan: Option<Entity>,
    window: ImageSize,
    quality: Quality,
}

impl Shown {
    /// Returns the inputs of the flight's picture in a window now; `None` in a scene without a picture.
    fn now(flight: &FlightApp, window: ImageSize) -> Option<Self> {
        let picture = flight.camera::<Picture>()?;
        let Picture { fov_degrees, camera, scan, .. } = *picture;
        Some(Self { pose: flight.pose(), fov_degrees, camera, scan, window, quality: picture.settings.quality })
    }

    /// True if both describe the same picture, up to invisible differences.
    fn is(&self, other: &Self) -> bool {
        self.window == other.window && self.quality == other.quality && self.sees_as(other)
    }

    /// True if both have the same view, whatever their size and detail.
    fn sees_as(&self, other: &Self) -> bool {
        (self.fov_degrees, self.camera, self.scan) == (other.fov_degrees, other.camera, other.scan)
            && same(&self.pose, &other.pose)
    }
}

/// A frame to be rendered.
pub(crate) struct Due {
    now: Shown,
    /// True if it refines the displayed image.
    rest: bool,
    /// True if the image stays unchanged because something beside it has changed.
    stays: bool,
    begun: Instant,
}

impl Due {
    /// True if a picture is rendered, not only shown again.
    pub(crate) fn is_rendered(&self) -> bool {
        !self.stays
    }
}

/// Renders the operator's view.
pub(crate) struct ViewRenderer {
    budget: FrameBudget,
    shown: Option<Shown>,
    screenshots: ScreenshotRenderer,
    frames: Vec<FrameStats>,
    moving: MovingPictures,
    to_save: Vec<Traced>,
    /// The current image will be saved for each of these once it is complete.
    waiting: Vec<PictureRequest>,
    /// Time of presentations, ms.
    present_ms: f64,
    /// True while another picture is rendered in each frame.
    is_shared: bool,
    /// True if no picture of the flight is shown, so that it is not refined.
    hidden: bool,
    /// True if the scene has made none when it was asked for one last.
    empty: bool,
}

impl ViewRenderer {
    /// Creates a renderer without an image. `wake` is called from another thread when an image is ready to be saved.
    ///
    /// # Errors
    /// Returns status 1 if the system cannot start threads.
    pub(crate) fn new(wake: WakeUp) -> Result<Self> {
        Ok(Self {
            budget: FrameBudget::default(),
            shown: None,
            screenshots: ScreenshotRenderer::new(wake)?,
            frames: Vec::new(),
            moving: MovingPictures::default(),
            to_save: Vec::new(),
            waiting: Vec::new(),
            present_ms: 0.0,
            is_shared: false,
            hidden: false,
            empty: false,
        })
    }

    /// Returns the statistics of the images.
    pub(crate) fn frames(&self) -> &[FrameStats] {
        &self.frames
    }

    /// Returns the statistics of the size and rate of pictures while the camera moved.
    pub(crate) fn moving(&self) -> Option<Moving> {
        self.moving.summary()
    }

    /// Records the time of a presentation, ms.
    pub(crate) fn presented(&mut self, ms: f64) {
        self.present_ms = ms;
    }

    /// Tells whether another picture is rendered in each frame.
    pub(crate) fn share_frames(&mut self, is_shared: bool) {
        self.is_shared = is_shared;
    }

    /// Returns the last rendered image.
    pub(crate) fn image<'a>(&self, flight: &'a FlightApp) -> Option<&'a Frame> {
        self.shown?;
        flight.camera::<Picture>().map(|p| &p.frame)
    }

    /// Returns the detail of the image.
    pub(crate) fn detail(&self, flight: &FlightApp) -> Option<Detail> {
        self.shown?;
        flight.camera::<FrameCache>()?.renderer()?.detail()
    }

    /// True if a still image will be refined, or rendered again with other settings.
    pub(crate) fn is_refining(&self, flight: &FlightApp) -> bool {
        let made = flight.camera::<FrameCache>().zip(flight.camera::<Picture>());
        !self.hidden
            && !self.empty
            && self.shown.is_some()
            && made.is_some_and(|(cache, picture)| cache.is_unfinished(picture))
    }

    /// Requests that the image of a window of the given size is saved: the displayed one once it is complete, or, if the camera
    /// moves on before that, a separately rendered one.
    pub(crate) fn order_to_save(&mut self, flight: &FlightApp, window: ImageSize) {
        if let Some(request) = PictureRequest::of(flight, window) {
            self.order(flight, window, request);
        }
    }

    /// Requests that the `views` of a window are saved, with the flight's picture of the given size among them.
    pub(crate) fn order_photograph(&mut self, flight: &FlightApp, size: ImageSize, views: Photograph) {
        if let Some(request) = PictureRequest::of(flight, size) {
            self.order(flight, size, PictureRequest { views: Some(Arc::new(views)), ..request });
        }
    }

    fn order(&mut self, flight: &FlightApp, window: ImageSize, request: PictureRequest) {
        let here = self.shown.zip(Shown::now(flight, window)).is_some_and(|(shown, now)| shown.is(&now));
        match self.image(flight).filter(|_| here && !self.is_refining(flight)) {
            Some(frame) => self.to_save.push(Traced { request, frame: frame.clone() }),
            None => self.waiting.push(request),
        }
    }

    /// Takes the images that are ready to be saved.
    pub(crate) fn take_to_save(&mut self) -> Vec<Traced> {
        std::mem::take(&mut self.to_save)
    }

    /// Takes all images to be saved, and waits for those in progress.
    pub(crate) fn all_to_save(&mut self) -> Vec<Traced> {
        self.waiting.drain(..).for_each(|request| self.screenshots.begin(request));
        while let Some(traced) = self.screenshots.wait() {
            self.to_save.extend(traced.ok());
        }
        self.take_to_save()
    }

    /// Switches between high and low detail. Returns the new one.
    pub(crate) fn switch_detail(&mut self, flight: &mut FlightApp) -> Option<Quality> {
        let scene = flight.setup().scene.render;
        let mut picture = flight.camera_mut::<Picture>()?;
        let quality = if picture.settings.quality == Quality::Low { Quality::High } else { Quality::Low };
        let Settings { adaptive, options, light, .. } = picture.settings;
        picture.settings = Settings { adaptive, options, light, ..scene.apply(Settings::new(quality)) };
        self.budget.forget();
        Some(quality)
    }

    /// Switches between the headlight and an endoscope's light. Returns the new one.
    pub(crate) fn switch_light(&mut self, flight: &mut FlightApp) -> Option<Light> {
        let mut picture = flight.camera_mut::<Picture>()?;
        let light = &mut picture.settings.light;
        *light = if *light == Light::HEADLIGHT { Light::ENDOSCOPE } else { Light::HEADLIGHT };
        Some(*light)
    }

    /// Prepares the next frame for a window of the given size. `None` if there is nothing to render: the displayed image has the
    /// same view and is complete, and nothing has to be drawn `beside` it.
    ///
    /// # Errors
    /// Returns status 1 if an image to be saved could not be rendered, which is an internal error.
    pub(crate) fn prepare(&mut self, flight: &mut FlightApp, window: ImageSize, beside: bool) -> Result<Option<Due>> {
        while let Some(traced) = self.screenshots.take() {
            match traced {
                Ok(traced) => self.to_save.push(traced),
                Err(e) => note(e.what, e.why),
            }
        }
        let Some(now) = Shown::now(flight, window) else { return Ok(None) };
        self.hidden = window.pixels() == 0;
        if self.hidden {
            return Ok(beside.then(|| Due { now, rest: false, stays: true, begun: Instant::now() }));
        }
        let rest = self.shown.is_some_and(|s| s.is(&now));
        // What is painted over it may have changed.
        let is_due = !self.empty && flight.camera::<Picture>().is_some_and(|p| p.due);
        let done = rest && !is_due && !self.is_refining(flight);
        let others = flight.views().mark_unfinished();
        if done && !others {
            return Ok(beside.then(|| Due { now, rest, stays: true, begun: Instant::now() }));
        }
        self.save_waiting(flight, &now, rest);
        // The other picture has half of what a frame has for pictures.
        let shared_ms = if self.is_shared { (FRAME.as_secs_f64() * 1e3 - self.present_ms).max(0.0) * 0.4 } else { 0.0 };
        let budget = self.budget.next(rest, self.present_ms + shared_ms, window.pixels());
        if let Some(mut picture) = flight.camera_mut::<Picture>() {
            // Rendered with the others, whether or not it can become better: a post-process may draw one into the other.
            (picture.due, picture.budget) = (true, Some(budget));
            picture.frame.resize(window.width, window.height);
        }
        Ok(Some(Due { now, rest, stays: false, begun: Instant::now() }))
    }

    /// Records that the prepared frame is finished, with its time, ms. If `None`, the time since it was prepared is used.
    pub(crate) fn traced(&mut self, flight: &FlightApp, due: &Due, ms: Option<f64>) {
        if due.stays {
            return;
        }
        self.empty = flight.camera::<Picture>().is_some_and(|p| !p.traced);
        let ms = ms.unwrap_or_else(|| due.begun.elapsed().as_secs_f64() * 1e3);
        if let Some(w) = flight.camera::<Picture>().map(|p| p.work) {
            if cost(&w) > 0 {
                let detail = flight.camera::<FrameCache>().and_then(|c| c.renderer()?.detail());
                let cost = cost_shown(&w, detail, due.now.window);
                self.budget.took(due.rest, cost, due.now.window.pixels(), ms);
            }
            self.frames.push(FrameStats::new(ms, &w));
        }
        if due.rest {
            self.moving.rest();
            self.save_waiting(flight, &due.now, true);
        } else {
            self.shown = Some(due.now);
            let traced = self.detail(flight).map_or(due.now.window.width, |d| d.size.width);
            let side = traced as f64 / due.now.window.width.max(1) as f64;
            self.moving.took(side, self.is_shared, Instant::now());
        }
    }

    /// Saves or starts the waiting screenshots, depending on whether the camera is at rest or has moved on.
    fn save_waiting(&mut self, flight: &FlightApp, now: &Shown, rest: bool) {
        if self.waiting.is_empty() {
            return;
        }
        if !rest && self.shown.is_some_and(|s| !s.sees_as(now)) {
            self.waiting.drain(..).for_each(|request| self.screenshots.begin(request));
        } else if let Some(frame) = self.image(flight).filter(|_| rest && !self.is_refining(flight)) {
            self.to_save.extend(self.waiting.drain(..).map(|request| Traced { request, frame: frame.clone() }));
        }
    }
}

/// Returns the quality of a flight's images.
pub(crate) fn quality_of(flight: &FlightApp) -> Option<Quality> {
    flight.camera::<Picture>().map(|p| p.settings.quality)
}

/// Formats how far an image is refined: "9 of 16 samples".
pub(crate) fn refined(detail: Detail) -> Option<String> {
    (detail.samples > 0).then(|| format!("{} of {SAMPLES} samples", detail.samples.min(SAMPLES)))
}

/// True if two poses make the same image, up to invisible differences.
fn same(a: &Pose, b: &Pose) -> bool {
    let near = |a: glam::DVec3, b: glam::DVec3, by: f64| a.distance(b) < by;
    near(a.position, b.position, SAME_MM)
        && near(a.attitude.forward, b.attitude.forward, 1e-5)
        && near(a.attitude.up, b.attitude.up, 1e-5)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::app::{ImageSettings, Plan, Scene};
    use crate::fields::Lumen;
    use crate::testing::Room;

    #[test]
    fn a_picture_is_rendered_again_when_the_camera_moves_turns_or_rolls() {
        let room = Room::new([10, 30, 10]);
        let volume = room.scan();
        let lumen = Arc::new(Lumen::none(volume.voxels().grid()));
        let window = ImageSize::new(12, 8);
        let settings = Settings { adaptive: false, ..Settings::default() };
        let image = ImageSettings { width: window.width, height: window.height, settings, ..ImageSettings::default() };
        let scene = Scene { picture: true, image, ..Scene::guided_by("manual") };
        let plan = Plan::between(room.centre(), room.centre() + DVec3::Y * 10.0, 10.0);
        let mut flight = FlightApp::new(volume, lumen, plan, scene).unwrap();
        let mut renderer = ViewRenderer::new(Arc::new(|| {})).unwrap();
        let mut renders = |position: DVec3, forward: DVec3, up: DVec3| {
            assert!(flight.place(position, forward, up));
            let due = renderer.prepare(&mut flight, window, false).unwrap();
            if let Some(due) = &due {
                flight.views().render_due().unwrap();
                renderer.traced(&flight, due, Some(1.0));
            }
            due.is_some()
        };
        let here = room.centre();
        assert!(renders(here, DVec3::Y, DVec3::Z), "the first one");
        assert!(!renders(here, DVec3::Y, DVec3::Z), "the same");
        assert!(renders(here, DVec3::Y, DVec3::new(0.01, 0.0, 1.0)), "rolled");
        assert!(renders(here, DVec3::X, DVec3::Z), "turned");
        assert!(renders(here + DVec3::X, DVec3::X, DVec3::Z), "moved");
        assert!(!renders(here + DVec3::X, DVec3::X, DVec3::Z), "the same");
    }
}
