//! Traces the image of the camera.

use bevy_ecs::prelude::*;

use crate::components::camera::Pose;
use crate::components::output::{FrameCache, Picture};
use crate::components::scan::Scan;
use crate::error::Result;
use crate::render::{Reuse, View, renderer};
use crate::schedule::{App, FlightSystems, Slot};

/// Plugs the ray caster into the renderer's slot.
///
/// # Errors
/// Status 2 when there is another one.
pub fn plugin(app: &mut App) -> Result<()> {
    app.fill(Slot::Renderer, "ray caster")?;
    app.add_systems(FlightSystems::RayCast, cast_picture);
    Ok(())
}

/// Renders the camera's view of the scan into its picture, if that is due.
pub fn cast_picture(scan: Single<&Scan>, camera: Single<(&Pose, &mut Picture, &mut FrameCache)>) {
    let (pose, mut picture, mut cache) = camera.into_inner();
    picture.traced = picture.due;
    if !std::mem::take(&mut picture.due) {
        return;
    }
    let Picture { camera, fov_degrees, settings, preset, frame, work, .. } = &mut *picture;
    if cache.settings != *settings {
        *cache = FrameCache { renderer: renderer(&scan.0, *settings, *preset, Reuse::Allowed), settings: *settings };
    }
    let attitude = pose.attitude;
    // A pose is always orthonormal and finite, so the view is always valid.
    let (width, height) = (frame.width(), frame.height());
    if let Ok(view) =
        View::with_model(pose.position, attitude.forward, attitude.up, *camera, *fov_degrees, width, height)
    {
        *work = cache.renderer.render(&view, frame);
    }
}
