//! Reviews: the shortest tour past what a flight has missed, as a planned flight of its own.

mod rest;

use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use rayon::prelude::*;

use super::FlightApp;
use crate::components::flight::{Flight, State};
use crate::components::review::{Review, ReviewStop, TourStop};
use crate::components::scan::Walls;
use crate::components::trail::Trail;
use crate::coverage::tour::{self, Distances, Order};
use crate::dynamics::Route;
use crate::dynamics::monitor::MonitorSettings;
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
        colvis_scan::memory::release();
        WallDistance::of_lumen(setup.volume.voxels(), gas, Through::Gas, &self.progress).map(Arc::new)
    }

    /// True if a tour can be planned without building the distances to the wall first.
    #[doc(hidden)]
    pub fn knows_walls_to_tour(&self) -> bool {
        let gas = self.setup.plan.gas.as_ref().unwrap_or(&self.setup.lumen);
        self.setup.fields.walls().is_some() || self.toured.as_ref().is_some_and(|(of, _)| Arc::ptr_eq(of, gas))
    }

    /// Frees the distances to the wall that were built for a tour.
    pub(super) fn forget_walls_to_tour(&mut self) {
        self.toured = None;
        colvis_scan::memory::release();
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scene;
    use crate::components::camera::Pose;
    use crate::components::input::{FlightCommand, HandCommand};
    use crate::fields::lumen;
    use crate::progress::Progress;
    use crate::testing::Room;

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
