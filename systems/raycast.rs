//! Traces the image of the camera.

use bevy_ecs::prelude::*;

use crate::components::camera::Pose;
use crate::components::output::{FrameCache, Picture};
use crate::components::scan::RaySpace;
use crate::components::{App, FlightSystems, Slot};
use crate::error::Result;
use crate::render::{View, render, renderer};

/// Plugs the ray caster into the renderer's slot.
pub fn plugin(app: &mut App) -> Result<()> {
    app.fill(Slot::Renderer, "ray caster")?;
    app.add_systems(FlightSystems::RayCast, cast_picture);
    Ok(())
}

/// Renders the camera's view into its picture, with the help of its frame cache if it has one.
pub fn cast_picture(scan: Single<&RaySpace>, camera: Single<(&Pose, &mut Picture, Option<&mut FrameCache>)>) {
    let (pose, mut picture, cache) = camera.into_inner();
    let Picture { fov_degrees, settings, preset, frame, work } = &mut *picture;
    let attitude = pose.attitude;
    // A pose is always orthonormal and finite, so the view is always valid.
    if let Ok(view) =
        View::new(pose.position, attitude.forward, attitude.up, *fov_degrees, frame.width(), frame.height())
    {
        *work = match cache {
            Some(mut cache) => {
                if cache.settings != *settings {
                    *cache = FrameCache { renderer: renderer(&scan.0, *settings, *preset, true), settings: *settings };
                }
                cache.renderer.render(&view, frame)
            }
            None => render(&scan.0, &view, settings, frame),
        };
    }
}
