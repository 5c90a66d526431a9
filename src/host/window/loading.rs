//! Prepares a flight on another thread while the window is open.

use std::path::PathBuf;
use std::sync::Arc;

use glam::DVec3;

use super::job::Job;
use super::overlay::Content;
use super::{Resume, findings, session};
use crate::app::FlightApp;
use crate::error::{Error, Result};
use crate::fields::lumen::Told;
use crate::progress::Progress;
use crate::volume::Volume;

/// A flight that is ready to start.
#[doc(hidden)]
pub struct Ready {
    /// The flight.
    pub flight: FlightApp,
    pub(super) session: SessionFile,
    /// What the reader must know about the scan.
    pub notes: Vec<String>,
    /// Set if the scan cannot be flown: the flight then rests, and its slices are looked at.
    pub unflown: Option<Unflown>,
    /// True if it reads the whole colon.
    pub is_whole: bool,
    /// True if it begins anew, wherever another flight was left.
    pub is_anew: bool,
}

impl Ready {
    /// Says that the flight reads the whole colon. It goes on where it was left if that flight did so, too, and else begins anew.
    #[doc(hidden)]
    pub fn whole(self, was_whole: bool) -> Self {
        Self { is_whole: true, is_anew: !was_whole, ..self }
    }
}

impl Ready {
    /// Returns the file of the scan's session.
    #[doc(hidden)]
    pub fn session_file(&self) -> Option<&std::path::Path> {
        self.session.path.as_deref()
    }
}

/// A scan that cannot be flown, or not from where it was to be.
#[doc(hidden)]
pub struct Unflown {
    /// Why not.
    pub why: Error,
    /// Prepares a flight that starts in the gas at a place, world mm.
    pub start_at: StartAt,
}

/// A function that prepares a flight from a place, world mm.
pub(crate) type StartAt = Box<dyn Fn(DVec3) -> Prepare + Send>;

/// Location of a scan's session, and what the scan is known by.
#[derive(Clone)]
#[doc(hidden)]
pub struct SessionFile {
    /// `None` on a system that defines no folder for it.
    pub(super) path: Option<PathBuf>,
    pub(super) content: session::Content,
}

impl SessionFile {
    /// Determines the session file of `volume`. Call it with the scan as loaded, since the flight may use a copy whose fluid
    /// counts as free.
    #[doc(hidden)]
    pub fn of(volume: &Volume) -> Self {
        let path = session::file(volume);
        // A system without a folder keeps nothing that would be named by it.
        let content = path.as_ref().map(|_| session::Content::of(volume)).unwrap_or_default();
        Self { path, content }
    }

    /// Returns the kinds that the reader gave to gas when the scan was open before. A file that cannot be read is told of later.
    #[doc(hidden)]
    pub fn told(&self) -> Vec<Told> {
        let files = session::ScanFiles::of(self.path.as_deref(), &self.content, Resume::Nothing);
        let (found, _) = findings::read(&files);
        found.kinds.unwrap_or_default()
    }

    /// True if the whole colon was read when the scan was closed, and not to its end. A file that cannot be read is told of later.
    #[doc(hidden)]
    pub fn was_whole(&self) -> bool {
        let read = self.path.as_deref().map(session::Session::read);
        read.and_then(Result::ok).flatten().is_some_and(|s| s.is_whole())
    }

    /// Combines the session file with the scan's flight.
    #[doc(hidden)]
    pub fn ready(self, flight: FlightApp, notes: Vec<String>) -> Ready {
        Ready { flight, session: self, notes, unflown: None, is_whole: false, is_anew: false }
    }

    /// Combines the session file with the scan's slices, because there is no flight.
    #[doc(hidden)]
    pub fn unflown(self, at_rest: FlightApp, notes: Vec<String>, why: Error, start_at: StartAt) -> Ready {
        Ready { unflown: Some(Unflown { why, start_at }), ..self.ready(at_rest, notes) }
    }
}

/// A function that creates a flight.
#[doc(hidden)]
pub type Prepare = Box<dyn FnOnce(&Arc<Progress>) -> Result<Ready> + Send>;

/// A flight that is being prepared.
pub(crate) struct Loading(Job<Ready>);

impl Loading {
    /// Starts the preparation. `done` is called on the other thread when it is over, whether or not it succeeded.
    ///
    /// # Errors
    /// Returns status 1 if the system cannot start a thread.
    pub(crate) fn start(
        prepare: Prepare,
        progress: &Arc<Progress>,
        done: impl FnOnce() + Send + 'static,
    ) -> Result<Self> {
        Job::start("loading", progress, prepare, done).map(Self)
    }

    /// Takes the result once it is available, without waiting.
    ///
    /// # Errors
    /// Returns the error of the preparation, or status 1 if it panicked.
    pub(crate) fn take(&mut self) -> Option<Result<Ready>> {
        self.0.take()
    }

    /// Waits for the result and returns it.
    #[cfg(test)]
    pub(crate) fn finish(self) -> Result<Ready> {
        self.0.wait()
    }

    /// Returns what to show meanwhile.
    pub(crate) fn content(&self) -> Content {
        let (stage, done, total) = self.0.progress().snapshot();
        let share = (total > 0).then(|| (done.min(total) as f64 / total as f64 * 1000.0).round() / 1000.0);
        Content::Loading { stage, share }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc;
    use std::time::Duration;

    #[test]
    fn an_error_comes_back_and_the_window_is_woken() {
        let (tell, reported) = mpsc::channel();
        let progress = Arc::new(Progress::new());
        let prepare: Prepare = Box::new(|p| {
            p.stage("reading", 4);
            p.advance(1)?;
            Err(Error::input("scan", "wrong", "another"))
        });
        let loading = Loading::start(prepare, &progress, move || tell.send(()).unwrap()).unwrap();
        reported.recv_timeout(Duration::from_secs(10)).unwrap();
        assert_eq!(loading.content(), Content::Loading { stage: "reading".to_owned(), share: Some(0.25) });
        assert_eq!(loading.finish().map(drop).unwrap_err().kind as i32, 3);
    }

    #[test]
    fn cancelling_ends_it() {
        let progress = Arc::new(Progress::new());
        let prepare: Prepare = Box::new(|p| {
            loop {
                p.check()?;
                std::thread::yield_now();
            }
        });
        let loading = Loading::start(prepare, &progress, || {}).unwrap();
        progress.cancel();
        assert_eq!(loading.finish().map(drop).unwrap_err().kind as i32, 4);
    }
}
