//! What of the wall was seen in a flight: painted, listed, and gone to.

use std::time::Instant;

use super::FlightController;
use super::pointing::go_to;
use crate::components::camera::Pose;
use crate::components::input::{FlightCommand, HandCommand};
use crate::coverage::LiveCoverage;
use crate::dynamics::Attitude;
use crate::dynamics::route::profile::PathSettings;
use crate::host::window::seen::{News, Seen, Then};

/// About how long a review stays at a place, s.
const STOP_S: f64 = 2.0;

impl FlightController {
    /// Returns what of the wall was seen.
    pub(crate) fn seen(&self) -> &Seen {
        &self.seen
    }

    /// Shows or hides the paint over what was not seen yet.
    pub(crate) fn show_seen(&mut self, shown: bool, now: Instant) {
        let done = self.seen.show(shown, &mut self.flight, &self.wake, now);
        let is_known = self.flight.camera::<LiveCoverage>().is_some();
        let told = match (done, shown, is_known) {
            (Err(e), ..) => e.to_string(),
            (_, false, _) => "what was not seen: hidden".to_owned(),
            (_, true, false) => "looking at what was seen ...".to_owned(),
            (_, true, true) => self.coverage_text(),
        };
        self.say(told, now);
        self.paint_anew();
    }

    fn coverage_text(&self) -> String {
        let share = self.flight.camera::<LiveCoverage>().map_or(0.0, LiveCoverage::share);
        format!("{:.0} % of the wall seen; the rest is painted", 100.0 * share)
    }

    fn paint_anew(&mut self) {
        self.flight.mark_picture();
        self.quiet = 0;
        self.attention = true;
    }

    /// Checks whether there is a next missed patch to go to, or whether it can be found out.
    pub(crate) fn may_see_missed(&self) -> Result<(), &'static str> {
        match self.flight.camera::<LiveCoverage>() {
            Some(_) => Ok(()),
            None => Err("what was seen is not watched (Ctrl+E begins)"),
        }
    }

    /// Lists the missed patches anew.
    pub(crate) fn list_missed(&mut self, now: Instant) {
        self.seen.list_missed(Then::Nothing, &self.flight, &self.wake, now);
        self.attention = true;
    }

    /// Goes to the next patch that was missed; lists them first if that was not done, or if none is left of the list.
    pub(crate) fn next_missed(&mut self, now: Instant) {
        let Some(coverage) = self.flight.camera::<LiveCoverage>() else { return };
        match self.seen.next_missed(coverage) {
            Some(n) => self.visit_missed(n, now),
            None => {
                self.seen.list_missed(Then::Next, &self.flight, &self.wake, now);
                self.say("listing what was missed ...", now);
            }
        }
    }

    /// Goes to a patch of the list and looks at it.
    pub(crate) fn visit_missed(&mut self, n: usize, now: Instant) {
        let Some(patch) = self.seen.choose(n).cloned() else { return };
        let all = self.seen.list().map_or(0, <[_]>::len);
        self.stop(now);
        self.travel = None;
        let mut told = format!("missed patch {} of {all}: {:.1} cm²", n + 1, patch.area_mm2 / 100.0);
        let went = patch.look_from.is_some_and(|from| {
            let attitude = Attitude::new(from.forward, from.up);
            self.flight.act(go_to(Pose { position: from.position, attitude })).is_ok()
        });
        if !went {
            told.push_str(", and no place to see it from");
        }
        self.say(told, now);
        self.slices.point(&self.flight, patch.position);
        self.figures.touch();
        self.quiet = 0;
    }

    /// Flies past all patches that were missed, or ends that tour.
    pub(crate) fn switch_review(&mut self, now: Instant) {
        if self.flight.tour().is_some() {
            if self.act(FlightCommand::EndReview, now) {
                self.say("review ended", now);
            }
        } else if self.seen.next().is_none() {
            self.stop(now);
            self.seen.list_missed(Then::Review, &self.flight, &self.wake, now);
            self.say("planning the review ...", now);
        }
    }

    /// Sets out on a tour past the patches of the list.
    fn begin_review(&mut self, now: Instant) {
        if !self.seen.prepare_tour(&self.flight, &self.wake, now) {
            return;
        }
        let Some(coverage) = self.flight.camera::<LiveCoverage>() else { return };
        let stops = self.seen.stops(coverage);
        if stops.is_empty() {
            return self.say("nothing of what was missed can be looked at", now);
        }
        if self.act(FlightCommand::Review(stops), now) {
            if self.hand().paused {
                self.slices.follow();
                self.act(HandCommand::Pause(false), now);
            }
            let tour = self.flight.tour();
            let (count, mm) = tour.map_or((0, 0.0), |t| (t.stops.len(), t.route.length_mm()));
            let path = self.flight.setup().scene.guides.get::<PathSettings>();
            let minutes = (mm / path.cruise_mm_s + STOP_S * count as f64) / 60.0;
            self.say(format!("review: {count} places in {mm:.0} mm, about {minutes:.0} min; Ctrl+V ends it"), now);
        }
    }

    /// Takes what has come out of the background.
    pub(super) fn take_seen(&mut self, now: Instant) {
        match self.seen.take(&mut self.flight, now) {
            Ok(None) => {}
            Ok(Some(News::Begun)) => {
                let told = self.coverage_text();
                self.say(told, now);
                self.list_missed(now);
                self.paint_anew();
            }
            Ok(Some(News::Listed(then))) => {
                self.attention = true;
                let next = self.flight.camera::<LiveCoverage>().and_then(|c| self.seen.next_missed(c));
                match (then, next) {
                    (Then::Nothing, _) => {}
                    (_, None) => self.say("nothing larger than 3 cm² was missed", now),
                    (Then::Next, Some(n)) => self.visit_missed(n, now),
                    (Then::Review, Some(_)) => self.begin_review(now),
                }
            }
            Ok(Some(News::Prepared)) => self.begin_review(now),
            Err(e) => self.say(e.to_string(), now),
        }
    }
}
