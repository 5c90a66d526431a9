//! Reviews: the shortest tour past what a flight has missed, as a planned flight of its own.
//!
//! A camera that hangs before a stop gives the stop up and flies back over its own trail to the last place with room. The rest of the tour
//! is planned from there: first the stops whose way does not lead past the place where it hung, then the others.

use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use rayon::prelude::*;

use super::FlightApp;
use crate::components::flight::{Flight, State};
use crate::components::guide::Planned;
use crate::components::review::{Review, ReviewStop, TourStop};
use crate::components::scan::Walls;
use crate::components::trail::Trail;
use crate::coverage::tour::{self, Distances, Order};
use crate::dynamics::Route;
use crate::dynamics::monitor::MonitorSettings;
use crate::dynamics::route::back::way_back;
use crate::dynamics::route::profile::PathSettings;
use crate::error::{Error, Result};
use crate::fields::Lumen;
use crate::fields::centerline::legs::Legs;
use crate::fields::{Clearances, Through, WallDistance};
use crate::flight_fields::Fields;
use crate::plan::{FlightRequest, Plan, PlanEnd};
use crate::scene::Steering;
use crate::schedule::{Guide, Look};
use crate::systems::looks;

/// Time that a leg may take: this many times what it takes at cruise speed, and these seconds for the stop.
const SLOWER: f64 = 6.0;
const STOP_S: f64 = 25.0;
/// A place has room if this much is free around the body, mm.
const ROOM_MM: f64 = 0.5;
/// Distances back over the trail at which a place with room is looked for, mm: from the nearest one, there may be no way on.
const BACK_MM: [f64; 6] = [0.0, 10.0, 20.0, 40.0, 80.0, 160.0];
/// A camera that has moved away by more than this does not hang any more, mm.
const HANGS_MM: f64 = 6.0;
/// The place that it cannot pass is this far ahead along the way, mm, and a way leads past it if it comes this near, mm.
const AHEAD_MM: f64 = 4.0;
const PAST_MM: f64 = 3.0;

/// What an error is about if no path leads to any stop.
const NO_PATH: &str = "review";

/// A planned tour.
#[derive(Clone, Debug)]
pub struct TourPlan {
    /// The order of the stops, and its length over the lumen's cells, mm.
    pub order: Order,
    /// The distances between the stops that it was chosen by.
    pub distances: Distances,
    /// The path to fly.
    pub route: Arc<Route>,
    /// The stops, in the order of the tour.
    pub stops: Vec<TourStop>,
    /// Time for planning by the wall clock, s, …
    pub planned_s: f64,
    /// … and before it for the distances to the wall, unless they were known.
    pub distance_s: f64,
}

/// A review in progress, with the state that it replaced.
pub(super) struct Reviewing {
    tour: TourPlan,
    /// The stops of the tour, in its order, and those that are visited after them.
    stops: Vec<ReviewStop>,
    later: Vec<ReviewStop>,
    /// Number of stops reached before the tour was last planned, of those in a row before that were not, and where the camera hung then.
    reached: usize,
    failed: u32,
    hung: Option<DVec3>,
    steering: Steering,
    look: Option<Look>,
    watch: Option<MonitorSettings>,
    plan: Plan,
    fields: Fields,
    flight: Flight,
    share: f64,
}

impl FlightApp {
    /// Plans the shortest tour from the camera past `stops`. It passes through the gas that the flight is in, and keeps away from walls.
    ///
    /// # Errors
    /// Returns status 4 if no way leads to any of the stops, or if interrupted.
    pub fn plan_tour(&self, stops: &[ReviewStop]) -> Result<TourPlan> {
        let begun = Instant::now();
        self.progress.call(|| {
            let walls = self.walls_to_tour()?;
            let distance_s = begun.elapsed().as_secs_f64();
            Ok(TourPlan { distance_s, ..self.tour_from_here(&walls, stops)?.0 })
        })
    }

    /// Plans the tour from where the camera is, or if it hangs there, from the last place with room that a way leads on from. Returns it
    /// with its stops in order.
    fn tour_from_here(&self, walls: &WallDistance, stops: &[ReviewStop]) -> Result<(TourPlan, Vec<ReviewStop>)> {
        let ways = self.ways_back();
        let (last, first) = ways.split_last().map_or((&[][..], &[][..]), |(last, first)| (&last[..], first));
        for way in first {
            match self.tour_by(walls, way, stops) {
                Err(e) if e.what == NO_PATH => {}
                tour => return tour,
            }
        }
        self.tour_by(walls, last, stops)
    }

    /// Returns the ways back over the trail, each from the camera to a place with room, nearest first; the camera's place alone if it does
    /// not hang there.
    fn ways_back(&self) -> Vec<Vec<DVec3>> {
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

    /// Plans the tour with known distances to the wall, from the last place of `way` (world mm), which the camera flies to first. Returns
    /// it with its stops in order.
    fn tour_by(
        &self,
        walls: &WallDistance,
        way: &[DVec3],
        stops: &[ReviewStop],
    ) -> Result<(TourPlan, Vec<ReviewStop>)> {
        let begun = Instant::now();
        let setup = &self.setup;
        let from = way.last().copied().unwrap_or_else(|| self.pose().position);
        let mut places = vec![from];
        places.extend(stops.iter().map(|s| DVec3::from_array(s.at)));
        let legs = Legs::between(walls, &places, setup.scene.body.radius_mm, &self.progress)?;
        let distances = Distances::new(places.len(), |a, b| legs.mm(a, b));
        let mut order = tour::shortest(&distances);
        let path = setup.scene.guides.get::<PathSettings>();
        let (mut line, mut clearance, mut length) = (Vec::new(), Vec::new(), 0.0);
        let (mut toured, mut visited) = (Vec::new(), Vec::new());
        if let ([_, _, ..], Some(exact)) = (way, self.app.scan_get::<Walls>()) {
            line.extend(way);
            clearance.extend(way.iter().map(|&p| exact.0.clearance(p).mm));
            length = way.windows(2).map(|w| w[0].distance(w[1])).sum();
        }
        // From each place to the next that can be reached.
        let from = std::iter::once(0).chain(order.stops.iter().map(|n| n + 1));
        let pairs: Vec<(usize, usize)> = from.zip(order.stops.iter().copied()).collect();
        let lines: Vec<_> = pairs.par_iter().map(|&(from, stop)| legs.line(from, stop + 1)).collect();
        let mut at = 0;
        for (leg, (from, n)) in lines.into_iter().zip(pairs) {
            // After a stop that was left out, from the one before it.
            let Some(leg) = (if from == at { leg } else { legs.line(at, n + 1) }) else {
                order.left_out.push(n);
                continue;
            };
            at = n + 1;
            let skip = usize::from(!line.is_empty());
            line.extend(leg.points.iter().skip(skip));
            clearance.extend(leg.radius_mm.iter().skip(skip));
            length += leg.length_mm;
            // The first leg includes the way back.
            let leg_mm = if toured.is_empty() { length } else { leg.length_mm };
            let limit_s = STOP_S + SLOWER * leg_mm / path.cruise_mm_s;
            toured.push(TourStop { s_mm: length, look_at: stops[n].look_at.map(DVec3::from_array), limit_s });
            visited.push(stops[n]);
        }
        let route = Route::along(&line, &clearance, DVec3::NEG_Y).filter(|_| !toured.is_empty()).ok_or_else(|| {
            Error::incomplete(NO_PATH, "no path leads from the camera to a missed patch", "review by hand")
        })?;
        let planned_s = begun.elapsed().as_secs_f64();
        Ok((TourPlan { order, distances, route: Arc::new(route), stops: toured, planned_s, distance_s: 0.0 }, visited))
    }

    /// Returns the distances to the wall of the gas that is flown, built if they are not known.
    fn walls_to_tour(&self) -> Result<Arc<WallDistance>> {
        let setup = &self.setup;
        let gas = setup.plan.gas.as_ref().unwrap_or(&setup.lumen);
        let own = || self.toured.as_ref().filter(|(of, _)| Arc::ptr_eq(of, gas)).map(|(_, walls)| walls);
        if let Some(walls) = setup.fields.walls().or_else(own) {
            return Ok(Arc::clone(walls));
        }
        WallDistance::of_lumen(setup.volume.voxels(), gas, Through::Gas, &self.progress).map(Arc::new)
    }

    /// True if a tour can be planned without building the distances to the wall first.
    #[doc(hidden)]
    pub fn knows_walls_to_tour(&self) -> bool {
        let gas = self.setup.plan.gas.as_ref().unwrap_or(&self.setup.lumen);
        self.setup.fields.walls().is_some() || self.toured.as_ref().is_some_and(|(of, _)| Arc::ptr_eq(of, gas))
    }

    /// Adopts the distances to the wall of some gas, for tours through it.
    #[doc(hidden)]
    pub fn adopt_walls(&mut self, gas: Arc<Lumen>, walls: Arc<WallDistance>) {
        self.toured = Some((gas, walls));
    }

    /// Returns the tour that is being flown; `None` if there is none.
    pub fn tour(&self) -> Option<&TourPlan> {
        self.reviewing.as_ref().map(|r| &r.tour)
    }

    /// Returns the number of stops that the current review has reached, or else the last one.
    /// A stop whose time was over, or that the camera could not turn to, is not among them.
    pub fn stops_reached(&self) -> usize {
        self.camera::<Review>().map_or(self.reached, |r| r.reached)
    }

    /// True if the camera hangs where it was when the last review ended: the review's last stop was not reached.
    #[doc(hidden)]
    pub fn hangs(&self) -> bool {
        let here = self.pose().position;
        self.reviewing.is_none() && self.hung.is_some_and(|h| h.distance(here) <= HANGS_MM)
    }

    /// Starts the tour past `stops`.
    pub(super) fn review(&mut self, stops: &[ReviewStop]) -> Result<()> {
        if !self.setup.scene.moves() {
            let why = "nothing in the scene moves the camera";
            return Err(Error::incomplete("review", why, "choose a scene with a guide"));
        }
        let begun = Instant::now();
        let walls = self.walls_to_tour()?;
        let distance_s = begun.elapsed().as_secs_f64();
        let (tour, stops) = self.tour_from_here(&walls, stops)?;
        let tour = TourPlan { distance_s, ..tour };
        // The next tour needs the distances again.
        self.toured = Some((Arc::clone(self.setup.plan.gas.as_ref().unwrap_or(&self.setup.lumen)), walls));
        self.end_review()?;
        self.hung = None;
        let flight = self.flight();
        let share = self.camera::<Trail>().map_or(0.0, Trail::share);
        let (plan, fields) = self.along(&tour);
        let scene = &mut self.setup.scene;
        self.reviewing = Some(Reviewing {
            steering: std::mem::replace(&mut scene.steering, Steering::Guide(PathSettings::NAME)),
            look: scene.look.replace(looks::review::LOOK),
            // It flies back over its own trail, and waits: a stop's time limit watches it.
            watch: scene.watch.take(),
            plan: std::mem::replace(&mut self.setup.plan, plan),
            fields: std::mem::replace(&mut self.setup.fields, fields),
            flight,
            share,
            tour,
            stops,
            later: Vec::new(),
            reached: 0,
            failed: 0,
            hung: None,
        });
        self.fly_tour()
    }

    /// Returns the plan of a tour, and its fields.
    fn along(&self, tour: &TourPlan) -> (Plan, Fields) {
        let here = self.pose().position;
        let end = tour.route.place(tour.route.length_mm());
        // It arrives after its last stop, which only the look knows.
        let ends = [here, end].map(|at| PlanEnd::new(at, -1.0));
        let gas = self.setup.plan.gas.clone();
        let plan = Plan {
            start: here,
            begin: here,
            ends,
            length_mm: tour.route.length_mm(),
            segment: None,
            gas,
            asked: FlightRequest::default(),
            notes: Vec::new(),
        };
        let planner = self.setup.scene.guides.get::<PathSettings>().planner;
        let fields = Fields::along(Arc::clone(&tour.route), &plan, planner);
        (plan, fields)
    }

    /// Sets out on the current tour.
    fn fly_tour(&mut self) -> Result<()> {
        if let Err(e) = self.build_scene() {
            self.end_review()?;
            return Err(e);
        }
        let length_mm = self.setup.plan.length_mm;
        if let Some(mut trail) = self.camera_mut::<Trail>() {
            trail.set_out(length_mm);
        }
        if let Some(mut flight) = self.camera_mut::<Flight>() {
            flight.state = State::Flying;
            flight.reason.clear();
        }
        Ok(())
    }

    /// Adds the current tour to the camera, for the look that follows it.
    pub(super) fn tour_component(&self) -> Option<Review> {
        let tour = |r: &Reviewing| Review {
            reached: r.reached,
            failed: r.failed,
            hung: r.hung,
            later: r.later.len(),
            ..Review::new(r.tour.stops.clone())
        };
        self.reviewing.as_ref().map(tour)
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
            let past = self.leads_past_the_hang(&walls, &rest)?;
            if past.iter().any(|p| !p) {
                let all = rest.into_iter().zip(past);
                let (behind, free): (Vec<_>, Vec<_>) = all.partition(|(_, past)| *past);
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

    /// Returns for each of `stops` whether the way there, from the last place with room, leads past the place where the camera hangs.
    fn leads_past_the_hang(&self, walls: &WallDistance, stops: &[ReviewStop]) -> Result<Vec<bool>> {
        let here = self.pose().position;
        let from = self.ways_back().first().and_then(|w| w.last()).copied().unwrap_or(here);
        let (Some(planned), Some(exact)) = (self.camera::<Planned>(), self.app.scan_get::<Walls>()) else {
            return Ok(vec![false; stops.len()]);
        };
        let s = planned.route.nearest_pass(&exact.0, here, planned.s_mm).unwrap_or(planned.s_mm);
        let ahead = planned.route.place(s + AHEAD_MM);
        let places: Vec<DVec3> = std::iter::once(from).chain(stops.iter().map(|s| DVec3::from_array(s.at))).collect();
        let legs = Legs::between(walls, &places, self.setup.scene.body.radius_mm, &self.progress)?;
        let past = |n: usize| legs.line(0, n).is_some_and(|l| l.points.iter().any(|p| p.distance(ahead) < PAST_MM));
        Ok((1..places.len()).into_par_iter().map(past).collect())
    }

    /// Ends a review, if there is one: guide, plan and state are as before it, and the camera is where it is.
    pub(super) fn end_review(&mut self) -> Result<()> {
        let Some(before) = self.reviewing.take() else { return Ok(()) };
        self.reached = self.stops_reached();
        self.hung = self.camera::<Review>().and_then(|r| r.hung);
        let Reviewing { steering, look, watch, plan, fields, flight, share, .. } = before;
        let scene = &mut self.setup.scene;
        (scene.steering, scene.look, scene.watch) = (steering, look, watch);
        (self.setup.plan, self.setup.fields) = (plan, fields);
        self.build_scene()?;
        let place = self.pose().position;
        if let Some(mut now) = self.camera_mut::<Flight>() {
            *now = Flight { length_mm: now.length_mm, place, ..flight };
        }
        let length_mm = self.setup.plan.length_mm;
        if let Some(mut trail) = self.camera_mut::<Trail>() {
            trail.set_out(length_mm);
            trail.jump(share);
        }
        Ok(())
    }

    /// Goes on with a review: plans the rest of a tour whose next stop was not reached, and ends one that is over.
    pub(super) fn go_on_with_review(&mut self) -> Result<()> {
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
    use super::*;
    use crate::Scene;
    use crate::components::camera::Pose;
    use crate::components::input::{FlightCommand, HandCommand};
    use crate::components::output::LogLine;
    use crate::fields::lumen;
    use crate::progress::Progress;
    use crate::space::{PreparedVolume, TransferFunction};
    use crate::testing::Room;
    use crate::volume::{Grid, Volume};
    use glam::DMat3;

    /// A planned flight along y through a room of 40 × 120 × 30 mm, an operator at hand.
    fn flight(guide: &'static str) -> FlightApp {
        let volume = Room::new([40, 120, 30]).scan();
        let [start, goal] = [15.0, 105.0].map(|y| DVec3::new(20.0, y, 15.0));
        let gas = lumen::gas_at(volume.voxels(), start, &Progress::new()).unwrap().unwrap();
        let scene = Scene { operator: true, log: true, ..Scene::guided_by(guide) };
        FlightApp::new(volume, Arc::new(gas), Plan::between(start, goal, 90.0), scene).unwrap()
    }

    fn stop(y: f64, x: f64) -> ReviewStop {
        ReviewStop::new(DVec3::new(20.0, y, 15.0), Some(DVec3::new(x, y, 15.0)))
    }

    /// Flies until the review is over; returns the directions of the views nearest to each stop.
    fn toured(flight: &mut FlightApp, stops: &[ReviewStop]) -> Vec<DVec3> {
        let mut best = vec![(f64::INFINITY, DVec3::ZERO); stops.len()];
        for _ in 0..8000 {
            if flight.tour().is_none() {
                break;
            }
            let Pose { position, attitude } = flight.pose();
            for (stop, best) in stops.iter().zip(&mut best) {
                let to = DVec3::from_array(stop.look_at.unwrap_or(stop.at)) - position;
                let off = attitude.forward.angle_between(to);
                if position.distance(DVec3::from_array(stop.at)) < 4.0 && off < best.0 {
                    *best = (off, attitude.forward);
                }
            }
            flight.step().unwrap();
        }
        best.into_iter().map(|b| b.1).collect()
    }

    #[test]
    fn a_tour_looks_at_each_stop_and_the_flight_is_then_as_before() {
        for guide in ["path", "tentacles"] {
            let mut flight = flight(guide);
            flight.fly(2.0).unwrap();
            let stops = [stop(30.0, 38.0), stop(100.0, 2.0), stop(60.0, 38.0)];
            flight.act(FlightCommand::Review(stops.to_vec())).unwrap();
            let tour = flight.tour().unwrap();
            assert!(tour.order.left_out.is_empty() && tour.stops.len() == 3);
            assert!(tour.order.length_mm <= tour::best_of_random(&tour.distances, 50, 1) + 1e-9);
            let looks = toured(&mut flight, &stops);
            assert!(looks[0].x > 0.9 && looks[1].x < -0.9 && looks[2].x > 0.9, "{looks:?}");
            assert!(flight.tour().is_none() && flight.stops_reached() == 3);
            assert_eq!((flight.flight().state, flight.setup().scene.guide_name()), (State::Flying, guide));
            assert!(flight.setup().plan.goal().at.y > 100.0 && flight.setup().scene.look.is_none());
            assert!(flight.take_log().iter().all(|l| l.clearance_mm >= 1.5));
        }
    }

    /// The room of [`flight`], from which a neck leads to a chamber. Voxel by voxel it is 3 mm wide, so a way is planned through it, but
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

    #[test]
    fn it_is_paused_and_cut_short_and_gives_way_to_other_commands() {
        let mut f = flight("path");
        let stops = vec![stop(100.0, 2.0), stop(30.0, 38.0)];
        f.act(FlightCommand::Review(stops.clone())).unwrap();
        f.fly(1.0).unwrap();
        f.act(HandCommand::Pause(true)).unwrap();
        f.fly(1.5).unwrap();
        let here = f.pose().position;
        f.fly(1.0).unwrap();
        assert!(f.pose().position.distance(here) < 1e-3 && f.tour().is_some());
        f.act(HandCommand::Pause(false)).unwrap();
        // It may have to turn to a stop first.
        f.fly(4.0).unwrap();
        assert!(f.pose().position.distance(here) > 2.0);
        f.act(FlightCommand::EndReview).unwrap();
        assert!(f.tour().is_none() && f.flight().state == State::Flying);
        f.act(FlightCommand::EndReview).unwrap();
        f.act(FlightCommand::Review(stops.clone())).unwrap();
        f.act(FlightCommand::Reverse).unwrap();
        assert!(f.tour().is_none() && f.setup().plan.goal().at.y < 20.0, "back along its own path");
        // Nothing to visit, and nothing that can be reached: the flight stays as it is.
        let outside = ReviewStop::new(DVec3::splat(900.0), None);
        for none in [vec![], vec![outside]] {
            assert!(f.act(FlightCommand::Review(none)).is_err() && f.tour().is_none());
        }
        f.act(FlightCommand::Review(vec![outside, stops[0]])).unwrap();
        assert_eq!(f.tour().unwrap().order.left_out, [0]);
    }

    #[test]
    fn a_recorded_review_is_repeated() {
        let fly = |flight: &mut FlightApp, steps: u32| {
            (0..steps).for_each(|_| flight.step().unwrap());
            (flight.pose(), flight.take_log().into_iter().map(|l| l.position).collect::<Vec<_>>())
        };
        let mut first = flight("tentacles");
        first.commands.start();
        let begun = fly(&mut first, 200);
        first.act(FlightCommand::Review(vec![stop(30.0, 38.0)])).unwrap();
        let ended = fly(&mut first, 700);
        let record: Vec<_> = first
            .commands
            .recorded()
            .iter()
            .map(|c| serde_json::from_str(&serde_json::to_string(c).unwrap()).unwrap())
            .collect();
        let mut again = flight("tentacles");
        again.commands.replay(record);
        assert!(fly(&mut again, 200) == begun && fly(&mut again, 700) == ended);
    }
}
