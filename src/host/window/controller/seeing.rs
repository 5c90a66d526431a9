//! What of the wall was seen in a flight: painted, listed, and gone to.

use std::time::Instant;

use super::FlightController;
use super::pointing::go_to;
use crate::components::camera::Pose;
use crate::coverage::LiveCoverage;
use crate::dynamics::Attitude;
use crate::host::window::seen::{News, Seen};

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
        self.seen.list_missed(false, &self.flight, &self.wake, now);
        self.attention = true;
    }

    /// Goes to the next patch that was missed; lists them first if that was not done, or if none is left of the list.
    pub(crate) fn next_missed(&mut self, now: Instant) {
        let Some(coverage) = self.flight.camera::<LiveCoverage>() else { return };
        match self.seen.next_missed(coverage) {
            Some(n) => self.visit_missed(n, now),
            None => {
                self.seen.list_missed(true, &self.flight, &self.wake, now);
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
            Ok(Some(News::Listed(goes_on))) => {
                self.attention = true;
                let next = self.flight.camera::<LiveCoverage>().and_then(|c| self.seen.next_missed(c));
                match next.filter(|_| goes_on) {
                    Some(n) => self.visit_missed(n, now),
                    None if goes_on => self.say("nothing larger than 3 cm² was missed", now),
                    None => {}
                }
            }
            Err(e) => self.say(e.to_string(), now),
        }
    }
}
