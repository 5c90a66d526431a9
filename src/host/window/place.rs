//! Where the camera is along the colon, in a window: by the measure that all lists and files use, once the background has computed it,
//! and by the distance flown until then.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::job::Job;
use super::screenshot_renderer::WakeUp;
use crate::app::{FlightApp, Setup};
use crate::error::Result;
use crate::fields::{Along, AlongColon, Lumen};
use crate::progress::Progress;

/// Time between two places.
const LOOKS: Duration = Duration::from_millis(250);

/// The camera's place along the colon.
pub(crate) struct Place {
    /// The lumen that is flown, and what is known of the measure along it.
    flown: Option<(Arc<Lumen>, Known)>,
    at: Option<AlongColon>,
    looked: Instant,
}

enum Known {
    Computing(Job<Arc<Along>>),
    Yes(Arc<Along>),
    /// It failed: the distance flown has to do.
    No,
}

impl Place {
    pub(crate) fn new(now: Instant) -> Self {
        Self { flown: None, at: None, looked: now }
    }

    /// Looks where the camera is, if it is time. Starts the computation for a lumen that is new.
    pub(crate) fn update(&mut self, flight: &FlightApp, wake: &WakeUp, now: Instant) {
        // What has been computed is shown at once: the job wakes the window up, and nothing else may do so afterwards.
        let is_computing = matches!(self.flown, Some((_, Known::Computing(_))));
        if self.flown.is_some() && !is_computing && now.saturating_duration_since(self.looked) < LOOKS {
            return;
        }
        self.looked = now;
        let Setup { lumen, plan, .. } = flight.setup();
        let gas = plan.gas.as_ref().unwrap_or(lumen);
        if self.flown.as_ref().is_none_or(|f| !Arc::ptr_eq(&f.0, gas)) {
            let known = begin(flight, gas, wake).map_or(Known::No, Known::Computing);
            self.flown = Some((Arc::clone(gas), known));
        }
        let Some((_, known)) = &mut self.flown else { return };
        if let Known::Computing(job) = known
            && let Some(done) = job.take()
        {
            *known = done.map_or(Known::No, Known::Yes);
        }
        self.at = match known {
            Known::Yes(along) => along.of(flight.pose().position),
            Known::Computing(_) | Known::No => None,
        };
    }

    /// Returns the part of the colon around the camera, and "840 of 2050 mm": the distance from the rectum and the length of the
    /// whole colon. `None` if the measure is not known yet, or no line leads from the rectum to the cecum.
    pub(crate) fn text(&self) -> Option<String> {
        let (Some((_, Known::Yes(along))), Some(at)) = (&self.flown, self.at) else { return None };
        let length = along.length_mm();
        if !along.is_whole() {
            return None;
        }
        let round = |mm: f64| (mm / 10.0).round() * 10.0;
        let guessed = if at.is_guessed { ", a guess" } else { "" };
        let part = at.part.map_or_else(String::new, |p| format!("{p}, "));
        Some(format!("{part}{:.0} of {:.0} mm{guessed}", round(at.mm), round(length)))
    }
}

/// Computes the measure along the gas that is flown, in the background.
fn begin(flight: &FlightApp, gas: &Arc<Lumen>, wake: &WakeUp) -> Result<Job<Arc<Along>>> {
    let (volume, gas, wake) = (flight.setup().volume.clone(), Arc::clone(gas), Arc::clone(wake));
    let work = move |progress: &Arc<Progress>| gas.along(volume.voxels(), progress);
    Job::start("along", &Arc::new(Progress::new()), work, move || wake())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::{FlightRequest, OpenOptions, Scan, Scene};
    use crate::host::window::controller::tests::{cockpit_of, trace};
    use crate::phantom::{Phantom, PhantomSettings};

    /// A flight in a window, and the measure along its scan as that is in its file. `path` takes the tag out of it.
    fn bar_of(guide: &'static str, fluid: bool) {
        let progress = Progress::new();
        let phantom = Phantom::new(&PhantomSettings { fluid, ..PhantomSettings::embedded(1) });
        let open = || Scan::of(phantom.voxelise(&phantom.grid(), &progress).unwrap(), &OpenOptions::default()).unwrap();
        let mut in_file = open();
        let lumen = in_file.lumen().unwrap();
        let along = lumen.along(in_file.volume().voxels(), &progress).unwrap();

        let scene = Scene { picture: true, ..Scene::guided_by(guide) };
        let mut c = cockpit_of(open().flight(scene, &FlightRequest::default()).unwrap(), 0.0, Vec::new());
        let begun = Instant::now();
        trace(&mut c, begun);
        while c.cleansing().is_waiting() {
            c.advance(begun).unwrap();
        }
        let mut now = begun;
        // Until it is known, the distance flown is told.
        assert!(c.hud(now).place.contains(" of about "), "{}", c.hud(now).place);
        while c.hud(now).place.contains(" of about ") {
            assert!(begun.elapsed() < Duration::from_secs(120), "{}", c.hud(now).place);
            std::thread::sleep(Duration::from_millis(20));
            now = Instant::now();
        }
        let at = along.of(c.flight().pose().position).unwrap();
        let [mm, length] = [at.mm, along.length_mm()].map(|mm| (mm / 10.0).round() * 10.0);
        assert_eq!(c.hud(now).place, format!("{}, {mm} of {length} mm", at.part.unwrap()));
    }

    #[test]
    fn the_bar_tells_the_place_that_lists_and_files_tell() {
        bar_of("tentacles", false);
        bar_of("tentacles", true);
    }

    #[test]
    fn the_bar_tells_the_place_in_the_scan_as_it_was_where_its_tag_is_taken_out() {
        bar_of("path", true);
    }
}
