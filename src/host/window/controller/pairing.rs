//! A flight beside that through the patient's other position: it follows, goes where the other one is, and shares findings.

use std::path::PathBuf;
use std::time::Instant;

use glam::DVec3;

use super::FlightController;
use super::pointing::go_to;
use crate::app::findings::Finding;
use crate::components::camera::Pose;
use crate::components::input::FlightCommand;
use crate::host::window::contract::WindowView;
use crate::host::window::pairing::Twice;

/// Shares of the way from the line to the place that a camera is tried at, where it does not fit.
const NEARER: [f64; 4] = [1.0, 0.6, 0.3, 0.0];

impl FlightController {
    /// Stands at a pose, or between it and the colon's line (world, mm) where it fits. Returns false if it fits nowhere.
    pub(crate) fn stand(&mut self, pose: &Pose, on_line: DVec3, now: Instant) -> bool {
        let Pose { position, attitude } = *pose;
        let Some(at) = NEARER.into_iter().map(|share| on_line.lerp(position, share)).find_map(|at| {
            let segment = self.flight.setup().lumen.segment_at(at)?;
            Some((at, segment))
        }) else {
            return false;
        };
        let plan = &self.flight.setup().plan;
        if plan.gas.is_none() && plan.segment.is_some_and(|own| own != at.1) {
            if self.flight.act(FlightCommand::Segment(at.1)).is_err() {
                return false;
            }
            self.stop(now);
        }
        self.travel = None;
        let stands = NEARER.into_iter().any(|share| {
            let at = on_line.lerp(position, share);
            self.flight.place(at, attitude.forward, attitude.up)
        });
        self.attention |= stands;
        stands
    }

    /// Goes to a pose as a reader does, so that the flight goes on from there; all views show a place (world, mm).
    pub(crate) fn arrive(&mut self, pose: &Pose, on_line: DVec3, place: Option<DVec3>, now: Instant) -> bool {
        self.stop(now);
        let stands = self.stand(pose, on_line, now);
        if stands && let Err(e) = self.flight.act(go_to(self.flight.pose())) {
            self.say(format!("{}: {}", e.what, e.why), now);
        }
        match place {
            Some(place) => self.slices.aim(&self.flight, place, 0.0),
            None => self.slices.follow(),
        }
        (self.quiet, self.attention) = (0, true);
        stands
    }

    /// Waits, whatever flew.
    pub(crate) fn wait(&mut self, now: Instant) {
        self.stop(now);
    }

    /// Returns a stretch along the colon, from and to in mm, on the bar.
    pub(crate) fn stretch(&self, mm: [f64; 2]) -> Option<[u32; 2]> {
        self.place.stretch(&self.flight, mm)
    }

    /// Sets the scan of the other position, and its hash, for reports.
    pub(crate) fn report_with(&mut self, second: Option<(PathBuf, String)>) {
        self.reporting.set_second(second);
    }

    /// Takes which candidates the other position has, too.
    pub(crate) fn raise(&mut self, twice: &[Option<Twice>]) {
        let Some(assistant) = &mut self.assistant else { return };
        let Some(found) = assistant.found().cloned() else { return };
        let scores = found.list.iter().zip(twice.iter().chain(std::iter::repeat(&None)));
        let scores = scores.map(|(entry, twice)| twice.map_or(entry.candidate.score, |t| t.score));
        assistant.reading_mut().raise(scores);
        self.attention = true;
    }

    /// Notes the place (world, mm) of a finding in the other position, whose scan has this hash; `None` parts them.
    pub(crate) fn pair_finding(&mut self, finding: &Finding, other: Option<DVec3>, second: &str, now: Instant) {
        let kept = self.document.pair(&finding.id, finding.place, other, second);
        self.report_kept(kept, now);
        self.attention = true;
    }

    /// Returns the number of the chosen finding.
    pub(crate) fn current_finding(&self) -> Option<usize> {
        self.findings().current(&self.document.found().findings)
    }
}
