//! The rounds of a review: a tour past what the flight has missed, and others past smaller patches as long as they show enough.

use glam::DVec3;

use super::{Covered, FlightApp};
use crate::components::input::FlightCommand;
use crate::components::review::ReviewStop;
use crate::components::trail::Trail;
use crate::coverage::tour;
use crate::error::Result;

/// Minimum area of a patch that each round visits, mm². Later rounds are flown only while less than [`ENOUGH`] of the wall was seen
/// and the previous round has gained enough.
const ROUNDS: [f64; 3] = [300.0, 100.0, 40.0];
/// Share of the wall from which no more rounds are flown.
const ENOUGH: f64 = 0.975;
/// Minimum gain of a round, as a share of the wall, for another one to follow.
const LEAST_GAIN: f64 = 0.002;
/// Number of random orders that a tour is compared with.
const RANDOM: u64 = 1000;

/// A flight's review, round by round.
///
/// ```
/// # use colvis_app as colvis;
/// use colvis::app::{FlightRequest, ReviewRounds, Scan, Scene};
///
/// let mut flight = Scan::phantom(1)?.flight(Scene::guided_by("path"), &FlightRequest::default())?;
/// flight.fly(20.0)?;
/// let covered = flight.survey().coverage(90.0, false)?.expect("gas was flown through");
/// let before = covered.coverage.one_way;
/// let mut rounds = ReviewRounds::new(&flight, covered, 90.0);
/// if rounds.set_out(&mut flight)? {
///     flight.fly(30.0)?; // or until `flight.tour()` is `None`
///     rounds.end_tour(&mut flight)?;
/// }
/// assert!(rounds.covered.coverage.one_way > before);
/// # Ok::<(), colvis::error::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct ReviewRounds {
    /// The coverage after the last completed tour.
    pub covered: Covered,
    /// The tours. The last one may still be in progress.
    pub tours: Vec<TourFlown>,
    fov_degrees: f64,
    /// Number of views before the review, and of those whose coverage is known.
    flown: usize,
    counted: usize,
    /// Areas of the rounds to come, mm².
    left: &'static [f64],
    /// Stops that the next round visits in addition.
    also: Vec<ReviewStop>,
}

/// A tour of a review.
#[derive(Clone, Copy, Debug, Default)]
pub struct TourFlown {
    /// Number of its stops.
    pub stops: usize,
    /// Number of those that were looked at or passed.
    pub reached: usize,
    /// Number of places that cannot be reached.
    pub left_out: usize,
    /// Length as flown, mm.
    pub length_mm: f64,
    /// Time, simulated s.
    pub seconds: f64,
    /// Length of its order over the lumen's cells, mm, …
    pub order_mm: f64,
    /// … and of the best of 1,000 random orders.
    pub random_mm: f64,
    /// Time for planning it, s, …
    pub planned_s: f64,
    /// … and before it for the distances to the wall.
    pub distance_s: f64,
    /// Share of the wall that it has shown for the first time.
    pub gain: f64,
    /// True if it was flown to its end.
    pub is_complete: bool,
}

impl TourFlown {
    /// Returns the number of stops that were not reached, or not looked at.
    pub fn not_reached(&self) -> usize {
        self.stops.saturating_sub(self.reached)
    }
}

impl ReviewRounds {
    /// Begins after a flight that has seen `covered`, in square pictures with a view angle of `fov_degrees`.
    pub fn new(flight: &FlightApp, covered: Covered, fov_degrees: f64) -> Self {
        let flown = views(flight);
        Self { covered, tours: Vec::new(), fov_degrees, flown, counted: flown, left: &ROUNDS, also: Vec::new() }
    }

    /// Visits other places (world mm), too, on the next tour, such as those of candidates that a reader is unsure of. Returns the
    /// number of those that cannot be looked at: see [`Survey::stops_to_see`](super::Survey::stops_to_see).
    ///
    /// # Errors
    /// Returns status 4 if interrupted.
    pub fn visit(&mut self, flight: &FlightApp, places: &[DVec3]) -> Result<usize> {
        let stops = flight.survey().stops_to_see(&self.covered, places)?;
        let before = self.also.len();
        self.also.extend(stops.into_iter().flatten());
        Ok(places.len() - (self.also.len() - before))
    }

    /// Starts the next tour. Returns false if none is due.
    ///
    /// # Errors
    /// Returns status 4 if no way leads to any stop, or if interrupted.
    pub fn set_out(&mut self, flight: &mut FlightApp) -> Result<bool> {
        let gains = match &self.tours[..] {
            [] => true,
            [.., last] => last.gain >= LEAST_GAIN && self.covered.coverage.one_way < ENOUGH,
        };
        if !gains {
            return Ok(false);
        }
        let mut stops = std::mem::take(&mut self.also);
        let visits = stops.len();
        while let Some((least_mm2, later)) = self.left.split_first().filter(|_| stops.len() == visits) {
            self.left = later;
            stops.extend(flight.survey().review_stops(&self.covered, self.fov_degrees, self.flown, *least_mm2)?);
        }
        if stops.is_empty() {
            return Ok(false);
        }
        flight.act(FlightCommand::Review(stops))?;
        let Some(plan) = flight.tour() else { return Ok(false) };
        self.tours.push(TourFlown {
            stops: plan.stops.len(),
            left_out: plan.order.left_out.len(),
            order_mm: plan.order.length_mm,
            random_mm: tour::best_of_random(&plan.distances, RANDOM, 1),
            planned_s: plan.planned_s,
            distance_s: plan.distance_s,
            // Until it ends: where it began.
            length_mm: flight.flight().length_mm,
            seconds: flight.clock().seconds(),
            ..TourFlown::default()
        });
        Ok(true)
    }

    /// Ends the current tour, if it has not ended, and evaluates what it has shown.
    ///
    /// # Errors
    /// Returns the errors of [`FlightApp::act`].
    pub fn end_tour(&mut self, flight: &mut FlightApp) -> Result<()> {
        let is_complete = flight.tour().is_none();
        flight.act(FlightCommand::EndReview)?;
        let Some(tour) = self.tours.last_mut() else { return Ok(()) };
        // Seldom does another tour follow. What is seen is computed in the memory of the distances, which that tour would build again.
        flight.forget_walls_to_tour();
        let before = self.covered.coverage.one_way;
        flight.survey().cover_more(&mut self.covered, self.fov_degrees, self.counted)?;
        self.counted = views(flight);
        tour.reached = flight.stops_reached();
        tour.length_mm = flight.flight().length_mm - tour.length_mm;
        tour.seconds = flight.clock().seconds() - tour.seconds;
        tour.gain = self.covered.coverage.one_way - before;
        tour.is_complete = is_complete;
        Ok(())
    }
}

fn views(flight: &FlightApp) -> usize {
    flight.survey().trail().map_or(0, |t: &Trail| t.views().len())
}
