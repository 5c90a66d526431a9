//! Progress of a long-running job, shared between worker and display, with cancellation.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex};

use crate::error::{Error, Result};

/// Progress of one job, cheap to update from any thread. A clone refers to the same job.
///
/// ```
/// use colvis::progress::Progress;
///
/// let progress = Progress::new();
/// let worker = progress.clone();
/// worker.stage("reading", 10);
/// worker.advance(4)?;
/// assert_eq!(progress.snapshot(), ("reading".to_owned(), 4, 10));
/// progress.cancel();
/// assert!(worker.advance(1).is_err(), "the worker gives up");
/// # Ok::<(), colvis::error::Error>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct Progress(Arc<Job>);

#[derive(Debug, Default)]
struct Job {
    stage: Mutex<String>,
    done: AtomicU64,
    total: AtomicU64,
    cancelled: AtomicBool,
    /// True if the cancellation has ended a call.
    ended: AtomicBool,
}

impl Progress {
    /// Creates a job that has not begun.
    pub fn new() -> Self {
        Self::default()
    }

    /// Begins a stage of `total` units (bytes, slices, …; 0 if unknown). `name` is shown to the user.
    pub fn stage(&self, name: &str, total: u64) {
        *self.0.stage.lock().unwrap_or_else(std::sync::PoisonError::into_inner) = name.to_owned();
        self.0.done.store(0, Relaxed);
        self.0.total.store(total, Relaxed);
    }

    /// Counts `n` finished units.
    ///
    /// # Errors
    /// Returns status 4 if the job was cancelled. The worker gives up and leaves nothing half done.
    pub fn advance(&self, n: u64) -> Result<()> {
        self.0.done.fetch_add(n, Relaxed);
        self.check()
    }

    /// Checks for cancellation.
    ///
    /// # Errors
    /// Returns status 4 if the job was cancelled.
    pub fn check(&self) -> Result<()> {
        if self.is_cancelled() { Err(Error::cancelled(self.snapshot().0)) } else { Ok(()) }
    }

    /// Asks the worker to stop: it ends the call under way, or else the next (see [`Progress::call`]).
    pub fn cancel(&self) {
        self.0.cancelled.store(true, Relaxed);
    }

    /// Makes a call that a cancellation may end, and only this one: the next call begins without it.
    ///
    /// # Errors
    /// Returns the error of `work`.
    pub fn call<T>(&self, work: impl FnOnce() -> Result<T>) -> Result<T> {
        if self.0.ended.swap(false, Relaxed) {
            self.0.cancelled.store(false, Relaxed);
        }
        let done = work();
        if done.is_err() && self.is_cancelled() {
            self.0.ended.store(true, Relaxed);
        }
        done
    }

    /// True if [`Progress::cancel`] was called, until the next [`Progress::call`] after one that it has ended.
    pub fn is_cancelled(&self) -> bool {
        self.0.cancelled.load(Relaxed)
    }

    /// Returns the stage, the units done, and the units in all (0 if unknown).
    pub fn snapshot(&self) -> (String, u64, u64) {
        let stage = self.0.stage.lock().unwrap_or_else(std::sync::PoisonError::into_inner).clone();
        (stage, self.0.done.load(Relaxed), self.0.total.load(Relaxed))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cancellation_ends_one_call() {
        let progress = Progress::new();
        progress.cancel();
        // Also one within another, and what follows after it in the same call.
        let nested = || progress.call(|| progress.call(|| progress.check())).and_then(|()| progress.check());
        assert!(progress.call(nested).is_err() && progress.is_cancelled());
        assert_eq!(progress.call(|| progress.check().map(|()| 3)).unwrap(), 3);
        assert!(!progress.is_cancelled());
        // One that came too late ends the next call.
        progress.call(|| Ok(())).unwrap();
        progress.cancel();
        assert!(progress.call(|| progress.check()).is_err() && progress.call(|| progress.check()).is_ok());
    }
}
