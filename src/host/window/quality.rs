//! How well each segment of the colon can be read, and how long it was looked at: in a window, while the flight goes on.
//!
//! The clock runs from the first picture. The rest is computed once somebody asks for it.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::background::{Background, BackgroundTask};
use super::job::Job;
use crate::app::FlightApp;
use crate::app::findings::{Quality, SegmentFacts, add_seconds, quality};
use crate::coverage::LiveCoverage;
use crate::error::Result;
use crate::fields::lumen::residue;
use crate::fields::{Along, Lumen};

/// A longer time without input and without a movement of the camera is no reading.
const AWAY: Duration = Duration::from_secs(60);
/// What was removed from a scan is tag if it was brighter, HU.
const TAG_HU: i16 = 150;

/// The quality of each segment, with what else is known of it.
type Segments = Vec<(Quality, SegmentFacts)>;

/// The quality of the open scan.
pub(crate) struct QualityTool {
    /// True once somebody has asked for more than the clock.
    is_wanted: bool,
    task: BackgroundTask<Segments>,
    /// What was computed, and of which measure along the colon.
    known: Option<(Arc<Along>, Segments)>,
    bins_task: BackgroundTask<Vec<u8>>,
    /// The segment of each patch of the wall that is watched, and the gas whose wall that is.
    bins: Option<(Arc<Lumen>, Vec<u8>)>,
    /// How long each segment was looked at, s, by its name.
    seconds: BTreeMap<String, f64>,
    /// When that was noted last, and where the camera was.
    noted: Option<(Instant, Option<&'static str>)>,
    /// When something was done last.
    active: Instant,
}

impl QualityTool {
    pub(crate) fn new(now: Instant) -> Self {
        Self {
            is_wanted: false,
            task: BackgroundTask::new(now),
            known: None,
            bins_task: BackgroundTask::new(now),
            bins: None,
            seconds: BTreeMap::new(),
            noted: None,
            active: now,
        }
    }

    /// Begins with the times of an earlier reading of the scan.
    pub(crate) fn restore(&mut self, list: &[Quality]) {
        let seconds = list.iter().filter(|q| q.seconds > 0.0).map(|q| (q.segment.clone(), q.seconds));
        self.seconds = seconds.collect();
    }

    /// True if nobody has asked for more than the clock.
    pub(crate) fn is_clock_alone(&self) -> bool {
        !self.is_wanted
    }

    /// Asks for more than the clock.
    pub(crate) fn want(&mut self) {
        self.is_wanted = true;
    }

    /// Notes that something is done: the reader asks for something, or the camera moves.
    pub(crate) fn stir(&mut self, now: Instant) {
        self.active = self.active.max(now);
    }

    /// Notes that the camera is in a segment, if that is known.
    pub(crate) fn tick(&mut self, segment: Option<&'static str>, now: Instant) {
        if let Some((since, Some(name))) = self.noted {
            let until = now.min(self.active + AWAY);
            let seconds = until.saturating_duration_since(since).as_secs_f64();
            match self.seconds.get_mut(name) {
                Some(sum) => *sum += seconds,
                None => _ = self.seconds.insert(name.to_owned(), seconds),
            }
        }
        self.noted = Some((now, segment));
    }

    /// Returns how long a segment was looked at, s.
    pub(crate) fn seconds_in(&self, segment: &str) -> f64 {
        self.seconds.get(segment).copied().unwrap_or(0.0)
    }

    /// Goes on with what was asked for, along this measure. Returns true if there is something new to show.
    pub(crate) fn advance(
        &mut self,
        flight: &FlightApp,
        along: Option<&Arc<Along>>,
        background: &Background,
        now: Instant,
    ) -> bool {
        let Some(along) = along.filter(|_| self.is_wanted) else { return false };
        let mut is_new = false;
        let is_old = self.known.as_ref().is_none_or(|k| !Arc::ptr_eq(&k.0, along));
        if let Some(done) = self.task.take(now) {
            is_new = true;
            if let Ok((list, _)) = done {
                self.known = Some((Arc::clone(along), list));
            }
        } else if is_old && !self.task.is_working() && self.task.failed().is_none() {
            self.task.go_over(begin(flight, along, background), now);
        }
        let coverage = flight.camera::<LiveCoverage>();
        if let Some(done) = self.bins_task.take(now) {
            is_new = true;
            self.bins = done.ok().zip(coverage).map(|((bins, _), c)| (Arc::clone(c.gas()), bins));
        } else if let Some(coverage) = coverage
            && self.bins.as_ref().is_none_or(|b| !coverage.is_of(&b.0))
            && !self.bins_task.is_working()
            && self.bins_task.failed().is_none()
        {
            let (along, middles) = (Arc::clone(along), coverage.middles().collect::<Vec<_>>());
            let work = move |_: &_| {
                let part = |name| along.parts().iter().position(|p| p.name == name);
                let bin = |at| along.of(at).and_then(|a| part(a.part?)).map_or(u8::MAX, |n| n as u8);
                Ok(middles.into_iter().map(bin).collect())
            };
            self.bins_task.go_over(background.start_apart("quality", work), now);
        }
        is_new
    }

    /// Returns when its progress has to be looked at.
    pub(crate) fn next(&self) -> Option<Instant> {
        self.task.next().into_iter().chain(self.bins_task.next()).min()
    }

    /// Returns the quality of each segment as far as it is known, with the coverage and the times of this reading; `None` until it was
    /// computed.
    pub(crate) fn list(&self, flight: &FlightApp) -> Option<Segments> {
        let (_, known) = self.known.as_ref()?;
        let mut list = known.clone();
        let coverage = flight.camera::<LiveCoverage>();
        let bins = self.bins.as_ref().zip(coverage).filter(|(b, c)| c.is_of(&b.0));
        if let Some(((_, bins), coverage)) = bins {
            for ((quality, _), [all, seen]) in list.iter_mut().zip(coverage.seen_by(bins, known.len())) {
                quality.coverage = (all > 0.0).then(|| (seen / all).clamp(0.0, 1.0));
            }
        }
        list.iter_mut().for_each(|(quality, _)| add_seconds(std::slice::from_mut(quality), &self.seconds));
        Some(list)
    }

    /// Returns what is stored of it: the same, or the times alone, if no more was asked for.
    pub(crate) fn stored(&self, flight: &FlightApp, before: &[Quality]) -> Vec<Quality> {
        if let Some(list) = self.list(flight) {
            return list.into_iter().map(|(quality, _)| quality).collect();
        }
        let mut list = before.to_vec();
        add_seconds(&mut list, &self.seconds);
        list
    }

    /// Returns why it could not be computed.
    pub(crate) fn failed(&self) -> Option<&str> {
        self.task.failed()
    }
}

/// Begins to compute the quality.
///
/// # Errors
/// Returns status 1 if the system cannot start threads.
fn begin(flight: &FlightApp, along: &Arc<Along>, background: &Background) -> Result<Job<Segments>> {
    let setup = flight.setup();
    let (volume, lumen, cleansed) = (setup.volume.clone(), Arc::clone(&setup.lumen), setup.cleansed.clone());
    let along = Arc::clone(along);
    background.start_apart("quality", move |progress| {
        let found = residue(volume.voxels(), &lumen, progress)?;
        let grid = volume.voxels().grid();
        let was_tag = |[i, j, k]: [usize; 3]| {
            let before = cleansed.as_ref().and_then(|c| c.changes.get(grid.index(i, j, k)));
            before.is_some_and(|hu| hu > TAG_HU)
        };
        quality(&along, &lumen, Some(&found), was_tag)
    })
}

/// Returns a time in minutes and seconds.
pub(crate) fn time_text(seconds: f64) -> String {
    let whole = seconds.round().max(0.0) as u64;
    format!("{}:{:02}", whole / 60, whole % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_clock_counts_where_the_camera_was_and_no_break() {
        let mut now = Instant::now();
        let mut tool = QualityTool::new(now);
        let mut go = |tool: &mut QualityTool, segment, seconds| {
            tool.stir(now);
            tool.tick(segment, now);
            // However often a window at rest looks at the time.
            for _ in 0..10 {
                now += Duration::from_secs(seconds) / 10;
                tool.tick(segment, now);
            }
        };
        go(&mut tool, None, 5);
        go(&mut tool, Some("rectum"), 3);
        go(&mut tool, Some("sigmoid"), 7);
        go(&mut tool, Some("rectum"), 4000);
        go(&mut tool, None, 1);
        go(&mut tool, None, 1);
        let near = |a: f64, b: f64| (a - b).abs() < 1e-6;
        assert!(near(tool.seconds_in("rectum"), 63.0) && near(tool.seconds_in("sigmoid"), 7.0));
        assert_eq!(tool.seconds_in("cecum"), 0.0);
        // An earlier reading of the scan goes on.
        let earlier = Quality { segment: "cecum".to_owned(), seconds: 12.0, ..Quality::default() };
        tool.restore(&[earlier]);
        tool.stir(now);
        tool.tick(Some("cecum"), now);
        now += Duration::from_secs(2);
        tool.tick(None, now);
        assert_eq!(tool.seconds_in("cecum"), 14.0);
    }
}
