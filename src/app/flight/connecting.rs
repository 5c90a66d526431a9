//! How the colon continues beyond the gas that is flown.

use std::sync::{Arc, OnceLock};
use std::thread;

use crate::FlightApp;
use crate::error::Result;
use crate::fields::Lumen;
use crate::fields::connection::Connection;
use crate::flight::Setup;
use crate::plan::Plan;
use crate::progress::Progress;
use crate::space::PreparedVolume;

/// The connection of a flight's ends, found when it is first asked for.
#[derive(Debug, Default)]
pub(super) struct Connecting {
    found: Arc<OnceLock<Option<Connection>>>,
    /// The search in the background, if there is one.
    search: OnceLock<Progress>,
}

impl Drop for Connecting {
    fn drop(&mut self) {
        if let Some(progress) = self.search.get() {
            progress.cancel();
        }
    }
}

impl FlightApp {
    /// Returns the connection between the requested ends of the colon, in stretches of gas, of fluid, and where the lumen is
    /// collapsed. The first call searches for it, which takes up to a second for each gap. `None` if the ends are in one segment of
    /// gas, or in none.
    ///
    /// Only gas is flown.
    ///
    /// # Errors
    /// Returns status 4 when interrupted.
    pub fn connection(&self) -> Result<Option<&Connection>> {
        let Connecting { found, .. } = &self.connecting;
        if found.get().is_none() {
            let Setup { volume, lumen, plan, .. } = &self.setup;
            let way = self.progress.call(|| search(volume, lumen, plan, &self.progress))?;
            found.get_or_init(|| way);
        }
        Ok(found.get().and_then(Option::as_ref))
    }

    /// Returns the connection, if it is found already.
    #[doc(hidden)]
    pub fn found_connection(&self) -> Option<&Connection> {
        self.connecting.found.get().and_then(Option::as_ref)
    }

    /// Searches for the connection in the background, unless it is known. True while the search continues.
    pub(crate) fn seek_connection(&self) -> bool {
        let Connecting { found, search: going } = &self.connecting;
        if found.get().is_some() {
            return false;
        }
        going.get_or_init(|| {
            let (progress, found) = (Progress::new(), Arc::clone(found));
            let (volume, lumen, plan) =
                (self.setup.volume.clone(), Arc::clone(&self.setup.lumen), self.setup.plan.clone());
            let seen = progress.clone();
            let work = move || {
                let way = search(&volume, &lumen, &plan, &seen).unwrap_or_default();
                found.get_or_init(|| way);
            };
            // Without a thread nothing is drawn, and the flight continues.
            drop(thread::Builder::new().name("connection".to_owned()).spawn(work));
            progress
        });
        true
    }
}

fn search(volume: &PreparedVolume, lumen: &Lumen, plan: &Plan, progress: &Progress) -> Result<Option<Connection>> {
    if plan.gas.is_some() {
        return Ok(None);
    }
    let [from, to] = plan.asked.places().map(Into::into);
    Connection::between(volume.voxels(), lumen, from, to, progress)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::connection::StretchKind;
    use crate::phantom::{PhantomSettings, Size};
    use crate::shared::shared;
    use crate::{FlightRequest, OpenOptions, Place, Scan, Scene};

    #[test]
    fn a_flight_tells_how_the_colon_goes_on_and_flies_no_guess() {
        let settings = PhantomSettings { size: Size::Small, collapsed: true, seed: 3, ..PhantomSettings::default() };
        let mut scan = Scan::of(shared(&settings).1, &OpenOptions::default()).unwrap();
        let request = FlightRequest { from: Some(Place::Rectum), to: Some(Place::Cecum), reverse: false };
        let flight = scan.flight(Scene::default(), &request).unwrap();
        assert!(flight.found_connection().is_none(), "nothing is computed unasked");
        let way = flight.connection().unwrap().unwrap();
        let kinds: Vec<_> = way.stretches.iter().map(|s| s.kind).collect();
        use StretchKind::{Collapsed, Gas};
        assert_eq!(kinds, [Gas, Collapsed, Gas, Collapsed, Gas]);
        assert!(way.stretches.windows(2).all(|w| w[0].points.last() == w[1].points.first()));
        // What is flown ends in the first stretch of gas.
        let first = way.stretches[0].points[way.stretches[0].points.len() - 1];
        assert_eq!(flight.setup().plan.segment, Some(0));
        assert!(flight.setup().plan.goal().at.distance(first) < 60.0);
        // In the background it is the same.
        let other = scan.flight(Scene::default(), &request).unwrap();
        while other.seek_connection() {
            thread::yield_now();
        }
        assert_eq!(other.found_connection(), Some(way));
        // Within one segment there is nothing to tell.
        let there = Place::World(scan.lumen().unwrap().segments[1].ends[0]);
        let within = FlightRequest { from: Some(there), to: Some(there), reverse: false };
        let within = scan.flight(Scene::default(), &within);
        assert!(within.is_err() || within.unwrap().connection().unwrap().is_none());
    }
}
