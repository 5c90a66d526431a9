//! What of the wall was seen in a flight: painted, listed, and gone to.

use std::time::Instant;

use super::FlightController;
use super::pointing::go_to;
use crate::components::camera::Pose;
use crate::components::input::{FlightCommand, HandCommand};
use crate::components::review::ReviewStop;
use crate::coverage::LiveCoverage;
use crate::dynamics::Attitude;
use crate::dynamics::route::profile::PathSettings;
use crate::host::window::intent::WhyNot;
use crate::host::window::seen::{News, Then};

/// Nearer than this to where a patch is seen from, the camera only turns to it, mm.
const THERE_MM: f64 = 3.0;
/// About how long a review stays at a place, s.
const STOP_S: f64 = 2.0;

impl FlightController {
    /// Shows or hides the paint over what was not seen yet.
    pub(crate) fn show_seen(&mut self, shown: bool, now: Instant) {
        let other = self.cleansing.other();
        let done = self.seen.show(shown, &mut self.flight, other, &self.background, now);
        let is_known = self.flight.camera::<LiveCoverage>().is_some();
        let told = match (done, shown, is_known) {
            (Err(e), ..) => e.to_string(),
            (_, false, _) => "wall not seen: hidden".to_owned(),
            (_, true, false) => "computing coverage ...".to_owned(),
            (_, true, true) => self.coverage_text(),
        };
        self.say(told, now);
        self.paint_anew();
    }

    /// Goes on to the next of the ways in which an overlay is shown, or hides it.
    pub(super) fn switch_overlay(&mut self, n: usize, now: Instant) {
        match self.overlays.switch(n, &mut self.flight) {
            Ok(told) => told.into_iter().for_each(|text| self.say(text, now)),
            Err(e) => self.say(e.to_string(), now),
        }
        self.quiet = 0;
        self.attention = true;
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
    pub(crate) fn may_see_missed(&self) -> Result<(), WhyNot> {
        match self.flight.camera::<LiveCoverage>() {
            Some(_) => Ok(()),
            None => Err(format!("coverage is off{}", self.actions.hint("unseen", "begins")).into()),
        }
    }

    /// Lists the missed patches anew.
    pub(crate) fn list_missed(&mut self, now: Instant) {
        self.seen.list_missed(Then::Nothing, &self.flight, &self.background, now);
        self.attention = true;
    }

    /// Flies to the next patch that was missed and looks at it; lists them first if that was not done, or if none is left of the list.
    pub(crate) fn next_missed(&mut self, now: Instant) {
        let Some(coverage) = self.flight.camera::<LiveCoverage>() else { return };
        match self.seen.next_missed(coverage, self.flight.pose().position) {
            Some(n) => self.fly_to_missed(n, now),
            None if self.seen.next().is_none() => {
                self.seen.list_missed(Then::Next, &self.flight, &self.background, now);
                self.say("listing the missed patches ...", now);
            }
            None => {}
        }
    }

    /// Flies to a patch of the list and waits there, or goes there at once where nothing flies or no way leads.
    fn fly_to_missed(&mut self, n: usize, now: Instant) {
        let Some(from) = self.seen.list().and_then(|list| list.get(n)?.look_from) else { return };
        let is_there = from.position.distance(self.flight.pose().position) < THERE_MM;
        if is_there || !self.flight.setup().scene.moves() || self.flight.setup().scene.play().is_some() {
            return self.visit_missed(n, now);
        }
        if !self.seen.prepare_tour(Then::Next, &self.flight, &self.background, now) {
            return self.say("preparing the path ...", now);
        }
        let Some(patch) = self.seen.choose(n) else { return };
        let (place, area_mm2) = (patch.position, patch.area_mm2);
        let stop = ReviewStop::new(from.position, Some(place));
        if self.flight.act(FlightCommand::Review(vec![stop])).is_err() {
            return self.visit_missed(n, now);
        }
        (self.seen.goes_to, self.seen.goes_on) = (Some(place), false);
        self.set_off(now);
        let all = self.seen.list().map_or(0, <[_]>::len);
        let mm = self.flight.tour().map_or(0.0, |t| t.route.length_mm());
        self.say(format!("to missed patch {} of {all}: {:.1} cm², {mm:.0} mm away", n + 1, area_mm2 / 100.0), now);
    }

    /// Lets a tour begin that was planned while the flight may have waited.
    fn set_off(&mut self, now: Instant) {
        self.travel = None;
        self.slices.follow();
        self.quiet = 0;
        if self.hand().paused {
            self.act(HandCommand::Pause(false), now);
        }
    }

    /// Waits where the patch is seen to which the camera was sent.
    fn wait_at_missed(&mut self, now: Instant) {
        if self.flight.tour().is_none()
            && let Some(place) = self.seen.goes_to.take()
        {
            if self.flight.stops_reached() > 0 {
                self.stop(now);
                self.slices.aim(&self.flight, place, 0.0);
            } else if self.flight.hangs() {
                self.stop(now);
                self.say("the camera does not get to the missed patch; its place in the list goes there at once", now);
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
        self.slices.aim(&self.flight, patch.position, 0.0);
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
            self.seen.reviewed.clear();
            self.seen.list_missed(Then::Review, &self.flight, &self.background, now);
            self.say("planning the review ...", now);
        }
    }

    /// Returns the stops of a review: the patches of the list, and the candidates that the reader is unsure of, both in the segment
    /// that is flown.
    fn review_stops(&self) -> Vec<ReviewStop> {
        let mut stops = self.seen.stops(&self.flight).0;
        stops.extend(self.unsure_stops());
        stops
    }

    /// Returns what is told if nothing can be reviewed in the segment that is flown.
    fn nothing_to_review(&self) -> String {
        match self.seen.stops(&self.flight).1 {
            0 if self.seen.list().is_none_or(<[_]>::is_empty) => "nothing larger than 3 cm² was missed".to_owned(),
            0 => "no missed patch is visible from the lumen".to_owned(),
            1 => "1 place is left, in a segment that cannot be flown".to_owned(),
            left => format!("{left} places are left, in segments that cannot be flown"),
        }
    }

    /// Goes on with the review in the next segment that has places to look at and was not reviewed; tells it if there is none.
    fn review_next_segment(&mut self, now: Instant) {
        let mut left = self.seen.segments_left(&self.flight);
        left.extend(self.unsure_segments());
        // Outside the segments, one body of gas is flown, and all of it was reviewed.
        let here = self.flight.setup().plan.segment;
        left.retain(|n| !self.seen.reviewed.contains(n) && here.is_some_and(|here| here != *n));
        // Onwards from here, then from the first.
        let Some(next) = left.iter().find(|n| here.is_none_or(|here| **n > here)).or(left.first()).copied() else {
            let told = if self.seen.reviewed.is_empty() { self.nothing_to_review() } else { "review over".to_owned() };
            return self.say(told, now);
        };
        self.seen.reviewed.insert(next);
        if self.act(FlightCommand::Segment(next), now) {
            self.begin_review(now);
        }
    }

    /// Goes on once a review has come to its end by itself.
    fn go_on_with_review(&mut self, now: Instant) {
        if self.seen.goes_on && self.flight.tour().is_none() {
            self.seen.goes_on = false;
            self.review_next_segment(now);
        }
    }

    /// Sets out on a tour past the patches of the list and the candidates that the reader is unsure of.
    fn begin_review(&mut self, now: Instant) {
        if !self.seen.prepare_tour(Then::Review, &self.flight, &self.background, now) {
            return;
        }
        let stops = self.review_stops();
        if stops.is_empty() {
            return self.review_next_segment(now);
        }
        // On the tour, all gas is one.
        let (unsure, elsewhere) = (self.unsure_stops().len(), self.seen.stops(&self.flight).1);
        let here = self.flight.setup().plan.segment;
        if self.act(FlightCommand::Review(stops), now) {
            self.seen.goes_to = None;
            self.seen.goes_on = true;
            self.seen.reviewed.extend(here);
            self.set_off(now);
            let tour = self.flight.tour();
            let (count, mm) = tour.map_or((0, 0.0), |t| (t.stops.len(), t.route.length_mm()));
            let path = self.flight.setup().scene.guides.get::<PathSettings>();
            let minutes = (mm / path.cruise_mm_s + STOP_S * count as f64) / 60.0;
            let of_them = if unsure > 0 { format!(" ({unsure} unsure candidates)") } else { String::new() };
            let key = self.actions.key("review");
            let end = if key.is_empty() { key } else { format!("; {key} ends it") };
            let more = match elsewhere {
                0 => String::new(),
                left => format!(", then {left} in other segments"),
            };
            self.say(format!("review: {count} places{of_them} in {mm:.0} mm, about {minutes:.0} min{end}{more}"), now);
        }
    }

    /// Takes what has come out of the background.
    pub(super) fn take_seen(&mut self, now: Instant) {
        self.wait_at_missed(now);
        self.go_on_with_review(now);
        let other = self.cleansing.other();
        self.seen.follow(&self.flight, other, &self.background, now);
        match self.seen.take(&mut self.flight, other, &self.background, now) {
            Ok(None) => {}
            Ok(Some(News::Begun)) => {
                if self.seen.is_painted() {
                    let told = self.coverage_text();
                    self.say(told, now);
                }
                self.list_missed(now);
                self.paint_anew();
            }
            Ok(Some(News::Listed(then))) => {
                self.attention = true;
                let here = self.flight.pose().position;
                let next = self.flight.camera::<LiveCoverage>().and_then(|c| self.seen.next_missed(c, here));
                match (then, next) {
                    (Then::Nothing, _) => {}
                    (Then::Next, Some(n)) => self.fly_to_missed(n, now),
                    (Then::Review, _) => self.begin_review(now),
                    (Then::Next, _) => self.say("nothing larger than 3 cm² was missed", now),
                }
            }
            Ok(Some(News::Prepared(Then::Review))) => self.begin_review(now),
            Ok(Some(News::Prepared(_))) => self.next_missed(now),
            Err(e) => self.say(e.to_string(), now),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::time::{Duration, Instant};

    use super::*;
    use crate::host::window::assistant::State;
    use crate::host::window::contract::WindowView;
    use crate::host::window::controller::tests::{cockpit_of, perform, phantom_flight, trace, wish};
    use crate::host::window::intent::Intent;
    use crate::phantom::PhantomSettings;
    use crate::polyps::answers::Answer;
    use crate::progress::Progress;

    /// A flight in a window that has flown half of its way, and is watched. It is paused, so that what was missed does not depend on
    /// how long it takes to find out.
    fn watched() -> (FlightController, Instant) {
        watched_in(PhantomSettings::embedded(1))
    }

    fn watched_in(phantom: PhantomSettings) -> (FlightController, Instant) {
        let mut flight = phantom_flight(&phantom);
        while flight.survey().progress().0 < 0.6 {
            flight.step().unwrap();
        }
        let mut c = cockpit_of(flight, 0.0, Vec::new());
        let mut now = Instant::now();
        trace(&mut c, now);
        perform(&mut c, "pause", now);
        c.show_seen(true, now);
        go_on(&mut c, &mut now, |c| c.seen().list().is_some());
        (c, now)
    }

    /// Lets time go by until something is so.
    #[track_caller]
    fn go_on(c: &mut FlightController, now: &mut Instant, until: impl Fn(&FlightController) -> bool) {
        let begun = Instant::now();
        while !until(c) {
            let is_late = begun.elapsed() > Duration::from_secs(150);
            assert!(!is_late, "{:?}, {:?}", c.hud(*now).message, c.seen().state());
            *now += Duration::from_millis(25);
            c.advance(*now).unwrap();
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    #[test]
    #[ignore = "slow: flights to missed patches in real time"]
    fn the_camera_flies_to_the_next_missed_patch_looks_at_it_and_waits() {
        let (mut c, mut now) = watched();
        let here = c.flight().pose().position;
        let mut before = None;
        for _ in 0..2 {
            perform(&mut c, "missed-next", now);
            go_on(&mut c, &mut now, |c| c.flight().tour().is_some());
            assert_eq!(c.flight().tour().unwrap().stops.len(), 1);
            let n = c.seen().current().unwrap();
            let position = c.seen().list().unwrap()[n].position;
            assert_ne!(before, Some(position));
            go_on(&mut c, &mut now, |c| c.flight().tour().is_none() && c.hand().paused);
            let patch = &c.seen().list().unwrap()[n];
            let pose = c.flight().pose();
            let to = patch.position - pose.position;
            let wanted = patch.look_from.unwrap().position;
            assert!(pose.position.distance(wanted) < 5.0 && pose.position.distance(here) > 5.0);
            assert!(to.normalize().dot(pose.attitude.forward) > 0.9, "it looks there");
            assert!(c.hand().paused && c.slices().cursor() == Some(patch.position));
            before = Some(position);
        }
        assert_eq!(c.flight().setup().scene.guide_name(), "path");
        // A row of the list that is clicked is gone to at once.
        c.visit_missed(0, now);
        assert!(c.flight().tour().is_none() && c.seen().current() == Some(0));
    }

    #[test]
    #[ignore = "slow: coverage of a flight"]
    fn a_patch_is_told_where_its_file_and_the_bar_have_it() {
        let (mut c, mut now) = watched();
        let list = c.seen().list().unwrap().to_vec();
        let lumen = Arc::clone(&c.flight().setup().lumen);
        let along = lumen.along(c.flight().setup().volume.voxels(), &Progress::new()).unwrap();
        let round = |mm: f64| (mm / 10.0).round() * 10.0;
        assert!(list.iter().any(|m| m.look_from.is_some()));
        for (n, patch) in list.iter().enumerate().filter(|(_, m)| m.look_from.is_some()) {
            let told = patch.along.unwrap().text();
            let in_file = serde_json::to_value(patch).unwrap()["along_mm"].as_f64().unwrap();
            assert!(told.ends_with(&format!(", {} mm", round(in_file))) && !told.contains("segment"), "{told}");
            // From where the patch is seen, the bar counts in the same way.
            c.visit_missed(n, now);
            now += Duration::from_secs(1);
            c.advance(now).unwrap();
            // Until the measure is known, the distance flown is told.
            while c.hud(now).place.contains(" of about ") {
                now += Duration::from_secs(1);
                std::thread::sleep(Duration::from_millis(2));
            }
            let camera = along.of(c.flight().pose().position).unwrap();
            let of = format!(" of {} mm", round(along.length_mm()));
            assert_eq!(c.hud(now).place, camera.text().replace(" mm", &of));
        }
    }

    #[test]
    #[ignore = "slow: coverage of a flight through a collapsed phantom"]
    fn a_review_with_nothing_to_look_at_goes_to_the_segment_that_has() {
        let (mut c, mut now) = watched_in(PhantomSettings { collapsed: true, ..PhantomSettings::embedded(1) });
        assert!(c.flight().setup().lumen.segments.len() > 1);
        let (here, elsewhere) = c.seen().stops(c.flight());
        assert!(!here.is_empty() && elsewhere == 0, "what was not visited is not missed");
        let listed = c.seen().list().unwrap().len();
        assert!(here.len() <= listed && c.seen().count_here(c.flight()) == listed);
        let first = c.flight().setup().plan.segment;
        perform(&mut c, "next", now);
        assert_eq!((c.seen().stops(c.flight()), c.seen().count_here(c.flight())), ((Vec::new(), here.len()), 0));
        assert!(c.flight().setup().plan.segment != first && c.seen().segments_left(c.flight()).into_iter().eq(first));
        // There is nothing to review here: it goes where there is.
        perform(&mut c, "review", now);
        go_on(&mut c, &mut now, |c| c.flight().tour().is_some());
        assert_eq!(
            (c.seen().reviewed.clone().into_iter().next(), c.flight().tour().unwrap().stops.len()),
            (first, here.len())
        );
        let told = c.hud(now).message.unwrap();
        assert!(told.starts_with(&format!("review: {} places", here.len())), "{told}");
    }

    #[test]
    #[ignore = "slow: coverage of a flight through a collapsed phantom"]
    fn a_review_goes_on_in_the_next_segment_and_ends_once() {
        let (mut c, mut now) = watched_in(PhantomSettings { collapsed: true, ..PhantomSettings::embedded(1) });
        let first = c.flight().setup().plan.segment.unwrap();
        let here = c.seen().stops(c.flight()).0.len();
        perform(&mut c, "review", now);
        go_on(&mut c, &mut now, |c| c.flight().tour().is_some());
        assert!(c.seen.goes_on && here > 0);
        // The next segment has something, too, once this one is over.
        let other = usize::from(first == 0);
        c.seen.reviewed.remove(&other);
        while c.flight().tour().is_some() {
            c.flight_mut().step().unwrap();
        }
        trace(&mut c, now);
        now += Duration::from_millis(50);
        c.advance(now).unwrap();
        let over = c.hud(now).message.unwrap();
        assert!(!c.seen.goes_on && over == "review over", "{over}");
        perform(&mut c, "review", now);
        assert!(c.seen.reviewed.is_empty(), "the next round is a new one");
    }

    #[test]
    #[ignore = "slow: candidates of a phantom, and coverage of a flight"]
    fn a_review_looks_at_unsure_candidates_too() {
        let (mut c, mut now) = watched();
        c.stop(now);
        wish(&mut c, Intent::Search, now);
        go_on(&mut c, &mut now, |c| match c.assistant().unwrap().state() {
            State::Working(..) => false,
            State::Ready(_) => true,
            State::Failed(why) => panic!("{why}"),
        });
        perform(&mut c, "candidate-next", now);
        let place = c.slices().cursor().unwrap();
        let first = c.assistant().unwrap().reading().current().unwrap();
        let looks_there = |c: &FlightController| {
            let stops = c.review_stops();
            stops.iter().any(|s| s.look_at.is_some_and(|at| place.distance(at.into()) < 0.01))
        };
        assert!(!looks_there(&c), "nobody is unsure");
        perform(&mut c, "candidate-unsure", now);
        assert!(looks_there(&c));
        perform(&mut c, "review", now);
        go_on(&mut c, &mut now, |c| c.flight().tour().is_some());
        let tour = c.flight().tour().unwrap();
        assert!(tour.stops.iter().any(|s| s.look_at.is_some_and(|at| place.distance(at) < 0.01)));
        wish(&mut c, Intent::Select(first), now);
        wish(&mut c, Intent::Answer(Answer::No), now);
        assert!(!looks_there(&c));
    }
}
