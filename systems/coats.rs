//! Paints coated spots of the wall in the camera's picture.

use bevy_ecs::prelude::*;

use crate::components::coats::CoatPaint;
use crate::components::output::{FrameCache, Picture};
use crate::components::scan::Scan;
use crate::error::Result;
use crate::render::wall_paint::Pictured;
use crate::schedule::{App, FlightSystems, Main, Slot};

/// Adds the system that paints coated spots in the camera's picture, while the camera has a [`CoatPaint`].
///
/// # Errors
/// Returns status 2 if the slot is already filled.
pub fn plugin(app: &mut App) -> Result<()> {
    app.fill(Slot::Coats, "coats")?;
    app.add_systems(FlightSystems::PostProcess, paint_coats);
    Ok(())
}

/// Paints the camera's picture if it was made in this frame.
pub fn paint_coats(
    main: Single<&Scan, With<Main>>,
    scans: Query<&Scan>,
    camera: Single<(&mut CoatPaint, &mut Picture, &FrameCache), With<Main>>,
) {
    let (mut paint, mut picture, cache) = camera.into_inner();
    let picture = &mut *picture;
    let Some(view) = picture.view.as_ref().filter(|_| picture.traced) else { return };
    let scan = picture.scan.and_then(|e| scans.get(e).ok()).unwrap_or(&main);
    let distances = cache.renderer().and_then(|r| r.distances());
    paint.0.paint(Pictured { volume: &scan.0, scanned: None, view, distances }, &mut picture.frame);
}
