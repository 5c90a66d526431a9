//! The coverage of a flight, and the review of the missed patches.

use std::path::PathBuf;
use std::time::Instant;

use glam::DVec3;
use serde_json::{Map, Value, json};

use super::flight_stats;
#[cfg(feature = "window")]
use crate::app::Setup;
use crate::app::{FlightApp, ReviewRounds, Survey, TourFlown};
use crate::cli::args::{FlyArgs, Global};
use crate::cli::messages::say;
use crate::cli::prepare;
use crate::components::flight::State;
use crate::components::trail::Trail;
use crate::coverage::LiveCoverage;
use crate::error::Result;
use crate::memory;
use crate::output;
use crate::polyps::answers::{Answer, Answers};
use crate::progress::Progress;
use crate::render::CameraModel;

/// The benefit of looking back is reported if it shows at least this additional share of the wall.
const BACK_TOLD: f64 = 0.005;
/// Maximum duration of a tour, simulated seconds.
const TOUR_SECONDS: f64 = 3600.0;

/// The requested coverage.
#[derive(Clone, Debug, Default)]
pub(super) struct Covering {
    /// View angle, degrees.
    pub fov_degrees: f64,
    /// File for the wall with the coverage of each face.
    pub mesh: Option<PathBuf>,
    /// True if missed patches are visited.
    pub review: bool,
    /// Places of candidates that the review visits, too, world mm.
    pub unsure: Vec<DVec3>,
}

/// The coverage so far, and the state of the review.
pub(super) struct Seen {
    stats: Stats,
    /// `None` if no gas was flown through.
    rounds: Option<ReviewRounds>,
    is_over: bool,
}

/// Parts of the stats.
pub(super) struct Stats {
    /// The outcome of the flight, without its review.
    pub flight: Map<String, Value>,
    /// The coverage of the wall.
    pub wall: Map<String, Value>,
    /// Time for computing the coverage after the flight, without its review, s.
    pub covered_s: f64,
    /// Time for planning the tours of a review, s, and before it for the distances to the wall.
    pub took: Option<[f64; 2]>,
}

impl Covering {
    /// Fails with status 2 for an invalid view angle.
    pub(super) fn asked(args: &FlyArgs, global: &Global, camera: CameraModel) -> Result<Option<Self>> {
        if !args.coverage && args.coverage_mesh.is_none() && !args.review {
            return Ok(None);
        }
        let fov_degrees = prepare::fov(global, camera)?;
        let unsure = match &args.answers {
            Some(path) => Answers::read(path)?.answers,
            None => Vec::new(),
        };
        let unsure = unsure.iter().filter(|a| a.answer == Some(Answer::Unsure)).map(|a| a.position).collect();
        Ok(Some(Self { fov_degrees, mesh: args.coverage_mesh.clone(), review: args.review, unsure }))
    }

    /// Returns the stats of a flight in a window, where the operator decides on a review.
    ///
    /// They describe the flight and the scan that it flew through. They do not depend on another scan that the window shows, on
    /// views beside the flight or of an earlier session, or on when the window was closed.
    #[cfg(any(feature = "window", test))]
    pub(super) fn flown(&self, flight: &FlightApp) -> Result<Stats> {
        let Setup { volume, lumen, plan, scene, .. } = flight.setup();
        // The window is closed: nothing is left that interrupts.
        let progress = &Progress::new();
        let gas = plan.gas.as_ref().unwrap_or(lumen);
        let mut live = match flight.camera::<LiveCoverage>() {
            None => return self.first(flight, flight.survey(), None, progress).map(|seen| seen.stats),
            Some(watched) if watched.is_of(gas) => watched.afresh(),
            Some(_) => LiveCoverage::of(volume, gas, progress)?,
        };
        live.set_camera(scene.image.camera, scene.image.fov_degrees);
        let survey = flight.survey().as_flown(&live);
        self.first(flight, survey, Some(&live), progress).map(|seen| seen.stats)
    }

    /// Evaluates the coverage when the flight or a tour has ended, and starts the next tour. Returns its time limit, s; `None` if
    /// the review is over.
    pub(super) fn onward(
        &self,
        flight: &mut FlightApp,
        seen: &mut Option<Seen>,
        progress: &Progress,
    ) -> Result<Option<f64>> {
        let Some(seen) = seen else {
            // What the flight has freed is as large as the wall.
            memory::release();
            let first = self.first(flight, flight.survey(), flight.camera::<LiveCoverage>(), progress)?;
            let seen = seen.insert(first);
            if seen.is_over {
                return Ok(None);
            }
            // A review has no use for it.
            flight.unwatch_coverage();
            return set_out(flight, seen);
        };
        if seen.is_over {
            return Ok(None);
        }
        end_tour(flight, seen)?;
        set_out(flight, seen)
    }

    /// Evaluates what the flight has seen, continuing from its live coverage.
    fn first(
        &self,
        flight: &FlightApp,
        survey: Survey<'_>,
        live: Option<&LiveCoverage>,
        progress: &Progress,
    ) -> Result<Seen> {
        let begun = Instant::now();
        let covered = survey.coverage(self.fov_degrees, self.mesh.is_some())?;
        let mut wall = Map::new();
        let both = covered.as_ref().map(|c| c.coverage);
        wall.insert("coverage".to_owned(), json!(both.map(|c| c.one_way)));
        wall.insert("coverage_both_ways".to_owned(), json!(both.map(|c| c.both_ways)));
        if let Some(live) = live {
            // Include the last views, which are still queued. The flight's own coverage stays as it is.
            let mut live = live.clone();
            let views = survey.trail().map_or(&[][..], Trail::views);
            live.catch_up(&flight.setup().volume, views, flight.clock().seconds(), progress)?;
            wall.insert("coverage_live".to_owned(), json!(live.share()));
        }
        wall.insert("wall_mm2".to_owned(), json!(covered.as_ref().map_or(0.0, |c| c.wall.mm2())));
        let missed = covered.as_ref().map_or_else(|| Ok(Vec::new()), |c| survey.missed(c))?;
        wall.insert("missed".to_owned(), json!(missed));
        let covered_s = begun.elapsed().as_secs_f64();
        match (&self.mesh, &covered) {
            (Some(path), Some(c)) => c.wall.save(path, &c.sights, progress)?,
            (Some(path), None) => say(&format!("{} was not written: nothing was flown", path.display())),
            (None, _) => {}
        }
        let back = both.map_or(0.0, |c| c.both_ways - c.one_way);
        if self.review {
            let better = if back >= BACK_TOLD { "back" } else { "either" };
            wall.insert("better_direction".to_owned(), json!(better));
            if back >= BACK_TOLD {
                let percent = 100.0 * back;
                output::to_stderr(format_args!("flying back would show another {percent:.1} % of the wall"));
            }
        }
        let is_over = !self.review || covered.is_none() || flight.flight().state == State::Operator;
        let stats = Stats { flight: flight_stats(flight), wall, covered_s, took: self.review.then_some([0.0; 2]) };
        let mut rounds = covered.map(|c| ReviewRounds::new(flight, c, self.fov_degrees));
        if let Some(rounds) = rounds.as_mut().filter(|_| !is_over) {
            let hidden = rounds.visit(flight, &self.unsure)?;
            if hidden > 0 {
                let all = self.unsure.len();
                say(&format!(
                    "{hidden} of {all} unsure candidates are left out: not on the wall that was flown past, or not visible"
                ));
            }
        }
        Ok(Seen { stats, rounds, is_over })
    }

    /// Returns the parts of the stats, and prints the better direction of the next pass.
    pub(super) fn stats(&self, mut seen: Seen) -> Stats {
        let Some(ReviewRounds { covered, tours, .. }) = seen.rounds.filter(|_| self.review) else { return seen.stats };
        let sum = |of: fn(&TourFlown) -> f64| tours.iter().map(of).sum::<f64>();
        let count = |of: fn(&TourFlown) -> usize| tours.iter().map(of).sum::<usize>();
        let list = |of: fn(&TourFlown) -> f64| json!(tours.iter().map(of).collect::<Vec<_>>());
        let m = &mut seen.stats.wall;
        m.insert("coverage_after_review".to_owned(), json!(covered.coverage.one_way));
        m.insert(
            "review".to_owned(),
            json!({
                "stops": count(|t| t.stops),
                "reached": count(|t| t.reached),
                "not_reached": count(TourFlown::not_reached),
                "left_out": count(|t| t.left_out),
                "unsure": self.unsure.len(),
                "tours": tours.len(),
                "length_mm": sum(|t| t.length_mm),
                "seconds": sum(|t| t.seconds),
                "gain": list(|t| t.gain),
                "order_mm": list(|t| t.order_mm),
                "order_best_of_1000_mm": list(|t| t.random_mm),
            }),
        );
        seen.stats.took = Some([sum(|t| t.planned_s), sum(|t| t.distance_s)]);
        seen.stats
    }
}

/// Starts the next tour, if one is due. Returns its time limit, s.
fn set_out(flight: &mut FlightApp, seen: &mut Seen) -> Result<Option<f64>> {
    seen.is_over = true;
    let Some(rounds) = &mut seen.rounds else { return Ok(None) };
    match rounds.set_out(flight) {
        Err(e) if e.what == "review" => {
            say(&e.to_string());
            return Ok(None);
        }
        due => {
            if !due? {
                return Ok(None);
            }
        }
    }
    seen.is_over = false;
    Ok(Some(TOUR_SECONDS))
}

/// Evaluates what a tour has shown.
fn end_tour(flight: &mut FlightApp, seen: &mut Seen) -> Result<()> {
    let Some(rounds) = &mut seen.rounds else { return Ok(()) };
    let reason = flight.flight().reason;
    rounds.end_tour(flight)?;
    let Some(tour) = rounds.tours.last() else { return Ok(()) };
    let ended = match tour.is_complete {
        true => String::new(),
        false if reason.is_empty() => ", cut short".to_owned(),
        false => format!(", cut short: {reason}"),
    };
    let missed = match tour.not_reached() {
        0 => String::new(),
        n => format!(", {n} not reached"),
    };
    let share = rounds.covered.coverage.one_way;
    output::to_stderr(format_args!(
        "review: {} of {} stops in {:.0} mm and {:.0} s{missed}; {:.1} % of the wall seen, {:.1} % before{ended}",
        tour.reached,
        tour.stops,
        tour.length_mm,
        tour.seconds,
        100.0 * share,
        100.0 * (share - tour.gain)
    ));
    Ok(())
}
