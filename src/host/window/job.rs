//! Background jobs: run work on another thread with progress, and cancel it when its result is no longer needed.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread;

use rayon::ThreadPool;

use crate::error::{Error, Result};
use crate::panics;
use crate::progress::Progress;

/// Called by another thread when its work is done.
pub(crate) type WakeUp = Arc<dyn Fn() + Send + Sync>;

/// A job whose result has not been taken yet. Dropping it cancels the work.
pub(crate) struct Job<T> {
    name: &'static str,
    progress: Arc<Progress>,
    /// `None` after the result was taken.
    result: Option<Receiver<Result<T>>>,
}

impl<T: Send + 'static> Job<T> {
    /// Starts a job on a new thread named `name`. `wake` is called on that thread when the result is available, whether or not
    /// the work succeeded.
    ///
    /// # Errors
    /// Returns status 1 if the system cannot start a thread.
    pub(crate) fn start(
        name: &'static str,
        progress: &Arc<Progress>,
        work: impl FnOnce(&Arc<Progress>) -> Result<T> + Send + 'static,
        wake: impl FnOnce() + Send + 'static,
    ) -> Result<Self> {
        let (job, run) = Self::new(name, progress, work, wake);
        let thread = thread::Builder::new().name(name.to_owned()).spawn(run);
        thread.map_err(|e| Error::fault(name, e.to_string(), "close other programs").caused_by(e))?;
        Ok(job)
    }

    /// Same as [`Job::start`], in a thread pool.
    pub(crate) fn start_in(
        pool: &ThreadPool,
        name: &'static str,
        progress: &Arc<Progress>,
        work: impl FnOnce(&Arc<Progress>) -> Result<T> + Send + 'static,
        wake: impl FnOnce() + Send + 'static,
    ) -> Self {
        let (job, run) = Self::new(name, progress, work, wake);
        pool.spawn(run);
        job
    }

    /// Creates a job, and the closure that another thread must run.
    fn new(
        name: &'static str,
        progress: &Arc<Progress>,
        work: impl FnOnce(&Arc<Progress>) -> Result<T> + Send + 'static,
        wake: impl FnOnce() + Send + 'static,
    ) -> (Self, impl FnOnce() + Send + 'static) {
        let (done, result) = channel();
        let shared = Arc::clone(progress);
        let run = move || {
            // In a pool it may have been cancelled before its turn.
            let worked = panics::catch(|| shared.check().and_then(|()| work(&shared)));
            let panicked = |why| Err(Error::fault(name, format!("panicked: {why}"), "report it"));
            // The owner may have dropped the job.
            let _ = done.send(worked.unwrap_or_else(panicked));
            wake();
        };
        (Self { name, progress: Arc::clone(progress), result: Some(result) }, run)
    }

    /// Returns the progress of the job.
    pub(crate) fn progress(&self) -> &Progress {
        &self.progress
    }

    /// Takes the result once it is available, without waiting.
    ///
    /// # Errors
    /// Returns the error of the work, or status 1 if it panicked.
    pub(crate) fn take(&mut self) -> Option<Result<T>> {
        let result = match self.result.as_ref()?.try_recv() {
            Ok(result) => result,
            Err(TryRecvError::Empty) => return None,
            Err(TryRecvError::Disconnected) => Err(self.lost()),
        };
        self.result = None;
        Some(result)
    }

    /// Waits for the result and returns it.
    ///
    /// # Errors
    /// Returns the errors of [`Job::take`].
    pub(crate) fn wait(mut self) -> Result<T> {
        self.result.take().and_then(|result| result.recv().ok()).unwrap_or_else(|| Err(self.lost()))
    }

    /// The error if the pool was dropped before the job's turn, or the result was taken before.
    fn lost(&self) -> Error {
        Error::fault(self.name, "there is no result", "report it")
    }
}

impl<T> Drop for Job<T> {
    fn drop(&mut self) {
        if self.result.is_some() {
            self.progress.cancel();
        }
    }
}

#[cfg(test)]
mod tests {
    use rayon::ThreadPoolBuilder;
    use std::sync::mpsc::{Receiver, channel};
    use std::time::Duration;

    use super::*;

    const SOON: Duration = Duration::from_secs(10);

    /// Starts a job on a thread and one in a pool, each with the receiver of its wake-up.
    fn begun(work: fn(&Progress) -> Result<u32>) -> [(Job<u32>, Receiver<()>); 2] {
        let pool = ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        [false, true].map(|pooled| {
            let (tell, reported) = channel();
            let wake = move || tell.send(()).unwrap_or_default();
            let (progress, work) = (Arc::new(Progress::new()), move |p: &Arc<Progress>| work(p));
            let job = match pooled {
                true => Job::start_in(&pool, "job", &progress, work, wake),
                false => Job::start("job", &progress, work, wake).unwrap(),
            };
            (job, reported)
        })
    }

    fn until_cancelled(progress: &Progress) -> Result<u32> {
        loop {
            progress.check()?;
            thread::yield_now();
        }
    }

    #[test]
    fn a_result_is_taken_once_and_without_waiting() {
        for (mut job, woken) in begun(|progress| {
            progress.stage("counting", 4);
            progress.advance(3)?;
            Ok(7)
        }) {
            woken.recv_timeout(SOON).unwrap();
            assert_eq!(job.progress().snapshot(), ("counting".to_owned(), 3, 4));
            assert_eq!(job.take().unwrap().unwrap(), 7);
            assert!(job.take().is_none());
            let progress = Arc::clone(&job.progress);
            drop(job);
            assert!(!progress.is_cancelled(), "it was over");
        }
        let (release, held) = channel::<()>();
        let wait = move |_: &Arc<Progress>| Ok(held.recv_timeout(SOON).is_ok());
        let mut job = Job::start("job", &Arc::new(Progress::new()), wait, || {}).unwrap();
        assert!(job.take().is_none(), "it is not over");
        release.send(()).unwrap();
        let progress = Arc::clone(&job.progress);
        assert!(job.wait().unwrap() && !progress.is_cancelled());
    }

    #[test]
    fn an_error_comes_back() {
        for (job, woken) in begun(|_| Err(Error::input("scan", "wrong", "another"))) {
            assert_eq!(job.wait().unwrap_err().kind as i32, 3);
            woken.recv_timeout(SOON).unwrap();
        }
    }

    #[test]
    fn dropping_it_cancels_the_work() {
        for (job, woken) in begun(until_cancelled) {
            let progress = Arc::clone(&job.progress);
            assert!(woken.try_recv().is_err() && !progress.is_cancelled());
            drop(job);
            woken.recv_timeout(SOON).unwrap();
            assert!(progress.is_cancelled());
        }
        // A job that was cancelled before does not start.
        let progress = Arc::new(Progress::new());
        progress.cancel();
        let job = Job::start("job", &progress, |_| -> Result<()> { unreachable!("it was cancelled") }, || {}).unwrap();
        assert_eq!(job.wait().unwrap_err().kind as i32, 4);
    }

    #[test]
    fn a_panic_is_a_fault_of_the_program() {
        // Other tests replace the panic hook.
        let _hook = panics::HOOK.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        for (mut job, woken) in begun(|_| panic!("no such voxel")) {
            woken.recv_timeout(SOON).unwrap();
            let fault = job.take().unwrap().unwrap_err();
            assert_eq!((fault.kind as i32, fault.what.as_str()), (1, "job"));
            assert!(fault.why.contains("no such voxel"), "{}", fault.why);
        }
    }
}
