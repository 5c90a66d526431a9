//! What a guide needs of the lumen, built on a thread of its own while the flight goes on.

use std::sync::Arc;

use super::job::Job;
use crate::app::FlightApp;
use crate::app::fields::Fields;
use crate::error::Result;
use crate::progress::Progress;
use crate::schedule::GuideEntry;

/// Fields under way.
pub struct FieldJob {
    guide: &'static str,
    job: Job<Fields>,
}

impl FieldJob {
    /// Begins to build what `guide` needs for the flight as it is; none where it needs nothing that is not there.
    pub fn begin(flight: &FlightApp, guide: &GuideEntry) -> Option<Result<Self>> {
        let (wanted, guide) = (guide.needs, guide.name);
        let mut fields = flight.fields().clone();
        if fields.has(wanted, flight.plan()) || flight.scene().play().is_some() {
            return None;
        }
        let (volume, lumen, plan) = (flight.volume().shared_voxels(), flight.shared_lumen(), flight.plan().clone());
        let radius_mm = flight.scene().body.radius_mm;
        let build = move |progress: &Arc<Progress>| {
            fields.build(wanted, &volume, &lumen, &plan, radius_mm, progress).map(|()| fields)
        };
        // Nobody is to be woken: the flight goes on meanwhile, and asks before each frame.
        let job = Job::start("planning", &Arc::new(Progress::new()), build, || {});
        Some(job.map(|job| Self { guide, job }))
    }

    /// What was built, and for whom, when it is there.
    pub fn take(&mut self) -> Option<(&'static str, Result<Fields>)> {
        Some((self.guide, self.job.take()?))
    }
}
