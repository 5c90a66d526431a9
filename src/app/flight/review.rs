//! Reviews: the shortest tour past what a flight has missed, as a planned flight of its own.

use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;

use super::FlightApp;
use crate::app::fields::Fields;
use crate::app::plan::{Plan, PlanEnd};
use crate::app::scene::Steering;
use crate::components::flight::{Flight, State};
use crate::components::review::{Review, ReviewStop, TourStop};
use crate::components::trail::Trail;
use crate::coverage::tour::{self, Distances, Order};
use crate::dynamics::Route;
use crate::dynamics::monitor::MonitorSettings;
use crate::dynamics::route::profile::PathSettings;
use crate::error::{Error, Result};
use crate::fields::centerline::legs::Legs;
use crate::fields::{Through, WallDistance};
use crate::schedule::{Guide, Look};
use crate::systems::looks;

/// Time that a leg may take: this many times what it takes at cruise speed, and these seconds for the stop.
const SLOWER: f64 = 6.0;
const STOP_S: f64 = 25.0;

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
    /// Time for planning, s: by the wall clock, the distances to the wall included.
    pub planned_s: f64,
}

/// A review that is under way, with what it has replaced.
pub(super) struct Reviewing {
    tour: TourPlan,
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
        let setup = &self.setup;
        let volume = setup.volume.voxels();
        let gas = setup.plan.gas.as_deref().unwrap_or(&setup.lumen);
        let built = match &self.reviewing {
            Some(before) => before.fields.walls(),
            None => setup.fields.walls(),
        };
        let walls = match built {
            Some(walls) => Arc::clone(walls),
            None => Arc::new(WallDistance::of_lumen(volume, gas, Through::Gas, &self.progress)?),
        };
        let mut places = vec![self.pose().position];
        places.extend(stops.iter().map(|s| DVec3::from_array(s.at)));
        let legs = Legs::between(&walls, &places, setup.scene.body.radius_mm, &self.progress)?;
        let distances = Distances::new(places.len(), |a, b| legs.mm(a, b));
        let order = tour::shortest(&distances);
        let path = setup.scene.guides.get::<PathSettings>();
        let (mut line, mut clearance, mut length) = (Vec::new(), Vec::new(), 0.0);
        let (mut toured, mut at) = (Vec::new(), 0);
        for &n in &order.stops {
            let Some(leg) = legs.line(at, n + 1) else { continue };
            let skip = usize::from(!line.is_empty());
            line.extend(leg.points.iter().skip(skip));
            clearance.extend(leg.radius_mm.iter().skip(skip));
            length += leg.length_mm;
            let limit_s = STOP_S + SLOWER * leg.length_mm / path.cruise_mm_s;
            toured.push(TourStop { s_mm: length, look_at: stops[n].look_at.map(DVec3::from_array), limit_s });
            at = n + 1;
        }
        let route = Route::along(&line, &clearance, DVec3::NEG_Y).filter(|_| !toured.is_empty()).ok_or_else(|| {
            Error::incomplete("review", "no way leads from the camera to what was missed", "review by hand")
        })?;
        let planned_s = begun.elapsed().as_secs_f64();
        Ok(TourPlan { order, distances, route: Arc::new(route), stops: toured, planned_s })
    }

    /// Returns the tour that is being flown; `None` if there is none.
    pub fn tour(&self) -> Option<&TourPlan> {
        self.reviewing.as_ref().map(|r| &r.tour)
    }

    /// Returns how many stops the review has reached that is being flown, or else the last one.
    pub fn stops_reached(&self) -> usize {
        self.camera::<Review>().map_or(self.reached, |r| r.reached)
    }

    /// Sets out on the tour past `stops`.
    pub(super) fn review(&mut self, stops: &[ReviewStop]) -> Result<()> {
        if !self.setup.scene.moves() {
            let why = "nothing in the scene moves the camera";
            return Err(Error::incomplete("review", why, "choose a scene with a guide"));
        }
        let tour = self.plan_tour(stops)?;
        self.end_review()?;
        let flight = self.flight();
        let share = self.camera::<Trail>().map_or(0.0, Trail::share);
        let here = self.pose().position;
        let end = tour.route.place(tour.route.length_mm());
        // It arrives after its last stop, which only the look knows.
        let ends = [here, end].map(|at| PlanEnd::new(at, -1.0));
        let gas = self.setup.plan.gas.clone();
        let plan =
            Plan { start: here, begin: here, ends, length_mm: tour.route.length_mm(), segment: None, gas, notes: Vec::new() };
        let planner = self.setup.scene.guides.get::<PathSettings>().planner;
        let fields = Fields::along(Arc::clone(&tour.route), &plan, planner);
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
        });
        if let Err(e) = self.setup.build_fields(&self.progress).and_then(|()| self.rebuild()) {
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

    /// Adds the tour that is under way to the camera, for the look that follows it.
    pub(super) fn tour_component(&self) -> Option<Review> {
        self.reviewing.as_ref().map(|r| Review::new(r.tour.stops.clone()))
    }

    /// Ends a review, if there is one: guide, plan and state are as before it, and the camera is where it is.
    pub(super) fn end_review(&mut self) -> Result<()> {
        let Some(before) = self.reviewing.take() else { return Ok(()) };
        self.reached = self.stops_reached();
        let Reviewing { steering, look, watch, plan, fields, flight, share, .. } = before;
        let scene = &mut self.setup.scene;
        (scene.steering, scene.look, scene.watch) = (steering, look, watch);
        (self.setup.plan, self.setup.fields) = (plan, fields);
        self.setup.build_fields(&self.progress)?;
        self.rebuild()?;
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

    /// Ends a review whose tour is over.
    pub(super) fn end_finished_review(&mut self) -> Result<()> {
        if self.reviewing.is_some() && self.flight().state == State::Arrived { self.end_review() } else { Ok(()) }
    }
}
