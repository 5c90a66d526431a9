//! The output of a flight: its log and the images of its views.

use std::sync::Arc;

use bevy_ecs::prelude::*;
use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::components::camera::Pose;
use crate::components::flight::State;
use crate::render::adaptive::Budget;
use crate::render::{CameraModel, Frame, ImageSize, Preset, Renderer, Reuse, Settings, View, Work, renderer};
use crate::space::{PreparedVolume, TransferFunction};
use crate::volume::Volume;

/// One simulation step, as a line of the log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LogLine {
    /// Simulated time, s.
    pub t: f64,
    /// Position, world mm.
    pub position: [f64; 3],
    /// Unit view direction.
    pub forward: [f64; 3],
    /// Unit up direction.
    pub up: [f64; 3],
    /// Velocity, world mm/s.
    pub velocity: [f64; 3],
    /// Distance from the camera's centre to the nearest wall, mm.
    pub clearance_mm: f64,
    /// State of the flight.
    pub state: State,
    /// Name of the guide.
    pub guide: String,
}

/// The steps since the log was last written.
#[derive(Resource, Default)]
pub struct FlightLog(pub Vec<LogLine>);

/// The name of the guide, for the log.
#[derive(Resource, Clone, Copy, Debug)]
pub struct GuideName(pub &'static str);

/// A view: an image of the scan and the settings it is made with. Every entity with this component is rendered each frame.
///
/// The camera has one in a scene with a window or a recording. Add more with `app::Views::add`, or spawn them. An entity with a
/// view needs a viewpoint: its own [`Pose`], or [`Follows`].
#[derive(Component)]
#[require(FrameCache)]
pub struct Picture {
    /// Camera model.
    pub camera: CameraModel,
    /// View angle over the shorter side, degrees.
    pub fov_degrees: f64,
    /// Quality and other settings of the renderer.
    pub settings: Settings,
    /// Renderer.
    pub preset: Preset,
    /// Sample budget of an image for adaptive detail; `None` for the renderer's default.
    pub budget: Option<Budget>,
    /// The entity whose [`Scan`](super::scan::Scan) is shown; `None` for the scan that is flown through.
    pub scan: Option<Entity>,
    /// The image. Its size is the size of the view.
    pub frame: Frame,
    /// Viewpoint and camera of the current image; `None` before the first one.
    pub view: Option<View>,
    /// Work done for the last image.
    pub work: Work,
    /// True if the next frame must trace this view. A view that has changed, or whose settings, preset or scan have, is
    /// traced in any case.
    pub due: bool,
    /// True if this frame has traced the view.
    pub traced: bool,
    /// True if a post-process resized the image in this frame; the change was undone.
    pub resized: bool,
}

impl Picture {
    /// Creates a view of `width` × `height` pixels: perspective, 90°, the default renderer at high quality.
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

    /// Like [`Picture::new`], with the distance to the wall for each pixel. The renderer fills it along with the colours, and
    /// post-processes and presenters read it from [`Frame::depth`].
    pub fn with_depth(width: usize, height: usize) -> Self {
        Self { frame: Frame::with_depth(width, height), ..Self::new(width, height) }
    }

    /// Restores the image to the size that it was traced in.
    pub fn keep_size(&mut self) {
        let Some(view) = self.view.as_ref().filter(|_| self.traced) else { return };
        let size = ImageSize::new(view.width(), view.height());
        if self.frame.size() != size {
            self.frame.resize(size.width, size.height);
            self.resized = true;
        }
    }
}

/// Makes a view follow another entity: the flight's camera, unless one is named.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq)]
pub struct Follows {
    /// The entity whose pose the view follows; `None` for the flight's camera.
    pub whom: Option<Entity>,
    /// Rotation of the view to the right, degrees.
    pub yaw_degrees: f64,
    /// Upward tilt of the rotated view, degrees.
    pub pitch_degrees: f64,
    /// Offset of the view from the entity that it follows, mm: to the right, upwards and forward.
    pub offset_mm: DVec3,
}

impl Follows {
    /// Looks back from the flight's camera.
    pub fn rear() -> Self {
        Self { yaw_degrees: 180.0, ..Self::default() }
    }

    /// Returns the view's pose, given the `pose` of the entity that it follows.
    pub fn pose(&self, pose: &Pose) -> Pose {
        let mut attitude = pose.attitude;
        let [right, up, forward] = [attitude.right(), attitude.up, attitude.forward];
        let offset = right * self.offset_mm.x + up * self.offset_mm.y + forward * self.offset_mm.z;
        attitude.rotate(up, -self.yaw_degrees.to_radians());
        attitude.rotate(attitude.right(), self.pitch_degrees.to_radians());
        Pose { position: pose.position + offset, attitude }
    }
}

/// A view's renderer, with the data that it keeps between images.
#[derive(Component, Default)]
pub struct FrameCache {
    kept: Option<Kept>,
}

struct Kept {
    renderer: Box<dyn Renderer>,
    settings: Settings,
    preset: Preset,
    /// The voxels that it renders; the transfer function defines their wall.
    volume: Arc<Volume>,
    transfer: TransferFunction,
}

impl FrameCache {
    /// Returns true if the existing renderer is that of `scan` with these settings.
    pub fn is_renderer_for(&self, scan: &PreparedVolume, settings: Settings, preset: Preset) -> bool {
        self.kept.as_ref().is_some_and(|k| {
            (k.settings, k.preset, k.transfer) == (settings, preset, scan.transfer())
                && std::ptr::eq(&*k.volume, scan.voxels())
        })
    }

    /// Returns the renderer of `scan` with these settings: the existing one, or a new one if anything has changed.
    pub fn renderer_for(
        &mut self,
        scan: &PreparedVolume,
        settings: Settings,
        preset: Preset,
    ) -> &mut (dyn Renderer + 'static) {
        if !self.is_renderer_for(scan, settings, preset) {
            // Drop the old one first: both at once would double the memory.
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

    /// Returns the renderer, if there is one yet.
    pub fn renderer(&self) -> Option<&dyn Renderer> {
        self.kept.as_ref().map(|k| &*k.renderer)
    }

    /// Returns true if rendering the same view again with `picture`'s settings would improve or change the image.
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
    use crate::testing::Room;

    #[test]
    fn a_view_turns_and_stands_off_as_it_is_told() {
        let camera = Pose { position: DVec3::new(1.0, 2.0, 3.0), attitude: Attitude::new(DVec3::Y, DVec3::Z) };
        let near = |a: DVec3, b: DVec3| assert!(a.distance(b) < 1e-12, "{a} {b}");
        let rear = Follows::rear().pose(&camera);
        near(rear.attitude.forward, DVec3::NEG_Y);
        near(rear.attitude.up, DVec3::Z);
        // Facing posterior with superior on top, the patient's left is on the right.
        let right = Follows { yaw_degrees: 90.0, ..Follows::default() }.pose(&camera);
        near(right.attitude.forward, DVec3::X);
        let up = Follows { yaw_degrees: 90.0, pitch_degrees: 90.0, ..Follows::default() }.pose(&camera);
        near(up.attitude.forward, DVec3::Z);
        near(up.attitude.up, DVec3::NEG_X);
        let off = Follows { offset_mm: DVec3::new(1.0, 10.0, 100.0), ..Follows::default() }.pose(&camera);
        near(off.position - camera.position, DVec3::new(1.0, 100.0, 10.0));
        assert_eq!(off.attitude, camera.attitude);
    }

    #[test]
    fn a_picture_is_that_of_the_walls_present_thresholds() {
        let room = Room::new([10, 30, 10]);
        let scan = room.scan();
        let other = PreparedVolume::new(scan.shared_voxels(), TransferFunction::new(-990.0, -900.0).unwrap());
        let view = View::new(room.centre(), DVec3::new(0.3, 1.0, 0.2), DVec3::Z, 90.0, 16, 12).unwrap();
        let render = |cache: &mut FrameCache, scan: &PreparedVolume| {
            let mut frame = Frame::with_depth(16, 12);
            cache.renderer_for(scan, Settings::default(), Preset::default()).render(&view, &mut frame);
            frame
        };
        let mut cache = FrameCache::default();
        let before = render(&mut cache, &scan);
        let after = render(&mut cache, &other);
        assert!(after == render(&mut FrameCache::default(), &other), "as by a renderer that knows no other");
        assert!(after != before, "the wall is elsewhere");
        assert!(render(&mut cache, &scan) == before);
    }
}
