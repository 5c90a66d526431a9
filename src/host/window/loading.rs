//! Gets a flight ready on another thread while the window is there.

use std::panic::resume_unwind;
use std::path::PathBuf;
use std::sync::Arc;
use std::thread::JoinHandle;

use super::overlay::Content;
use super::session;
use crate::app::FlightApp;
use crate::error::{Error, Result};
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
pub struct Loading {
    worker: JoinHandle<Result<Ready>>,
    progress: Arc<Progress>,
}

/// Calls when it is dropped: also where the worker panics.
struct AtEnd<F: Fn()>(F);

impl<F: Fn()> Drop for AtEnd<F> {
    fn drop(&mut self) {
        (self.0)();
    }
}

impl Loading {
    /// Begins; `done` is called on the other thread when it is over, whatever came of it.
    ///
    /// # Errors
    /// Status 1 when the system gives no thread.
    pub fn start(prepare: Prepare, progress: &Arc<Progress>, done: impl Fn() + Send + 'static) -> Result<Self> {
        let shared = Arc::clone(progress);
        let worker = std::thread::Builder::new().name("loading".to_owned()).spawn(move || {
            let _done = AtEnd(done);
            prepare(&shared)
        });
        let worker = worker.map_err(|e| Error::fault("loading", e.to_string(), "close other programs"))?;
        Ok(Self { worker, progress: Arc::clone(progress) })
    }

    /// What came of it; waits if it is not over.
    ///
    /// # Errors
    /// What the preparation fails with.
    pub fn finish(self) -> Result<Ready> {
        // A panic over there is a fault of the program, and is shown as one here.
        self.worker.join().unwrap_or_else(|panic| resume_unwind(panic))
    }

    /// What to show meanwhile.
    pub fn content(&self) -> Content {
        let (stage, done, total) = self.progress.snapshot();
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
        let (tell, told) = mpsc::channel();
        let progress = Arc::new(Progress::new());
        let prepare: Prepare = Box::new(|p| {
            p.stage("reading", 4);
            p.advance(1)?;
            Err(Error::input("scan", "wrong", "another"))
        });
        let loading = Loading::start(prepare, &progress, move || tell.send(()).unwrap()).unwrap();
        told.recv_timeout(Duration::from_secs(10)).unwrap();
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
