//! The assistant in a flight: its candidates are flown to, answered, and lesions measured at a click.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;

use super::FlightController;
use crate::app::overlays::coats;
use crate::components::camera::Pose;
use crate::components::review::ReviewStop;
use crate::components::scan::Walls;
use crate::dynamics::Attitude;
use crate::host::window::assistant::{Assistant, answer_text};
use crate::host::window::contract::WindowView;
use crate::host::window::intent::WhyNot;
use crate::math::sphere::half_directions;
use crate::polyps::Detector;
use crate::polyps::answers::Answer;
use crate::space::first_crossing;

/// Room between the camera's body and the wall, mm.
const ROOM_MM: f64 = 0.1;
/// A camera that does not fit where a candidate is seen best is sought in so many directions, at these distances and in such steps,
/// mm, from this far before the candidate.
const DIRECTIONS: usize = 400;
const NEAR_MM: f64 = 4.0;
const FAR_MM: f64 = 80.0;
const STEP_MM: f64 = 2.0;
const BEFORE_MM: f64 = 1.0;

impl FlightController {
    /// Sets the method that finds polyps.
    pub(crate) fn set_detector(&mut self, detector: Detector) {
        self.detector = detector;
    }

    /// Lets the assistant go on.
    pub(super) fn take_found(&mut self, now: Instant) {
        // Coats are found with the candidates.
        if self.has_shown && self.overlays.is_shown(coats::OVERLAY.name) && self.flight.coats().is_none() {
            self.asked_assistant(now);
        }
        let Some(assistant) = &mut self.assistant else { return };
        let had_list = assistant.found().is_some();
        let answers = &self.document.found().answers;
        if assistant.advance(&self.flight, &self.cleansing, &self.background, answers, now) {
            self.attention = true;
        }
        if let Some(found) = assistant.found().filter(|_| !had_list) {
            self.flight.keep_coats(Arc::clone(&found.coats));
            self.document.begin_list(assistant.reading());
            assistant.load_wanted();
            self.overlays.refresh(&mut self.flight);
            self.note_changes(now);
        }
    }

    /// Checks whether there is a list of candidates. The error states why not.
    pub(crate) fn may_read(&self) -> Result<(), WhyNot> {
        match self.assistant() {
            Some(a) if a.found().is_some() => Ok(()),
            Some(_) => Err("there is no list of candidates yet".into()),
            None => {
                let how = self.actions.hint("panel-candidates", "looks for polyps");
                Err(format!("there is no list of candidates{how}").into())
            }
        }
    }

    /// Returns the assistant, which begins to search if it was not asked for yet.
    pub(super) fn asked_assistant(&mut self, now: Instant) -> &mut Assistant {
        let detector = self.detector;
        self.assistant.get_or_insert_with(|| Box::new(Assistant::new(detector, now)))
    }

    /// Shows a candidate, by its number from 0.
    pub(super) fn select(&mut self, n: usize, now: Instant) {
        if self.asked_assistant(now).reading_mut().select(n).is_some() {
            self.visit(n, self.number_text(n), now);
        }
    }

    /// Shows the next candidate, or the previous one.
    pub(super) fn step(&mut self, forward: bool, now: Instant) {
        let reading = self.asked_assistant(now).reading_mut();
        match (reading.step(forward), reading.count()) {
            (Some(n), _) => self.visit(n, self.number_text(n), now),
            (None, 0) => self.say("there is no candidate", now),
            (None, count) => self.say(format!("the list shows none of the {count} candidates"), now),
        }
    }

    /// Answers whether the candidate that is shown is a polyp, and goes on to the next without an answer.
    pub(super) fn answer(&mut self, answer: Answer, now: Instant) {
        let assistant = self.asked_assistant(now);
        let Some(n) = assistant.reading().current() else { return self.say("no candidate is selected", now) };
        assistant.reading_mut().answer(answer);
        assistant.tell(String::new());
        let undo = self.actions.hint("undo", "undoes it");
        self.move_on(format!("candidate {}: {}{undo}", n + 1, answer_text(answer)), now);
    }

    /// Measures lesions by clicks, or stops that.
    pub(super) fn switch_lesions(&mut self, now: Instant) {
        let assistant = self.asked_assistant(now);
        assistant.is_measuring = !assistant.is_measuring;
        if assistant.is_measuring {
            if self.measures.is_on() {
                self.measures.switch();
            }
            self.stop(now);
            self.say("click on a lesion, in the flight or in a slice", now);
        }
    }

    /// Adds a file of answers, which begins the search for what they belong to.
    pub(crate) fn load_answers(&mut self, path: &Path, now: Instant) {
        self.asked_assistant(now).load(path);
        self.note_changes(now);
        self.attention = true;
        if let Some(told) = self.assistant().map(|a| a.told().to_owned()) {
            self.say(told, now);
        }
    }

    /// True if a click measures a lesion.
    pub(super) fn measures_lesions(&self) -> bool {
        self.assistant().is_some_and(|a| a.is_measuring)
    }

    /// Stops measuring lesions, because distances are measured.
    pub(super) fn leave_lesions(&mut self) {
        if let Some(assistant) = &mut self.assistant {
            assistant.is_measuring = false;
        }
    }

    /// Measures the lesion at a place of the wall, and points there.
    pub(super) fn measure_lesion(&mut self, place: DVec3, now: Instant) {
        let Some(assistant) = &mut self.assistant else { return };
        let (at, told) = match assistant.measure(place) {
            Ok(m) => {
                let [a, b] = m.lesion.ends;
                (a.midpoint(b), format!("{:.1} mm", m.lesion.diameter_mm))
            }
            Err(why) => (place, why.clone()),
        };
        self.slices.point(&self.flight, at);
        self.say(told, now);
        self.quiet = 0;
    }

    /// Returns the number of a candidate in words.
    fn number_text(&self, n: usize) -> String {
        let all = self.assistant().map_or(0, |a| a.reading().count());
        format!("candidate {} of {all}", n + 1)
    }

    /// Goes on to the next candidate without an answer once one was answered, which `told` tells.
    fn move_on(&mut self, told: String, now: Instant) {
        // A review flies on.
        let is_touring = self.flight.tour().is_some();
        let Some(assistant) = self.assistant.as_mut().filter(|_| !is_touring) else { return self.say(told, now) };
        if let Some(next) = assistant.reading_mut().step_to_open() {
            return self.visit(next, format!("{told}; now {}", self.number_text(next)), now);
        }
        let reading = assistant.reading();
        let (all, answered) = (reading.count(), reading.answered());
        let end = if answered == all {
            format!("all {all} candidates are answered")
        } else {
            format!("all that are shown are answered, {} of all {all} are not", all - answered)
        };
        self.say(format!("{told}; {end}"), now);
    }

    /// Tells what was undone of a candidate, and shows it if another one was looked at `before`.
    pub(super) fn return_to(&mut self, n: usize, before: Option<usize>, now: Instant) {
        let said = self.assistant().and_then(|a| a.reading().said(n)?.answer);
        let told = format!("{}: undone; {}", self.number_text(n), said.map_or("no answer", answer_text));
        if before == Some(n) || self.flight.tour().is_some() {
            return self.say(told, now);
        }
        self.visit(n, told, now);
    }

    /// Shows a candidate in all views, and tells so: the camera goes to where it is seen well, or else to where it is seen at all.
    fn visit(&mut self, n: usize, mut told: String, now: Instant) {
        let Some(found) = self.assistant().and_then(|a| a.found()).map(Arc::clone) else { return };
        let Some(entry) = found.list.get(n) else { return };
        self.stop(now);
        self.travel = None;
        let (pose, place) = (entry.pose, entry.candidate.position);
        if self.flight.setup().scene.play().is_none() && !self.go_where_seen(pose, place, now) {
            told.push_str(": the flight cannot go to where it is seen");
        }
        self.say(told, now);
        // The camera has moved before the slices left for the place.
        self.slices.aim(&self.flight, entry.candidate.position, 0.0);
        self.figures.touch();
        self.quiet = 0;
    }

    /// Returns the stops of a review that look at the candidates that the reader is unsure of, in the segment that is flown.
    pub(super) fn unsure_stops(&self) -> Vec<ReviewStop> {
        let flown = self.flight.setup().plan.segment;
        let here = self.unsure().into_iter().filter(|(segment, _)| flown.is_none_or(|flown| flown == *segment));
        here.map(|(_, stop)| stop).collect()
    }

    /// Returns the segments that they are in.
    pub(super) fn unsure_segments(&self) -> Vec<usize> {
        self.unsure().into_iter().map(|(segment, _)| segment).collect()
    }

    /// Returns the stops at the candidates that the reader is unsure of, each with its segment.
    fn unsure(&self) -> Vec<(usize, ReviewStop)> {
        let Some((assistant, found)) = self.assistant().and_then(|a| Some((a, a.found()?))) else { return Vec::new() };
        let is_unsure = |n: usize| assistant.reading().said(n).is_some_and(|s| s.answer == Some(Answer::Unsure));
        let seen = found.list.iter().enumerate().filter(|(n, _)| is_unsure(*n)).filter_map(|(_, entry)| {
            let (pose, segment) = self.seen_from(entry.pose, entry.candidate.position)?;
            Some((segment, ReviewStop::new(pose.position, Some(entry.candidate.position))))
        });
        seen.collect()
    }

    /// Returns from where an entry is seen by a camera that fits there, and the segment of the lumen that it is in then. Where tag
    /// was taken out there may be no room for the camera, and it looks across from where there is.
    pub(super) fn seen_from(&self, preferred: Pose, place: DVec3) -> Option<(Pose, usize)> {
        if let Some(segment) = self.fits(preferred.position) {
            return Some((preferred, segment));
        }
        let out = (preferred.position - place).try_normalize()?;
        let start = place + out * BEFORE_MM;
        let mut best: Option<(f64, Pose, usize)> = None;
        // Those near the preferred one first.
        for direction in half_directions(DIRECTIONS, out) {
            let free = first_crossing(self.flight.shown_scan(), start, direction, FAR_MM).unwrap_or(FAR_MM);
            let reach = best.map_or(free, |b| b.0.min(free));
            let ways = (1u32..).map(|n| f64::from(n) * STEP_MM).take_while(|mm| *mm < reach);
            let fitting = |mm: f64| self.fits(start + direction * mm).map(|segment| (mm, segment));
            if let Some((mm, segment)) = ways.filter(|mm| *mm >= NEAR_MM).find_map(fitting) {
                let attitude = Attitude::new(-direction, preferred.attitude.up);
                best = Some((mm, Pose { position: start + direction * mm, attitude }, segment));
            }
        }
        best.map(|b| (b.1, b.2))
    }

    /// Returns the segment of the lumen at a place (world, mm) if the camera fits there.
    fn fits(&self, at: DVec3) -> Option<usize> {
        let radius = self.flight.setup().scene.body.radius_mm + ROOM_MM;
        let segment = self.flight.setup().lumen.segment_at(at)?;
        self.flight.app().scan_get::<Walls>().is_some_and(|w| w.0.at(at).mm > radius).then_some(segment)
    }
}
