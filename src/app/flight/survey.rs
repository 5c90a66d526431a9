//! What a flight has covered: its path, its share of the plan, the segments left, and the wall seen.

use std::sync::Arc;

use glam::DVec3;

use super::{FlightApp, Setup};
use crate::components::flight::Flown;
use crate::components::play::Playback;
use crate::components::review::ReviewStop;
use crate::components::trail::Trail;
use crate::coverage::{Coverage, LiveCoverage, LookFrom, Missed, Scans, Sight, Wall, missed, part, sight_camera};
use crate::error::{Error, Kind, Result};
use crate::fields::{Along, AlongColon, lumen};
use crate::render::Camera;
use crate::space::PreparedVolume;

/// A review flies back over the whole way if that shows at least this share of the wall.
const BACK_GAINS: f64 = 0.005;
/// The end of the way is somewhere else if it is farther from the camera than this, mm.
const END_MM: f64 = 20.0;
/// The stage in which what was seen is computed.
const LOOKING: &str = "looking at the wall";

/// What a flight has covered so far, from [`FlightApp::survey`].
#[derive(Clone, Copy)]
pub struct Survey<'a> {
    pub(super) flight: &'a FlightApp,
    /// The wall of the gas that is flown, if only that counts.
    pub(super) as_flown: Option<&'a LiveCoverage>,
}

/// The coverage of a flight, from [`Survey::coverage`].
#[derive(Clone, Debug)]
pub struct Covered {
    /// The wall.
    pub wall: Wall,
    /// What is seen of each of its triangles.
    pub sights: Vec<Sight>,
    /// The shares of its area.
    pub coverage: Coverage,
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

    /// Returns the flight's camera with a view angle, degrees.
    fn camera(self, fov_degrees: f64) -> Result<Arc<dyn Camera>> {
        let model = self.flight.setup().scene.image.camera;
        sight_camera(model, fov_degrees).map_err(|e| match e.kind {
            Kind::Usage => Error::usage("--fov", e.why, "give an angle such as 90"),
            _ => e,
        })
    }

    /// Returns the coverage of the wall of the gas flown through: see [`crate::coverage`]. With `count`, all views that see a
    /// triangle are counted, which takes longer. `None` if that gas is not known.
    ///
    /// # Errors
    /// Returns status 2 if the view angle is invalid, status 4 if interrupted.
    pub fn coverage(self, fov_degrees: f64, count: bool) -> Result<Option<Covered>> {
        let camera = self.camera(fov_degrees)?;
        let views = self.trail().map_or(&[][..], Trail::views);
        let progress = &self.flight.progress;
        progress.call(|| {
            let Some(wall) = self.wall()? else { return Ok(None) };
            progress.stage(LOOKING, 0);
            let sights = wall.seen(self.looked_through(), views, &*camera, count, progress)?;
            let coverage = wall.coverage(&sights);
            Ok((!wall.is_empty()).then_some(Covered { wall, sights, coverage }))
        })
    }

    /// Adds what the views from number `since` on have seen of the wall that was not seen before. The counts of the other triangles
    /// stay.
    ///
    /// # Errors
    /// Returns status 2 if the view angle is invalid, status 4 if interrupted: then nothing is added.
    pub fn cover_more(self, covered: &mut Covered, fov_degrees: f64, since: usize) -> Result<()> {
        let views = self.trail().map_or(&[][..], Trail::views);
        let (unseen, numbers) = covered.wall.part(|n| covered.sights[n].ahead == 0);
        let camera = self.camera(fov_degrees)?;
        let (progress, views) = (&self.flight.progress, views.get(since..).unwrap_or(&[]));
        let more = progress.call(|| {
            progress.stage(LOOKING, 0);
            unseen.seen(self.looked_through(), views, &*camera, false, progress)
        })?;
        part::add(&mut covered.sights, &numbers, &more);
        drop((unseen, numbers, more));
        covered.coverage = covered.wall.coverage(&covered.sights);
        Ok(())
    }

    /// Returns the places that a review should visit, for [`FlightCommand::Review`](crate::components::input::FlightCommand::Review).
    ///
    /// If looking back from the places flown shows much more, the review flies back: it visits the far end of the first `flown`
    /// views, and what is seen on the way needs no stop. Each stop shows a patch of at least `least_mm2` that was not seen. A patch
    /// that another stop shows well gets none.
    ///
    /// # Errors
    /// Returns status 2 if the view angle is invalid, status 4 if interrupted.
    pub fn review_stops(
        self,
        covered: &Covered,
        fov_degrees: f64,
        flown: usize,
        least_mm2: f64,
    ) -> Result<Vec<ReviewStop>> {
        let camera = self.camera(fov_degrees)?;
        let Coverage { one_way, both_ways } = covered.coverage;
        let is_back = both_ways - one_way >= BACK_GAINS;
        let is_seen = |n: usize| if is_back { covered.sights[n].either } else { covered.sights[n].ahead > 0 };
        let mut stops = Vec::new();
        if is_back {
            let here = self.flight.pose().position;
            let views = self.trail().map_or(&[][..], Trail::views);
            let flown = &views[..flown.min(views.len())];
            let ends = [flown.first(), flown.last()].into_iter().flatten().map(|v| v.0);
            stops.extend(ends.filter(|end| end.distance(here) > END_MM).map(|end| ReviewStop::new(end, None)));
        }
        let (unseen, numbers) = covered.wall.part(|n| !is_seen(n));
        // The tour has an order of its own.
        let patches = self.missed_by(covered, is_seen, least_mm2, |_| None)?;
        let progress = &self.flight.progress;
        let visit = || missed::to_visit(&patches, &unseen, &numbers, self.looked_through(), &*camera, progress);
        let visited = progress.call(visit)?;
        let stop = |n: usize| Some(ReviewStop::new(patches[n].look_from?.position, Some(patches[n].position)));
        stops.extend(visited.into_iter().filter_map(stop));
        Ok(stops)
    }

    /// Returns a stop that looks at each place (world mm) on the wall, such as that of a candidate; `None` for a place that is not
    /// on the wall that was flown along, or in front of which the camera does not fit.
    ///
    /// # Errors
    /// Returns status 4 if interrupted.
    pub fn stops_to_see(self, covered: &Covered, places: &[DVec3]) -> Result<Vec<Option<ReviewStop>>> {
        let FlightApp { setup, progress, .. } = self.flight;
        let radius_mm = setup.scene.body.radius_mm;
        let look = || missed::look_at(&covered.wall, places, self.scans(), radius_mm, progress);
        let looks = progress.call(look)?;
        let stop = |(look, &place): (Option<LookFrom>, &DVec3)| Some(ReviewStop::new(look?.position, Some(place)));
        Ok(looks.into_iter().zip(places).map(stop).collect())
    }

    /// Returns the same survey of the scan that is flown through, even while a window shows another one. `wall` is that of the gas
    /// that is flown.
    #[must_use]
    pub fn as_flown(self, wall: &'a LiveCoverage) -> Self {
        Self { as_flown: Some(wall), ..self }
    }

    /// Returns the coverage of another scan, if a window shows that in place of the one that is flown through.
    fn beside(self) -> Option<&'a LiveCoverage> {
        let Setup { lumen, plan, .. } = &self.flight.setup;
        let flown = plan.gas.as_ref().unwrap_or(lumen);
        let watched = self.flight.camera::<LiveCoverage>().filter(|_| self.as_flown.is_none());
        watched.filter(|live| live.is_beside() && live.belongs_to(flown))
    }

    /// Returns the scan whose wall is looked at.
    fn looked_through(self) -> &'a PreparedVolume {
        self.scans().shown
    }

    fn scans(self) -> Scans<'a> {
        let flown = &self.flight.setup.volume;
        Scans { shown: self.beside().map_or(flown, |live| live.scan(flown)), flown }
    }

    /// Returns the wall of the gas flown through; `None` if that gas is not known.
    fn wall(self) -> Result<Option<Wall>> {
        let views = self.trail().map_or(&[][..], Trail::views);
        let FlightApp { setup: Setup { volume, lumen, plan, told, .. }, progress, .. } = self.flight;
        let mut gas = plan.gas.clone().unwrap_or_else(|| Arc::clone(lumen));
        if gas.segments.is_empty()
            && let Some(first) = views.first()
        {
            // A log is played: the colon has not been segmented yet.
            gas = Arc::new(lumen::find_told(volume.voxels(), told, progress)?);
            if gas.segment_at(first.0).is_none()
                && let Some(there) = lumen::gas_at(volume.voxels(), first.0, progress)?
            {
                gas = Arc::new(there);
            }
        }
        let beside = self.beside();
        let looked_at = beside.map_or(&gas, LiveCoverage::gas);
        let mut flown: Vec<usize> = views.iter().filter_map(|v| looked_at.segment_at(v.0)).collect();
        flown.sort_unstable();
        flown.dedup();
        if flown.is_empty() {
            return Ok(None);
        }
        let watched = self.as_flown.or(self.flight.camera()).filter(|l| l.is_of(&gas));
        if let Some(live) = beside.or(watched) {
            return Ok(Some(live.wall_of(&flown)));
        }
        Wall::of(volume.voxels(), &gas, &flown, volume.transfer().iso(), progress).map(Some)
    }

    /// Returns the patches that were not seen, at least 300 mm² large, the largest first.
    ///
    /// # Errors
    /// Returns status 4 if interrupted.
    pub fn missed(self, covered: &Covered) -> Result<Vec<Missed>> {
        let along = self.along()?;
        self.missed_by(covered, |n| covered.sights[n].ahead > 0, missed::LEAST_MM2, |p| along.of(p))
    }

    /// Returns the measure along the colon that is flown, which the first call computes.
    ///
    /// # Errors
    /// Returns status 4 if interrupted.
    pub fn along(self) -> Result<Arc<Along>> {
        let FlightApp { setup: Setup { volume, lumen, plan, .. }, progress, .. } = self.flight;
        progress.call(|| plan.gas.as_ref().unwrap_or(lumen).along(volume.voxels(), progress))
    }

    /// Returns the patches of at least `least_mm2` for whose triangles `is_seen` is false, the largest first, with their places `along`
    /// the colon.
    fn missed_by(
        self,
        covered: &Covered,
        is_seen: impl Fn(usize) -> bool,
        least_mm2: f64,
        along: impl Fn(DVec3) -> Option<AlongColon> + Sync,
    ) -> Result<Vec<Missed>> {
        let FlightApp { setup, progress, .. } = self.flight;
        let radius_mm = setup.scene.body.radius_mm;
        progress.call(|| missed::missed(&covered.wall, is_seen, least_mm2, along, self.scans(), radius_mm, progress))
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
    use crate::fields::Lumen;
    use crate::fields::lumen::Segment;
    use crate::progress::Progress;
    use crate::testing::Room;
    use crate::{Plan, Scene};

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

    #[test]
    fn a_flight_watches_the_coverage_from_its_start() {
        let room = Room::new([20, 60, 20]);
        let volume = room.scan();
        let lumen = Arc::new(lumen::gas_at(volume.voxels(), room.centre(), &Progress::new()).unwrap().unwrap());
        let plan = Plan::between(DVec3::splat(10.0), DVec3::new(10.0, 50.0, 10.0), 40.0);
        let mut flight = FlightApp::new(volume, lumen, plan, Scene { coverage: true, ..Scene::default() }).unwrap();
        assert_eq!(flight.camera::<LiveCoverage>().map(LiveCoverage::share), Some(0.0));
        flight.fly(0.5).unwrap();
        assert!(flight.camera::<LiveCoverage>().unwrap().share() > 0.3);
    }
}
