//! Where the points of one frame are in another.

use glam::DVec3;
use rayon::prelude::*;

use super::crossing::{Crossing, SIDE};
use crate::error::Result;
use crate::progress::Progress;
use crate::render::View;
use crate::render::leap::Crossings;

/// Something lies before the point in the other frame, or its wall is seen from behind there.
pub const HIDDEN: u8 = 1;
/// The point is beyond the other frame's edges, or where its camera shows nothing.
pub const OUTSIDE: u8 = 2;

/// A point is seen if its ray meets the wall at most this much before it, mm. The crossing is exact to far less; where a ray grazes the
/// wall, rounding moves it along the ray.
const SAME_MM: f64 = 0.01;
/// The same between moments of a deformed scan, mm.
const DEFORMED_MM: f64 = 0.4;

/// The frame before or after.
#[derive(Clone, Copy)]
pub struct Neighbour<'a> {
    /// Rays through the scan at its moment.
    pub rays: &'a Crossings,
    /// Its camera and pixels.
    pub view: &'a View,
    /// Where a point of the frame is at its moment, world, mm; where it was if nothing moves.
    pub moved: Option<&'a (dyn Fn(DVec3) -> DVec3 + Sync)>,
}

/// Measures the flow of a view's pixels to a neighbour, and what of them is not seen there.
///
/// # Errors
/// Returns status 4 if interrupted.
pub(super) fn measure(
    view: &View,
    neighbour: Option<Neighbour<'_>>,
    found: &[Option<Crossing>],
    (flow, unseen): (&mut Vec<[f32; 2]>, &mut Vec<u8>),
    progress: &Progress,
) -> Result<()> {
    let width = view.width();
    flow.clear();
    unseen.clear();
    flow.resize(found.len(), [f32::NAN; 2]);
    unseen.resize(found.len(), OUTSIDE);
    let Some(to) = neighbour else { return Ok(()) };
    // A deformed scan is interpolated twice.
    let same_mm = if to.moved.is_some() { DEFORMED_MM } else { SAME_MM };
    let eye = to.rays.from(to.view.position());
    let bands = flow.par_chunks_mut(SIDE * width).zip(unseen.par_chunks_mut(SIDE * width));
    bands.zip(found.par_chunks(SIDE * width)).enumerate().try_for_each(|(band, ((flow, unseen), found))| {
        progress.check()?;
        for left in (0..width).step_by(SIDE) {
            for y in 0..found.len() / width {
                for x in left..(left + SIDE).min(width) {
                    let n = y * width + x;
                    let Some(crossing) = &found[n] else { continue };
                    let place = to.moved.map_or(crossing.place, |moved| moved(crossing.place));
                    let Some([u, v]) = to.view.project(place) else { continue };
                    let (own_u, own_v) = (x as f64 + 0.5, (band * SIDE + y) as f64 + 0.5);
                    let is_inside =
                        (0.0..to.view.width() as f64).contains(&u) && (0.0..to.view.height() as f64).contains(&v);
                    // The polynomial of a calibration means nothing beyond its picture.
                    if is_inside || to.view.pixel().is_some() {
                        flow[n] = [(u - own_u) as f32, (v - own_v) as f32];
                    }
                    let way = place - to.view.position();
                    let mm = way.length();
                    if !is_inside || to.view.ray_at(u, v).is_none() {
                        continue;
                    }
                    // A wall that is rigid and seen from behind is hidden by itself.
                    if to.moved.is_none() && crossing.normal.dot(way) >= 0.0 {
                        unseen[n] = HIDDEN;
                        continue;
                    }
                    let met = eye.first(way / mm);
                    unseen[n] = if met.is_none_or(|met| met >= mm - same_mm) { 0 } else { HIDDEN };
                }
            }
        }
        Ok(())
    })
}
