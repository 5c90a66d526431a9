//! Colours the wall in the camera's picture by what lies behind it.

use bevy_ecs::prelude::*;

use crate::components::output::{FrameCache, Picture};
use crate::components::scan::Scan;
use crate::components::translucent::Translucent;
use crate::error::Result;
use crate::schedule::{App, FlightSystems, Main, Slot};

/// Adds the system that colours the wall in the camera's picture, while the camera has a [`Translucent`].
///
/// # Errors
/// Returns status 2 if the slot is already filled.
pub fn plugin(app: &mut App) -> Result<()> {
    app.fill(Slot::Translucency, "translucency")?;
    app.add_systems(FlightSystems::PostProcess, look_through);
    Ok(())
}

/// Colours the camera's picture if it was made in this frame.
pub fn look_through(
    main: Single<&Scan, With<Main>>,
    scans: Query<&Scan>,
    camera: Single<(&mut Translucent, &mut Picture, &FrameCache), With<Main>>,
) {
    let (mut translucent, mut picture, cache) = camera.into_inner();
    let picture = &mut *picture;
    let Some(view) = picture.view.as_ref().filter(|_| picture.traced) else { return };
    let scan = picture.scan.and_then(|e| scans.get(e).ok()).unwrap_or(&main);
    let distances = cache.renderer().and_then(|r| r.distances());
    translucent.paint(&scan.0, view, distances, &mut picture.frame);
}
