//! What a flight leaves behind: the log, and the images of its views.

use std::sync::Arc;

use bevy_ecs::prelude::*;
use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::components::camera::Pose;
use crate::components::flight::State;
use crate::render::adaptive::Budget;
use crate::render::{
    CameraModel, Frame, PreparedVolume, Preset, Renderer, Reuse, Settings, TransferFunction, View, Work, renderer,
};
use crate::volume::Volume;

/// One simulation step, as a line of the log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LogLine {
    /// Simulated time, s.
    pub t: f64,
    /// World mm.
    pub position: [f64; 3],
    /// Unit view direction.
    pub forward: [f64; 3],
    /// Unit up direction.
    pub up: [f64; 3],
    /// World mm/s.
    pub velocity: [f64; 3],
    /// Distance from the camera's centre to the nearest wall, mm.
    pub clearance_mm: f64,
    /// How the flight stands.
    pub state: State,
    /// Who steers.
    pub guide: String,
}

/// The steps since the log was last written out.
#[derive(Resource, Default)]
pub struct FlightLog(pub Vec<LogLine>);

/// The name of the guide, for the log.
#[derive(Resource, Clone, Copy, Debug)]
pub struct GuideName(pub &'static str);

/// A view: an image of the scan and how it is made. Every entity that has one is rendered in each frame.
///
/// The camera's own is there in a scene with a window or a recording. Add others with
/// [`FlightApp::add_view`](crate::app::FlightApp::add_view), or spawn them. An entity with a view needs a place to look from:
/// a [`Pose`] of its own, or [`Follows`].
///
/// ```
/// use colvis::app::{Scan, Scene, FlightRequest};
/// use colvis::components::output::{Follows, Picture};
///
/// let mut flight = Scan::phantom(1)?.flight(Scene::default(), &FlightRequest::default())?;
/// let rear = flight.add_view((Picture::new(160, 120), Follows::rear()))?;
/// flight.fly(1.0)?;
/// flight.frame()?;
/// let picture = flight.app().world.get::<Picture>(rear).expect("it was just added");
/// assert!(picture.frame.pixels().iter().any(|p| p[0] > 30));
/// # Ok::<(), colvis::error::Error>(())
/// ```
#[derive(Component)]
#[require(FrameCache)]
pub struct Picture {
    /// Camera model.
    pub camera: CameraModel,
    /// View angle over the shorter side, degrees.
    pub fov_degrees: f64,
    /// Quality and the renderer's other settings.
    pub settings: Settings,
    /// Renderer.
    pub preset: Preset,
    /// Samples that an image may take, where detail follows the need; none for the renderer's own measure.
    pub budget: Option<Budget>,
    /// The entity whose [`Scan`](super::scan::Scan) is shown; none for the scan that is flown through.
    pub scan: Option<Entity>,
    /// The image. Its size is the size of the view.
    pub frame: Frame,
    /// Where the image was seen from, and through which camera; none before the first one.
    pub view: Option<View>,
    /// What the last image took.
    pub work: Work,
    /// Whether the next frame is to trace it. One that sees something else than before is traced in any case.
    pub due: bool,
    /// Whether this frame has traced it.
    pub traced: bool,
    /// Whether a post-process has resized it in this frame, which was undone.
    pub resized: bool,
}

impl Picture {
    /// A view of `width` × `height` pixels: perspective, 90°, the default renderer at high quality.
    pub fn new(width: usize, height: usize) -> Self {
        Self {
            camera: CameraModel::default(),
            fov_degrees: 90.0,
            settings: Settings::default(),
            preset: Preset::default(),
            budget: None,
            scan: None,
            frame: Frame::new(width, height),
            view: None,
            work: Work::default(),
            due: true,
            traced: false,
            resized: false,
        }
    }

    /// Gives the image back the size that it was traced in.
    pub fn keep_size(&mut self) {
        let Some(view) = self.view.as_ref().filter(|_| self.traced) else { return };
        let size = (view.width(), view.height());
        if (self.frame.width(), self.frame.height()) != size {
            self.frame.resize(size.0, size.1);
            self.resized = true;
        }
    }
}

/// Lets a view look from where another entity is: the flight's camera, unless it names one.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq)]
pub struct Follows {
    /// The entity whose pose it follows; none for the flight's camera.
    pub whom: Option<Entity>,
    /// Degrees that the view is turned to the right by.
    pub yaw_degrees: f64,
    /// Degrees that the turned view is tilted upwards by.
    pub pitch_degrees: f64,
    /// How far the view stands off, mm: to the right, upwards and forward of the entity that it follows.
    pub offset_mm: DVec3,
}

impl Follows {
    /// Looks back from the flight's camera.
    pub fn rear() -> Self {
        Self { yaw_degrees: 180.0, ..Self::default() }
    }

    /// The view's pose where the entity that it follows has `pose`.
    pub fn pose(&self, pose: &Pose) -> Pose {
        let mut attitude = pose.attitude;
        let [right, up, forward] = [attitude.right(), attitude.up, attitude.forward];
        let offset = right * self.offset_mm.x + up * self.offset_mm.y + forward * self.offset_mm.z;
        attitude.rotate(up, -self.yaw_degrees.to_radians());
        attitude.rotate(attitude.right(), self.pitch_degrees.to_radians());
        Pose { position: pose.position + offset, attitude }
    }
}

/// A view's renderer, with what it keeps from one image to the next.
#[derive(Component, Default)]
pub struct FrameCache {
    kept: Option<Kept>,
}

struct Kept {
    renderer: Box<dyn Renderer>,
    settings: Settings,
    preset: Preset,
    /// The voxels that it renders, and what of them is wall.
    volume: Arc<Volume>,
    transfer: TransferFunction,
}

impl FrameCache {
    /// The renderer of `scan` by these settings: the one that is there, or a new one if anything has changed.
    pub fn renderer_for(
        &mut self,
        scan: &PreparedVolume,
        settings: Settings,
        preset: Preset,
    ) -> &mut (dyn Renderer + 'static) {
        let fits = |k: &Kept| {
            (k.settings, k.preset, k.transfer) == (settings, preset, scan.transfer())
                && std::ptr::eq(&*k.volume, scan.voxels())
        };
        if !self.kept.as_ref().is_some_and(fits) {
            // The old one goes first: both at once would double the memory.
            self.kept = None;
        }
        let made = || Kept {
            renderer: renderer(scan, settings, preset, Reuse::Allowed),
            settings,
            preset,
            volume: scan.shared_voxels(),
            transfer: scan.transfer(),
        };
        &mut *self.kept.get_or_insert_with(made).renderer
    }

    /// The renderer, once there is one.
    pub fn renderer(&self) -> Option<&dyn Renderer> {
        self.kept.as_ref().map(|k| &*k.renderer)
    }

    /// Whether the image would become better, or another one, if the same view were rendered again with `picture`'s settings.
    pub fn is_unfinished(&self, picture: &Picture) -> bool {
        self.kept.as_ref().is_none_or(|k| {
            let other = (k.settings, k.preset) != (picture.settings, picture.preset);
            other || k.renderer.detail().is_some_and(|d| !d.best)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::Attitude;

    #[test]
    fn a_view_turns_and_stands_off_as_it_is_told() {
        let camera = Pose { position: DVec3::new(1.0, 2.0, 3.0), attitude: Attitude::new(DVec3::Y, DVec3::Z) };
        let near = |a: DVec3, b: DVec3| assert!(a.distance(b) < 1e-12, "{a} {b}");
        let rear = Follows::rear().pose(&camera);
        near(rear.attitude.forward, DVec3::NEG_Y);
        near(rear.attitude.up, DVec3::Z);
        // To posterior with superior on top, the patient's left is on the right.
        let right = Follows { yaw_degrees: 90.0, ..Follows::default() }.pose(&camera);
        near(right.attitude.forward, DVec3::X);
        let up = Follows { yaw_degrees: 90.0, pitch_degrees: 90.0, ..Follows::default() }.pose(&camera);
        near(up.attitude.forward, DVec3::Z);
        near(up.attitude.up, DVec3::NEG_X);
        let off = Follows { offset_mm: DVec3::new(1.0, 10.0, 100.0), ..Follows::default() }.pose(&camera);
        near(off.position - camera.position, DVec3::new(1.0, 100.0, 10.0));
        assert_eq!(off.attitude, camera.attitude);
    }
}
