//! The visible maximum: all wall that can be seen, in any direction, from places where the camera fits.

use std::time::Instant;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::runs::{Flight, share};
use crate::dynamics::Attitude;
use crate::error::Result;
use crate::fields::ClearanceFinder;
use crate::progress::Progress;
use crate::render::camera::{Camera, CameraRay, Origins};

/// Minimum distance of a place from the wall beyond the camera's radius, mm: the same as for looks at missed patches.
const FREE_MM: f64 = 0.5;

/// A camera that looks in all directions at once.
#[derive(Debug, PartialEq)]
struct Everywhere;

impl Camera for Everywhere {
    fn ray(&self, _: DVec2) -> Option<CameraRay> {
        None
    }

    fn project(&self, place: DVec3) -> Option<DVec2> {
        place.is_finite().then_some(DVec2::ZERO)
    }

    fn origins(&self) -> Origins {
        Origins::One
    }
}

/// The visible wall, and the grids with which it was found.
pub(super) struct Visible {
    /// Whether each triangle of the wall is seen from the fine grid, from the flight's places or from those of `more`.
    pub seen: Vec<bool>,
    /// The coarse grid, and the fine one that contains it.
    pub grids: [Grid; 2],
    /// The share of the area that is in `seen`.
    pub share: f64,
    pub seconds: f64,
}

/// A grid of places.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    pub step_mm: f64,
    pub places: usize,
    /// The share of the area that is seen from these places alone.
    pub share: f64,
}

/// Looks from the places of a grid of `step_mm` in the gas that was flown, from the flight's own places, and from `more`.
pub(super) fn visible(
    flight: &Flight,
    more: &[(DVec3, Attitude)],
    step_mm: f64,
    progress: &Progress,
) -> Result<Visible> {
    let begun = Instant::now();
    let (wall, views, volume) = (&flight.wall, flight.views(), &flight.app.setup().volume);
    let [coarse, fine] = places(flight, step_mm, progress)?;
    let mut seen = vec![false; wall.len()];
    let mut look = |places: &[(DVec3, Attitude)]| -> Result<f64> {
        let sights = wall.seen(volume, places, &Everywhere, false, progress)?;
        seen.iter_mut().zip(sights).for_each(|(seen, s)| *seen |= s.ahead > 0);
        Ok(share(wall, |n| seen[n]))
    };
    let grids = [
        Grid { step_mm: 2.0 * step_mm, places: coarse.len(), share: look(&coarse)? },
        Grid { step_mm, places: coarse.len() + fine.len(), share: look(&fine)? },
    ];
    let share = look(&[views, more].concat())?;
    Ok(Visible { seen, grids, share, seconds: begun.elapsed().as_secs_f64() })
}

/// Returns the places of the grid of twice `step_mm` where the camera fits, and those that the grid of `step_mm` adds.
fn places(flight: &Flight, step_mm: f64, progress: &Progress) -> Result<[Vec<(DVec3, Attitude)>; 2]> {
    let setup = flight.app.setup();
    let gas = setup.plan.gas.as_ref().unwrap_or(&setup.lumen);
    let mut flown: Vec<usize> = flight.views().iter().filter_map(|v| gas.segment_at(v.0)).collect();
    flown.sort_unstable();
    flown.dedup();
    let bounds = flown.iter().filter_map(|&s| gas.segments.get(s)).map(|s| s.bounds_mm);
    let Some([low, high]) = bounds.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]) else {
        return Ok([Vec::new(), Vec::new()]);
    };
    let least_mm = setup.scene.body.radius_mm + FREE_MM;
    let iso = setup.volume.transfer().iso() as f32;
    let counts = ((high - low) / step_mm).floor().as_u64vec3() + 1;
    let layers = (0..counts.z)
        .into_par_iter()
        .map(|k| {
            progress.check()?;
            let walls = ClearanceFinder::new(setup.volume.shared_voxels(), iso, least_mm + 0.5);
            let mut layer = [Vec::new(), Vec::new()];
            for (j, i) in (0..counts.y).flat_map(|j| (0..counts.x).map(move |i| (j, i))) {
                let at = low + DVec3::new(i as f64, j as f64, k as f64) * step_mm;
                let is_flown = gas.segment_at(at).is_some_and(|s| flown.binary_search(&s).is_ok());
                if is_flown && walls.at(at).mm >= least_mm {
                    let is_new = (i | j | k) & 1 == 1;
                    layer[usize::from(is_new)].push((at, Attitude::new(DVec3::Z, DVec3::X)));
                }
            }
            Ok(layer)
        })
        .collect::<Result<Vec<_>>>()?;
    let mut all = [Vec::new(), Vec::new()];
    for layer in layers {
        all.iter_mut().zip(layer).for_each(|(all, more)| all.extend(more));
    }
    Ok(all)
}
