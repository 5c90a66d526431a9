//! Builds the fields that a guide needs on a separate thread while the flight continues.

use std::sync::Arc;

use super::background::Background;
use super::job::Job;
use crate::app::Fields;
use crate::app::{FlightApp, Setup};
use crate::error::Result;
use crate::schedule::GuideEntry;

/// Starts to build what `guide` needs for the current flight, and returns its name with the fields; `None` if nothing is missing.
pub(crate) fn begin(
    flight: &FlightApp,
    guide: &GuideEntry,
    background: &Background,
) -> Option<Result<Job<(&'static str, Fields)>>> {
    let (wanted, guide) = (guide.needs, guide.name);
    let Setup { volume, lumen, plan, scene, fields, .. } = flight.setup();
    if fields.has(wanted, plan) || scene.play().is_some() {
        return None;
    }
    let (volume, lumen, plan) = (volume.shared_voxels(), Arc::clone(lumen), plan.clone());
    let (mut fields, radius_mm) = (fields.clone(), scene.body.radius_mm);
    Some(background.start("planning", move |progress| {
        fields.build(wanted, &volume, &lumen, &plan, radius_mm, progress).map(|()| (guide, fields))
    }))
}
