//! Renders screenshots of a moving camera in the background, so that the flight does not wait for them.

use std::sync::Arc;

use rayon::{ThreadPool, ThreadPoolBuilder};

use super::job::{Job, WakeUp};
use super::photograph::Photograph;
use crate::app::FlightApp;
use crate::components::camera::Pose;
use crate::components::output::Picture;
use crate::components::translucent::Translucent;
use crate::error::{Error, Result};
use crate::panics;
use crate::progress::Progress;
use crate::render::{CameraModel, Frame, ImageSize, Preset, Reuse, Settings, View, renderer};
use crate::space::PreparedVolume;

/// A request for an image to be saved.
#[derive(Clone, Debug)]
pub(crate) struct PictureRequest {
    /// The scan to render.
    pub scan: PreparedVolume,
    /// Pose of the camera.
    pub pose: Pose,
    /// Width and height, pixels.
    pub size: ImageSize,
    /// Camera model.
    pub camera: CameraModel,
    /// View angle over the shorter side, degrees.
    pub fov_degrees: f64,
    /// Quality and sampling.
    pub settings: Settings,
    /// The renderer.
    pub preset: Preset,
    /// What shows what lies behind the wall, if anything does.
    pub translucent: Option<Translucent>,
    /// The views that it is saved among; `None` for the image alone.
    pub views: Option<Arc<Photograph>>,
}

impl PictureRequest {
    /// Creates a request for the current image of a flight's camera. `width` and `height` must be at least one pixel. The image
    /// has full detail, whatever detail the flight itself can afford.
    pub(crate) fn of(flight: &FlightApp, size: ImageSize) -> Option<Self> {
        let picture = flight.camera::<Picture>()?;
        let settings = Settings { adaptive: false, ..picture.settings };
        let (camera, fov_degrees, preset) = (picture.camera, picture.fov_degrees, picture.preset);
        let size = ImageSize::new(size.width.max(1), size.height.max(1));
        let (scan, pose) = (flight.shown_scan().clone(), flight.pose());
        let translucent = flight.camera::<Translucent>().cloned();
        Some(Self { scan, pose, size, camera, fov_degrees, settings, preset, translucent, views: None })
    }

    fn trace(self) -> Result<Traced> {
        let (a, ImageSize { width, height }) = (self.pose.attitude, self.size);
        let view = View::with_model(self.pose.position, a.forward, a.up, self.camera, self.fov_degrees, width, height)?;
        let mut frame = Frame::new(width, height);
        let mut renderer = panics::ask_plugin(
            || format!("preset {}", self.preset.name),
            || Ok(renderer(&self.scan, self.settings, self.preset, Reuse::Never)),
        )?;
        let traced = panics::catch(|| renderer.render(&view, &mut frame));
        traced.map_err(|why| {
            Error::fault(format!("preset {}", self.preset.name), format!("panicked: {why}"), "choose another preset")
        })?;
        if let Some(mut translucent) = self.translucent.clone() {
            translucent.paint(&self.scan, &view, renderer.distances(), &mut frame);
        }
        Ok(Traced { request: self, frame })
    }
}

/// A rendered image.
pub(crate) struct Traced {
    /// The request.
    pub request: PictureRequest,
    /// The image.
    pub frame: Frame,
}

/// Renders images in the background.
pub(crate) struct ScreenshotRenderer {
    /// A separate thread pool: in the common one, images would wait for a route that is being planned.
    pool: ThreadPool,
    wake: WakeUp,
    /// In the order in which they were started.
    jobs: Vec<Job<Traced>>,
}

impl ScreenshotRenderer {
    /// Creates a renderer. It calls `wake` when an image is ready.
    ///
    /// # Errors
    /// Returns status 1 if the system cannot start threads.
    pub(crate) fn new(wake: WakeUp) -> Result<Self> {
        let pool = ThreadPoolBuilder::new()
            .num_threads(rayon::current_num_threads())
            .thread_name(|n| format!("screenshot {n}"))
            .build()
            .map_err(|e| Error::fault("threads", e.to_string(), "use fewer --threads").caused_by(e))?;
        Ok(Self { pool, wake, jobs: Vec::new() })
    }

    /// Starts to render an image.
    pub(crate) fn begin(&mut self, request: PictureRequest) {
        let wake = Arc::clone(&self.wake);
        let trace = move |_: &Arc<Progress>| request.trace();
        self.jobs.push(Job::start_in(&self.pool, "screenshot", &Arc::new(Progress::new()), trace, move || wake()));
    }

    /// Takes an image that has been finished since the last call.
    pub(crate) fn take(&mut self) -> Option<Result<Traced>> {
        let (n, traced) = self.jobs.iter_mut().enumerate().find_map(|(n, job)| Some((n, job.take()?)))?;
        self.jobs.remove(n);
        Some(traced)
    }

    /// Waits for the next image if one is pending.
    pub(crate) fn wait(&mut self) -> Option<Result<Traced>> {
        (!self.jobs.is_empty()).then(|| self.jobs.remove(0).wait())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::Attitude;
    use crate::render::{CameraModel, Quality};
    use crate::space::TransferFunction;
    use crate::volume::{Grid, Volume};
    use glam::{DMat3, DVec3};

    #[test]
    fn the_same_image_as_in_the_foreground() {
        let grid = Grid::new([16, 16, 16], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let data = (0..16 * 16 * 16).map(|n| if n % 16 < 4 { 100 } else { -1000 }).collect();
        let volume = PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default());
        let request = PictureRequest {
            scan: volume,
            pose: Pose { position: DVec3::splat(8.0), attitude: Attitude::new(DVec3::NEG_X, DVec3::Z) },
            size: ImageSize::new(30, 20),
            camera: CameraModel::default(),
            fov_degrees: 90.0,
            settings: Settings::new(Quality::High),
            preset: Preset::default(),
            translucent: None,
            views: None,
        };
        let mut screenshots = ScreenshotRenderer::new(Arc::new(|| {})).unwrap();
        assert!(screenshots.wait().is_none(), "nothing was asked for");
        screenshots.begin(request.clone());
        let traced = screenshots.wait().unwrap().unwrap();
        assert_eq!(traced.frame, request.trace().unwrap().frame);
        assert!(traced.frame.pixels().iter().any(|p| p[0] > 60));
        assert!(screenshots.take().is_none() && screenshots.wait().is_none());
    }
}
