//! What a flight leaves behind: the log, the image.

use bevy_ecs::prelude::*;
use serde::{Deserialize, Serialize};

use crate::components::flight::State;
use crate::render::{CameraModel, Frame, Preset, Renderer, Settings, Work};

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

/// The image of the camera and how it is made.
#[derive(Component)]
pub struct Picture {
    /// Which camera.
    pub camera: CameraModel,
    /// View angle over the shorter side, degrees.
    pub fov_degrees: f64,
    /// Renderer's settings.
    pub settings: Settings,
    /// Which renderer.
    pub preset: Preset,
    /// The image.
    pub frame: Frame,
    /// What the last image took.
    pub work: Work,
    /// Whether the next frame is to trace it.
    pub due: bool,
    /// Whether this frame has traced it.
    pub traced: bool,
}

/// A renderer with what it keeps from one image to the next.
#[derive(Component)]
pub struct FrameCache {
    /// The renderer.
    pub renderer: Box<dyn Renderer>,
    /// What it was made for.
    pub settings: Settings,
}
