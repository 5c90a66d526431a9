//! The work behind what was seen of the wall, each in the background.

use std::sync::Arc;

use bevy_ecs::prelude::Entity;
use glam::DVec3;

use super::{Done, Patch, flown};
use crate::app::{FlightApp, Setup};
use crate::components::still::StillViews;
use crate::coverage::{CoveragePaint, LiveCoverage, Scans, missed};
use crate::dynamics::Attitude;
use crate::error::Result;
use crate::fields::{Through, WallDistance};
use crate::host::window::background::Background;
use crate::host::window::job::Job;
use crate::host::window::shown::ShownScan;
use crate::progress::Progress;

/// When what is looked at again was seen, s: its paint has faded.
const LONG_AGO: f64 = f64::NEG_INFINITY;

/// Extracts the wall of the scan that is shown and looks at the views until now, in the background.
pub(super) fn begin(flight: &FlightApp, other: Option<Entity>, background: &Background) -> Result<Job<Done>> {
    let (volume, gas) = (flight.setup().volume.clone(), Arc::clone(flown(flight)));
    let shown = other.and_then(|other| ShownScan::of(flight, other));
    let (views, still) = views(flight);
    let image = flight.setup().scene.image.clone();
    let work = move |progress: &Arc<Progress>| {
        let mut coverage = match shown {
            Some(shown) => shown.coverage(progress)?,
            None => LiveCoverage::of(&volume, &gas, progress)?,
        };
        coverage.set_camera(image.camera, image.fov_degrees);
        coverage.see(&volume, &views, &still, LONG_AGO, progress)?;
        let paint = CoveragePaint::new(&coverage);
        Ok(Done::Begun(Box::new((coverage, paint))))
    };
    background.start_apart("coverage", work)
}

/// Looks at the views since a wall was watched last, in the background, and prepares its paint if there is none.
pub(super) fn catch_up(
    mut coverage: LiveCoverage,
    paint: Option<CoveragePaint>,
    flight: &FlightApp,
    background: &Background,
) -> Result<Job<Done>> {
    let (volume, (views, still)) = (flight.setup().volume.clone(), views(flight));
    let work = move |progress: &Arc<Progress>| {
        coverage.see(&volume, &views, &still, LONG_AGO, progress)?;
        let paint = paint.unwrap_or_else(|| CoveragePaint::new(&coverage));
        Ok(Done::Begun(Box::new((coverage, paint))))
    };
    background.start("coverage", work)
}

/// Returns the views of the flight's trail, and those beside it.
fn views(flight: &FlightApp) -> (Vec<(DVec3, Attitude)>, StillViews) {
    let trail = flight.survey().trail().map_or_else(Vec::new, |t| t.views().to_vec());
    (trail, flight.camera().cloned().unwrap_or_default())
}

/// Computes the distances to the wall of the gas that is flown, in the background.
pub(super) fn prepare(flight: &FlightApp, background: &Background) -> Result<Job<Done>> {
    let Setup { volume, lumen, plan, .. } = flight.setup();
    let (volume, gas) = (volume.clone(), Arc::clone(plan.gas.as_ref().unwrap_or(lumen)));
    let work = move |progress: &Arc<Progress>| {
        let walls = WallDistance::of_lumen(volume.voxels(), &gas, Through::Gas, progress)?;
        Ok(Done::Prepared(gas, Arc::new(walls)))
    };
    background.start("tour", work)
}

/// Lists the missed patches in the background.
pub(super) fn list(coverage: &LiveCoverage, flight: &FlightApp, background: &Background) -> Result<Job<Done>> {
    let (coverage, setup) = (coverage.clone(), flight.setup());
    let (radius, volume) = (setup.scene.body.radius_mm, setup.volume.clone());
    let work = move |progress: &Arc<Progress>| {
        let along = coverage.gas().along(volume.voxels(), progress)?;
        let scans = Scans { shown: coverage.scan(&volume), flown: &volume };
        let is_missed = coverage.missed();
        let (wall, place) = (coverage.wall(), |p: DVec3| along.of(p));
        let found = missed::missed(wall, |n| !is_missed[n], missed::LEAST_MM2, place, scans, radius, progress)?;
        let (unseen, numbers) = wall.part(|n| is_missed[n]);
        let mut is_visited = vec![false; found.len()];
        for n in missed::to_visit(&found, &unseen, &numbers, scans.shown, coverage.camera(), progress)? {
            is_visited[n] = true;
        }
        let mut found: Vec<Patch> = found.into_iter().zip(is_visited).collect();
        // What has no place along the colon comes last.
        let mm = |p: &Patch| p.0.along.map_or(f64::INFINITY, |a| a.mm);
        found.sort_by(|a, b| mm(a).total_cmp(&mm(b)));
        Ok(Done::Listed(found))
    };
    background.start("missed", work)
}
