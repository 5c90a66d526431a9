//! The rest of a tour, after a stop that the camera has not reached.
//!
//! A camera that hangs before a stop gives the stop up and flies back over its own trail to the last place with room. The rest of the tour
//! is planned from there: first the stops to which a way leads on which the body fits, and not past the place where it hung, then the others.

use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;

use super::{FlightApp, NO_PATH};
use crate::components::flight::{Flight, State};
use crate::components::guide::Planned;
use crate::components::review::{Review, ReviewStop};
use crate::components::scan::Walls;
use crate::components::trail::Trail;
use crate::dynamics::route::back::way_back;
use crate::error::Result;
use crate::fields::centerline::legs::Legs;
use crate::fields::{Clearances, WallDistance};

/// A place has room if this much is free around the body, mm.
const ROOM_MM: f64 = 0.5;
/// Distances back over the trail at which a place with room is looked for, mm: from the nearest one, there may be no way on.
const BACK_MM: [f64; 6] = [0.0, 10.0, 20.0, 40.0, 80.0, 160.0];
/// A camera that has moved away by more than this does not hang any more, mm.
const HANGS_MM: f64 = 6.0;
/// The place that it cannot pass is this far ahead along the way, mm, and a way leads past it if it comes this near, mm.
const AHEAD_MM: f64 = 4.0;
const PAST_MM: f64 = 3.0;

impl FlightApp {
    /// Returns the ways back over the trail, each from the camera to a place with room, nearest first; the camera's place alone if it does
    /// not hang there.
    pub(super) fn ways_back(&self) -> Vec<Vec<DVec3>> {
        let here = self.pose().position;
        let hung = self.camera::<Review>().and_then(|r| r.hung).or(self.hung);
        let walls = self.app.scan_get::<Walls>().filter(|_| hung.is_some_and(|h| h.distance(here) <= HANGS_MM));
        let (Some(walls), Some(trail)) = (walls, self.camera::<Trail>()) else { return vec![vec![here]] };
        let trail: Vec<DVec3> = trail.views().iter().map(|v| v.0).collect();
        let way = way_back(&trail, &walls.0, here);
        let least_mm = self.setup.scene.body.radius_mm + ROOM_MM;
        let (mut found, mut mm) = (Vec::new(), 0.0);
        for (n, &place) in way.iter().enumerate() {
            mm += way[n.saturating_sub(1)].distance(place);
            let due = BACK_MM.get(found.len()).is_some_and(|&due| mm >= due);
            if due && walls.0.clearance(place).mm >= least_mm {
                found.push(way[..=n].to_vec());
            }
        }
        if found.is_empty() { vec![way] } else { found }
    }

    /// True if the camera hangs where it was when the last review ended: the review's last stop was not reached.
    #[doc(hidden)]
    pub fn hangs(&self) -> bool {
        let here = self.pose().position;
        self.reviewing.is_none() && self.hung.is_some_and(|h| h.distance(here) <= HANGS_MM)
    }

    /// Plans the rest of the tour from where the camera is, after a stop that it did not reach, or with the stops that it kept for later.
    /// Ends the review if no stop is left, and calls the operator if no path leads to any of them.
    fn plan_rest(&mut self) -> Result<()> {
        let (Some(now), Some(review)) = (&self.reviewing, self.camera::<Review>()) else { return Ok(()) };
        let (reached, failed, hung) = (review.reached, review.failed, review.hung);
        let mut rest = now.stops.get(review.next..).unwrap_or_default().to_vec();
        let mut later = now.later.clone();
        if rest.is_empty() {
            std::mem::swap(&mut rest, &mut later);
        }
        if rest.is_empty() {
            return self.end_review();
        }
        let left = rest.len() + later.len();
        let walls = self.walls_to_tour()?;
        if hung.is_some() {
            let doubtful = self.are_doubtful(&walls, &rest)?;
            if doubtful.contains(&false) {
                let (behind, free): (Vec<_>, Vec<_>) = rest.into_iter().zip(doubtful).partition(|(_, doubt)| *doubt);
                rest = free.into_iter().map(|f| f.0).collect();
                later.extend(behind.into_iter().map(|b| b.0));
            }
        }
        match self.tour_from_here(&walls, &rest) {
            Ok((tour, stops)) => {
                let (plan, fields) = self.along(&tour);
                (self.setup.plan, self.setup.fields) = (plan, fields);
                if let Some(now) = &mut self.reviewing {
                    (now.tour, now.stops, now.later) = (tour, stops, later);
                    (now.reached, now.failed, now.hung) = (reached, failed, hung);
                }
                self.fly_tour()
            }
            Err(e) if e.what == NO_PATH => {
                let place = self.pose().position;
                if let Some(mut review) = self.camera_mut::<Review>() {
                    review.replan = false;
                }
                if let Some(mut flight) = self.camera_mut::<Flight>() {
                    (flight.state, flight.place) = (State::Operator, place);
                    let stops = if left == 1 { "1 stop".to_owned() } else { format!("{left} stops") };
                    flight.reason = format!("the review cannot go on: no path leads to the {stops} left");
                }
                Ok(())
            }
            Err(e) => Err(e),
        }
    }

    /// Returns for each of `stops` whether the way there, from the last place with room, leads past the place where the camera hangs, or
    /// through one that is narrower than the body. Ways are planned voxel by voxel, and the body obeys the exact clearance.
    fn are_doubtful(&self, walls: &WallDistance, stops: &[ReviewStop]) -> Result<Vec<bool>> {
        let here = self.pose().position;
        let from = self.ways_back().first().and_then(|w| w.last()).copied().unwrap_or(here);
        let (Some(planned), Some(exact)) = (self.camera::<Planned>(), self.app.scan_get::<Walls>()) else {
            return Ok(vec![false; stops.len()]);
        };
        let s = planned.route.nearest_pass(&exact.0, here, planned.s_mm).unwrap_or(planned.s_mm);
        let ahead = planned.route.place(s + AHEAD_MM);
        let places: Vec<DVec3> = std::iter::once(from).chain(stops.iter().map(|s| DVec3::from_array(s.at))).collect();
        let radius_mm = self.setup.scene.body.radius_mm;
        let legs = Legs::between(walls, &places, radius_mm, &self.progress)?;
        let holds = |p: &DVec3| p.distance(ahead) < PAST_MM || exact.0.clearance(*p).mm < radius_mm;
        let past = |n: usize| legs.line(0, n).is_some_and(|l| l.points.iter().any(holds));
        Ok((1..places.len()).into_par_iter().map(past).collect())
    }

    /// Goes on with a review: plans the rest of a tour whose next stop was not reached, and ends one that is over.
    pub(in super::super) fn go_on_with_review(&mut self) -> Result<()> {
        let Some(now) = &self.reviewing else { return Ok(()) };
        let hangs = self.camera::<Review>().is_some_and(|r| r.replan);
        let is_over = self.flight().state == State::Arrived;
        if hangs || (is_over && !now.later.is_empty()) {
            let progress = Arc::clone(&self.progress);
            return progress.call(|| self.plan_rest());
        }
        if is_over { self.end_review() } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::Scene;
    use crate::components::input::FlightCommand;
    use crate::components::output::LogLine;
    use crate::fields::lumen;
    use crate::plan::Plan;
    use crate::progress::Progress;
    use crate::space::{PreparedVolume, TransferFunction};
    use crate::volume::{Grid, Volume};

    fn stop(y: f64, x: f64) -> ReviewStop {
        ReviewStop::new(DVec3::new(20.0, y, 15.0), Some(DVec3::new(x, y, 15.0)))
    }

    /// A room of 40 × 120 × 30 mm, from which a neck leads to a chamber. Voxel by voxel it is 3 mm wide, so a way is planned through it, but
    /// the exact clearance is a little less than the body needs.
    fn flight_beside_a_chamber() -> FlightApp {
        let grid = Grid::new([80, 128, 38], DVec3::ONE, DVec3::splat(-3.5), DMat3::IDENTITY).unwrap();
        let boxes = [[[0, 40], [0, 120], [0, 30]], [[40, 46], [59, 62], [14, 17]], [[46, 66], [45, 75], [5, 25]]];
        let is_gas = |at: [usize; 3]| {
            let at = at.map(|x| x as i64 - 4);
            boxes.iter().any(|b| (0..3).all(|a| (b[a][0]..b[a][1]).contains(&at[a])))
        };
        let [x, y, _] = grid.dims();
        let voxels = (0..grid.len()).map(|n| [n % x, n / x % y, n / (x * y)]);
        let data = voxels.map(|at| if is_gas(at) { -1000 } else { -300 }).collect();
        let volume = PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default());
        let [start, goal] = [15.0, 105.0].map(|y| DVec3::new(20.0, y, 15.0));
        let gas = lumen::gas_at(volume.voxels(), start, &Progress::new()).unwrap().unwrap();
        let scene = Scene { operator: true, log: true, ..Scene::guided_by("path") };
        FlightApp::new(volume, Arc::new(gas), Plan::between(start, goal, 90.0), scene).unwrap()
    }

    fn in_the_chamber() -> ReviewStop {
        ReviewStop::new(DVec3::new(56.0, 60.5, 15.5), Some(DVec3::new(66.0, 60.5, 15.5)))
    }

    /// Flies until the review is over or calls; returns the state.
    fn fly_review(flight: &mut FlightApp) -> State {
        while flight.tour().is_some() && flight.flight().state == State::Flying && flight.clock().seconds() < 600.0 {
            flight.step().unwrap();
        }
        flight.flight().state
    }

    #[test]
    fn after_a_stop_that_is_not_reached_the_tour_goes_on_with_the_others() {
        let mut f = flight_beside_a_chamber();
        let stops = [stop(100.0, 2.0), in_the_chamber(), stop(110.0, 38.0)];
        f.act(FlightCommand::Review(stops.to_vec())).unwrap();
        assert_eq!(f.tour().unwrap().order.stops, [1, 0, 2], "the chamber comes first");
        assert_eq!(fly_review(&mut f), State::Flying, "{}", f.flight().reason);
        assert!(f.tour().is_none() && f.stops_reached() == 2 && !f.hangs());
        let log = f.take_log();
        assert!(log.iter().all(|l| l.clearance_mm >= 1.5), "no perforation");
        let gap = |w: &[LogLine]| DVec3::from_array(w[0].position).distance(DVec3::from_array(w[1].position));
        assert!(log.windows(2).all(|w| gap(w) < 1.0), "it flies back");
    }

    #[test]
    fn stops_behind_the_place_where_it_hangs_come_last_and_the_second_in_a_row_calls() {
        let mut f = flight_beside_a_chamber();
        let more = [48.0, 52.0].map(|y| ReviewStop::new(DVec3::new(56.0, y, 15.5), None));
        let stops = [more[0], in_the_chamber(), stop(100.0, 2.0), more[1]];
        f.act(FlightCommand::Review(stops.to_vec())).unwrap();
        assert_eq!(f.tour().unwrap().order.stops[3], 2, "the room comes last");
        assert_eq!(fly_review(&mut f), State::Operator);
        assert_eq!(f.stops_reached(), 1, "the room was visited before the chamber was tried again");
        // One in the chamber was tried, then the room, then the other two.
        assert_eq!(f.flight().reason, "the review did not reach its last two stops");
        assert!(f.tour().is_some());
        f.act(FlightCommand::EndReview).unwrap();
        assert!(f.tour().is_none() && f.hangs() && f.stops_reached() == 1);
    }

    #[test]
    fn the_next_tour_sets_out_from_the_last_place_with_room() {
        let mut f = flight_beside_a_chamber();
        f.act(FlightCommand::Review(vec![in_the_chamber()])).unwrap();
        fly_review(&mut f);
        assert!(f.tour().is_none() && f.stops_reached() == 0 && f.hangs());
        let walls = |f: &FlightApp, p: DVec3| f.app.scan_get::<Walls>().unwrap().0.clearance(p).mm;
        let here = f.pose().position;
        assert!(walls(&f, here) < 1.5 + ROOM_MM, "it hangs in the neck's mouth");
        let ways = f.ways_back();
        for way in &ways {
            let place = way[way.len() - 1];
            assert!(way[0] == here && walls(&f, place) >= 1.5 + ROOM_MM);
            assert!(f.camera::<Trail>().unwrap().views().iter().any(|v| v.0 == place), "it has been there");
        }
        f.act(FlightCommand::Review(vec![stop(100.0, 2.0)])).unwrap();
        let route = Arc::clone(&f.tour().unwrap().route);
        let place = ways[0][ways[0].len() - 1];
        assert!(route.points().iter().any(|p| p.distance(place) < 0.6), "the route leads there first");
        fly_review(&mut f);
        assert!(f.tour().is_none() && f.stops_reached() == 1 && f.ways_back() == [vec![f.pose().position]]);
    }
}
