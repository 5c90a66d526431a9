//! Builds the fields that a guide needs on a separate thread while the flight continues.

use std::sync::Arc;

use super::job::Job;
use crate::app::Fields;
use crate::app::{FlightApp, Setup};
use crate::error::Result;
use crate::progress::Progress;
use crate::schedule::GuideEntry;

/// Fields that are being built.
pub(crate) struct FieldJob {
    guide: &'static str,
    job: Job<Fields>,
}

impl FieldJob {
    /// Starts to build what `guide` needs for the current flight; `None` if nothing is missing.
    pub(crate) fn begin(flight: &FlightApp, guide: &GuideEntry) -> Option<Result<Self>> {
        let (wanted, guide) = (guide.needs, guide.name);
        let Setup { volume, lumen, plan, scene, fields, .. } = flight.setup();
        if fields.has(wanted, plan) || scene.play().is_some() {
            return None;
        }
        let (volume, lumen, plan) = (volume.shared_voxels(), Arc::clone(lumen), plan.clone());
        let (mut fields, radius_mm) = (fields.clone(), scene.body.radius_mm);
        let build = move |progress: &Arc<Progress>| {
            fields.build(wanted, &volume, &lumen, &plan, radius_mm, progress).map(|()| fields)
        };
        // No wake-up is needed: the flight continues meanwhile and polls before each frame.
        let job = Job::start("planning", &Arc::new(Progress::new()), build, || {});
        Some(job.map(|job| Self { guide, job }))
    }

    /// Returns the fields and the guide that they are for, once they are built.
    pub(crate) fn take(&mut self) -> Option<(&'static str, Result<Fields>)> {
        Some((self.guide, self.job.take()?))
    }
}
