//! What a flight has covered: its path, its share of the plan, the segments left, and the wall seen.

use std::sync::Arc;

use super::{FlightApp, Setup};
use crate::components::flight::Flown;
use crate::components::play::Playback;
use crate::components::trail::Trail;
use crate::error::Result;
use crate::fields::lumen;
use crate::render::{Coverage, coverage};

/// What a flight has covered until now, from [`FlightApp::survey`].
#[derive(Clone, Copy)]
pub struct Survey<'a> {
    pub(super) flight: &'a FlightApp,
}

impl<'a> Survey<'a> {
    /// Returns the segments of the lumen that are not yet flown to their end, with their gas in ml.
    pub fn unflown(self) -> Vec<(usize, f64)> {
        let flown = self.flight.camera::<Flown>().map_or(&[][..], |f| &f.done);
        let Setup { lumen, plan, .. } = &self.flight.setup;
        // The current segment is not "another one".
        let is_left = |n: &usize| !flown.contains(n) && plan.segment != Some(*n);
        lumen.segments.iter().map(|s| s.ml).enumerate().filter(|(n, _)| is_left(n)).collect()
    }

    /// Returns the flight's past views, one every 2 mm from its beginning, with their positions along the path.
    pub fn trail(self) -> Option<&'a Trail> {
        self.flight.camera()
    }

    /// Returns the share of the wall seen, in the gas flown through: see [`crate::render::coverage()`]. `None` if that gas is not
    /// known.
    ///
    /// # Errors
    /// Returns status 4 if interrupted.
    pub fn coverage(self, fov_degrees: f64) -> Result<Option<Coverage>> {
        let places = self.trail().map_or(&[][..], Trail::views);
        let FlightApp { setup: Setup { volume, lumen, plan, told, .. }, progress, .. } = self.flight;
        let mut gas = plan.gas.clone().unwrap_or_else(|| Arc::clone(lumen));
        if gas.segments.is_empty()
            && let Some(first) = places.first()
        {
            // A played log: the colon has not been segmented until now.
            gas = Arc::new(lumen::find_told(volume.voxels(), told, progress)?);
            if gas.segment_at(first.0).is_none()
                && let Some(there) = lumen::gas_at(volume.voxels(), first.0, progress)?
            {
                gas = Arc::new(there);
            }
        }
        let mut flown: Vec<usize> = places.iter().filter_map(|p| gas.segment_at(p.0)).collect();
        flown.sort_unstable();
        flown.dedup();
        let walls = gas.wall_places(&flown);
        Ok((!walls.is_empty()).then(|| coverage(volume, &walls, places, fov_degrees)))
    }

    /// Returns the share of the path behind the camera, 0 to 1, and the path's length, mm. They refer to the plan or the log that
    /// is played, or, coarsely, to the path flown.
    pub fn progress(self) -> (f64, f64) {
        let Some(trail) = self.trail() else { return (0.0, 0.0) };
        (self.flight.camera::<Playback>().map_or(trail.share(), Playback::share), trail.length_mm())
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::app::{Plan, Scene};
    use crate::fields::Lumen;
    use crate::fields::lumen::Segment;
    use crate::testing::Room;

    #[test]
    fn what_is_left_is_neither_flown_nor_being_flown() {
        let room = Room::new([20, 40, 20]);
        let volume = room.scan();
        let mut lumen = Lumen::none(volume.voxels().grid());
        let segment = |ml: f64| Segment {
            ml,
            fluid_ml: 0.0,
            bounds_mm: [DVec3::ZERO, room.size_mm()],
            ends: [DVec3::ONE; 2],
            joined_to: Vec::new(),
            length_mm: 30.0,
            way: Vec::new(),
            judged: None,
        };
        lumen.segments = [50.0, 40.0, 30.0, 20.0].map(segment).to_vec();
        let plan = Plan { segment: Some(1), ..Plan::between(room.centre(), room.centre() + DVec3::Y * 15.0, 15.0) };
        let mut flight = FlightApp::new(volume, Arc::new(lumen), plan, Scene::guided_by("manual")).unwrap();
        assert_eq!(flight.survey().unflown(), [(0, 50.0), (2, 30.0), (3, 20.0)]);
        flight.camera_mut::<Flown>().unwrap().done.push(2);
        assert_eq!(flight.survey().unflown(), [(0, 50.0), (3, 20.0)]);
        flight.camera_mut::<Flown>().unwrap().done.extend([0, 3]);
        assert!(flight.survey().unflown().is_empty());
    }
}
