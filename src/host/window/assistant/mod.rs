//! The assistant: looks for polyps while the flight goes on, and holds the list, the answers to it and measured lesions.
//!
//! Nothing is computed or kept before somebody asks for it.

mod reading;
mod search;
mod showing;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use serde::Serialize;

use super::background::{Background, BackgroundTask, LOOKS};
use super::clean::Scanned;
use super::cleansing::Cleansing;
use super::job::Job;
use crate::app::FlightApp;
use crate::error::Result;
use crate::polyps::answers::{Answer, Answered, Answers};
use crate::polyps::{Detector, Measurement};

use showing::Facts;

pub(crate) use reading::{Reading, Said};
pub(crate) use search::{Entry, Found, SIDE};
pub use showing::{Order, Showing};

/// What the assistant does, for display.
pub(crate) enum State<'a> {
    /// It works: at this stage, of which this share is done, 0 to 1.
    Working(String, Option<f32>),
    /// There is a list.
    Ready(&'a Arc<Found>),
    /// There is none, and why.
    Failed(&'a str),
}

/// What a search took, for the statistics.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[doc(hidden)]
pub struct Took {
    /// Number of listed candidates.
    pub candidates: usize,
    /// From the begin of the search until the list was there, s.
    pub seconds: f64,
    /// Size in memory of what is kept of it, bytes.
    pub bytes: usize,
}

/// A lesion that somebody pointed at.
pub(crate) type Measured = std::result::Result<Measurement, String>;

/// The assistant of a window, once it was asked for.
pub(crate) struct Assistant {
    /// When it was looked whether the scan without tag is known, while it is waited for.
    waiting: Option<Instant>,
    task: BackgroundTask<Found>,
    found: Option<Arc<Found>>,
    /// The method that finds polyps.
    detector: Detector,
    reading: Reading,
    /// A file of answers to be added once there is a list.
    wanted: Option<PathBuf>,
    /// The last message about answers, in one line.
    told: String,
    /// True if the candidates are marked in all views.
    pub(crate) is_marking: bool,
    /// True if a click measures the lesion there.
    pub(crate) is_measuring: bool,
    measured: Option<Measured>,
    took: Option<Took>,
}

impl Assistant {
    /// Creates an assistant that searches as soon as possible with this method.
    pub(crate) fn new(detector: Detector, now: Instant) -> Self {
        Self {
            waiting: Some(now),
            task: BackgroundTask::new(now),
            found: None,
            detector,
            reading: Reading::default(),
            wanted: None,
            told: String::new(),
            is_marking: false,
            is_measuring: false,
            measured: None,
            took: None,
        }
    }

    /// Goes on: begins the search once the scan without tag is known, and takes what was found, to which `answers` were given before.
    /// Returns true if there is something new to show.
    pub(crate) fn advance(
        &mut self,
        flight: &FlightApp,
        cleansing: &Cleansing,
        background: &Background,
        answers: &[Answered],
        now: Instant,
    ) -> bool {
        if self.waiting.is_some() {
            self.waiting = cleansing.is_under_way().then_some(now);
            if self.waiting.is_none() {
                self.task.go_over(begin(self.detector, flight, cleansing, background), now);
            }
            return self.waiting.is_none();
        }
        let done = self.task.take(now);
        let is_new = done.is_some();
        if let Some(Ok((found, seconds))) = done {
            self.take(found, answers, seconds);
        }
        is_new
    }

    fn take(&mut self, found: Found, answers: &[Answered], seconds: f64) {
        self.took = Some(Took { candidates: found.list.len(), seconds, bytes: found.bytes });
        let places = found.list.iter().map(|e| e.candidate.position).collect();
        let showing = self.reading.showing();
        self.reading = Reading::open(places, answers);
        self.reading.know(found.list.iter().map(Facts::of).collect());
        self.reading.show(showing);
        self.told.clear();
        self.found = Some(Arc::new(found));
    }

    /// Adds the answers that have waited for the list.
    pub(crate) fn load_wanted(&mut self) {
        if let Some(path) = self.wanted.take() {
            self.load(&path);
        }
    }

    /// Returns when its progress has to be looked at.
    pub(crate) fn next(&self) -> Option<Instant> {
        self.waiting.map(|looked| looked + LOOKS).or(self.task.next())
    }

    /// Returns what it does.
    pub(crate) fn state(&self) -> State<'_> {
        match (&self.found, self.task.progress(), self.task.failed()) {
            (Some(found), ..) => State::Ready(found),
            (_, Some(progress), _) => {
                let (stage, done, all) = progress.snapshot();
                State::Working(stage, (all > 0).then_some(done as f32 / all as f32))
            }
            (.., Some(why)) => State::Failed(why),
            (None, None, None) => State::Working("waiting for cleansing".to_owned(), None),
        }
    }

    /// Stops the search.
    pub(crate) fn cancel(&mut self) {
        if self.waiting.take().is_some() || self.task.is_working() {
            self.task.fail("the search was cancelled");
        }
    }

    /// Searches again, after a failure.
    pub(crate) fn retry(&mut self, now: Instant) {
        if self.task.failed().is_some() {
            self.task.stop();
            self.waiting = Some(now);
        }
    }

    /// Returns what was found.
    pub(crate) fn found(&self) -> Option<&Arc<Found>> {
        self.found.as_ref()
    }

    /// Returns the reading.
    pub(crate) fn reading(&self) -> &Reading {
        &self.reading
    }

    /// Returns the reading for changes.
    pub(crate) fn reading_mut(&mut self) -> &mut Reading {
        &mut self.reading
    }

    /// Returns the last message about answers; empty if there is none.
    pub(crate) fn told(&self) -> &str {
        &self.told
    }

    /// Returns what the search took, once it is over.
    pub(crate) fn took(&self) -> Option<Took> {
        self.took.clone()
    }

    /// Adds the answers of a file, now or once there is a list.
    pub(crate) fn load(&mut self, path: &Path) {
        if self.found().is_none() {
            self.told = "the answers are added once there is a list".to_owned();
            self.wanted = Some(path.to_owned());
            return;
        }
        self.told = match Answers::read(path).map(|read| read.answers) {
            Ok(all) => {
                let own = self.reading.merge(&all);
                format!("{own} of {} answers belong to candidates of this list", all.len())
            }
            Err(e) => format!("{}: {}", e.what, e.why),
        };
    }

    /// Sets the message about answers; empty for none.
    pub(crate) fn tell(&mut self, told: String) {
        self.told = told;
    }

    /// Measures the lesion at a place of the wall (world, mm).
    pub(crate) fn measure(&mut self, at: DVec3) -> &Measured {
        let measured = match self.found() {
            Some(found) => found.measure(at).map_err(|e| e.why),
            None => Err("the wall is not known yet".to_owned()),
        };
        self.measured.insert(measured)
    }

    /// Returns the lesion that was measured last.
    pub(crate) fn measured(&self) -> Option<&Measured> {
        self.measured.as_ref()
    }

    /// Forgets the measured lesion.
    pub(crate) fn forget_measured(&mut self) {
        self.measured = None;
    }
}

/// Returns an answer in a word.
pub(crate) fn answer_text(answer: Answer) -> &'static str {
    match answer {
        Answer::Yes => "yes",
        Answer::No => "no",
        Answer::Unsure => "unsure",
    }
}

/// Begins the search.
///
/// # Errors
/// Returns status 1 if the system cannot start threads.
fn begin(detector: Detector, flight: &FlightApp, cleansing: &Cleansing, background: &Background) -> Result<Job<Found>> {
    let preset = flight.setup().scene.image.preset;
    let input = search::Input { scan: Scanned::of(flight, cleansing), preset, detector };
    background.start_apart("assistant", move |progress| search::search(input, progress))
}

#[cfg(test)]
mod tests;
