//! Gets a flight ready on another thread while the window is there.

use std::path::PathBuf;
use std::sync::Arc;

use super::job::Job;
use super::overlay::Content;
use super::session;
use crate::app::FlightApp;
use crate::error::Result;
use crate::progress::Progress;
use crate::volume::Volume;

/// A flight that can set out.
pub struct Ready {
    /// The flight.
    pub flight: FlightApp,
    /// The file of the scan's session; none on a system that names no folder for it.
    pub(super) session: Option<PathBuf>,
}

/// Where the session of a scan is kept.
pub struct SessionFile(Option<PathBuf>);

impl SessionFile {
    /// What is to be known of `volume` later, when the flight may have a copy of it whose fluid is taken as free.
    pub fn of(volume: &Volume) -> Self {
        Self(session::file(volume))
    }

    /// The scan's flight.
    pub fn ready(self, flight: FlightApp) -> Ready {
        Ready { flight, session: self.0 }
    }
}

/// What makes a flight.
pub type Prepare = Box<dyn FnOnce(&Arc<Progress>) -> Result<Ready> + Send>;

/// A flight being made ready.
pub struct Loading(Job<Ready>);

impl Loading {
    /// Begins; `done` is called on the other thread when it is over, whatever came of it.
    ///
    /// # Errors
    /// Status 1 when the system gives no thread.
    pub fn start(prepare: Prepare, progress: &Arc<Progress>, done: impl FnOnce() + Send + 'static) -> Result<Self> {
        Job::start("loading", progress, prepare, done).map(Self)
    }

    /// What came of it, once, as soon as it is over. Effect not wait.
    ///
    /// # Errors
    /// What the preparation fails with; status 1 when it panicked.
    pub fn take(&mut self) -> Option<Result<Ready>> {
        self.0.take()
    }

    /// What came of it; waits if it is not over.
    #[cfg(test)]
    pub fn finish(self) -> Result<Ready> {
        self.0.wait()
    }

    /// What to show meanwhile.
    pub fn content(&self) -> Content {
        let (stage, done, total) = self.0.progress().snapshot();
        let share = (total > 0).then(|| (done.min(total) as f64 / total as f64 * 1000.0).round() / 1000.0);
        Content::Loading { stage, share }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Error;
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
