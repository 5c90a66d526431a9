//! Work in the background of a window: where it runs, and what becomes of it.

use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use colvis_scan::memory;
use rayon::{ThreadPool, ThreadPoolBuilder};

use super::job::{Job, WakeUp};
use crate::error::{Error, Result};
use crate::progress::Progress;

/// Time between two looks at the progress.
pub(crate) const LOOKS: Duration = Duration::from_millis(200);

/// Starts work in the background. Clones share their threads.
#[derive(Clone)]
pub(crate) struct Background {
    wake: WakeUp,
    /// Created once it is needed.
    pool: Arc<OnceLock<ThreadPool>>,
}

impl Background {
    /// Creates a background that calls `wake` from another thread whenever work is done.
    pub(crate) fn new(wake: WakeUp) -> Self {
        Self { wake, pool: Arc::default() }
    }

    /// Returns what wakes the window.
    pub(crate) fn wake(&self) -> WakeUp {
        Arc::clone(&self.wake)
    }

    /// Starts work on a thread of its own. Its parallel parts share the threads that pictures use.
    ///
    /// # Errors
    /// Returns status 1 if the system cannot start a thread.
    pub(crate) fn start<T: Send + 'static>(
        &self,
        name: &'static str,
        work: impl FnOnce(&Arc<Progress>) -> Result<T> + Send + 'static,
    ) -> Result<Job<T>> {
        let wake = Arc::clone(&self.wake);
        Job::start(name, &Arc::new(Progress::new()), work, move || wake())
    }

    /// Starts long work apart from pictures, which would wait for it in the common pool.
    ///
    /// # Errors
    /// Returns status 1 if the system cannot start threads.
    pub(crate) fn start_apart<T: Send + 'static>(
        &self,
        name: &'static str,
        work: impl FnOnce(&Arc<Progress>) -> Result<T> + Send + 'static,
    ) -> Result<Job<T>> {
        let wake = Arc::clone(&self.wake);
        // It used much that is free now, and a window stays open for long.
        let work = move |progress: &Arc<Progress>| {
            let found = work(progress);
            memory::release();
            found
        };
        Ok(Job::start_in(self.pool()?, name, &Arc::new(Progress::new()), work, move || wake()))
    }

    fn pool(&self) -> Result<&ThreadPool> {
        if let Some(pool) = self.pool.get() {
            return Ok(pool);
        }
        // With one thread, a search would keep all other work waiting.
        let pool = ThreadPoolBuilder::new().num_threads(rayon::current_num_threads().max(2));
        let pool = pool.thread_name(|n| format!("background {n}")).start_handler(|_| let_pictures_first()).build();
        let pool = pool.map_err(|e| Error::fault("threads", e.to_string(), "use fewer --threads").caused_by(e))?;
        Ok(self.pool.get_or_init(|| pool))
    }
}

/// How much nicer than pictures long work is (`nice`): it takes a quarter of a core that both want. More would keep it for minutes beside
/// other programs that are busy.
#[cfg(target_os = "linux")]
const NICER: i32 = 5;

/// Lets pictures go before this thread. Does nothing where threads have no priorities of their own.
fn let_pictures_first() {
    #[cfg(target_os = "linux")]
    {
        let own = rustix::process::getpriority_process(None).unwrap_or(0);
        // A thread that may not have another priority works with the one that it has.
        let _ = rustix::process::setpriority_process(None, own + NICER);
    }
}

enum State<T> {
    Idle,
    /// The work, and when it was begun.
    Working(Job<T>, Instant),
    /// It failed, and why.
    Failed(String),
}

/// Work of one kind that a window does again and again, one at a time.
pub(crate) struct BackgroundTask<T> {
    state: State<T>,
    /// When the progress was looked at.
    looked: Instant,
}

impl<T: Send + 'static> BackgroundTask<T> {
    /// Creates a task that does nothing yet.
    pub(crate) fn new(now: Instant) -> Self {
        Self { state: State::Idle, looked: now }
    }

    /// Goes over to this work. The former one is cancelled.
    pub(crate) fn go_over(&mut self, job: Result<Job<T>>, now: Instant) {
        self.looked = now;
        self.state = job.map_or_else(|e| State::Failed(e.to_string()), |job| State::Working(job, Instant::now()));
    }

    /// Cancels the work, and forgets why it failed.
    pub(crate) fn stop(&mut self) {
        self.state = State::Idle;
    }

    /// Cancels the work, for a reason that is shown.
    pub(crate) fn fail(&mut self, why: impl Into<String>) {
        self.state = State::Failed(why.into());
    }

    /// Takes the result once it is there, and how long it took, s.
    ///
    /// # Errors
    /// Returns the error of the work.
    pub(crate) fn take(&mut self, now: Instant) -> Option<Result<(T, f64)>> {
        let State::Working(job, begun) = &mut self.state else { return None };
        self.looked = now;
        let done = job.take()?;
        let seconds = begun.elapsed().as_secs_f64();
        self.state = match &done {
            Ok(_) => State::Idle,
            Err(e) => State::Failed(e.to_string()),
        };
        Some(done.map(|done| (done, seconds)))
    }

    /// Returns when the progress has to be looked at.
    pub(crate) fn next(&self) -> Option<Instant> {
        self.is_working().then_some(self.looked + LOOKS)
    }

    /// True while it works.
    pub(crate) fn is_working(&self) -> bool {
        matches!(self.state, State::Working(..))
    }

    /// Returns the progress of the work.
    pub(crate) fn progress(&self) -> Option<&Progress> {
        if let State::Working(job, _) = &self.state { Some(job.progress()) } else { None }
    }

    /// Returns why it failed.
    pub(crate) fn failed(&self) -> Option<&str> {
        if let State::Failed(why) = &self.state { Some(why) } else { None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Waits for the result.
    fn taken(task: &mut BackgroundTask<u32>, now: Instant) -> Result<(u32, f64)> {
        loop {
            if let Some(done) = task.take(now) {
                return done;
            }
            std::thread::yield_now();
        }
    }

    #[test]
    fn two_jobs_that_finish_in_either_order_give_the_later_one() {
        let background = Background::new(Arc::new(|| {}));
        let now = Instant::now();
        for is_first_slow in [true, false] {
            let mut task = BackgroundTask::new(now);
            let work = |value: u32, is_slow: bool| {
                move |progress: &Arc<Progress>| {
                    while is_slow && !progress.is_cancelled() && value == 1 {
                        std::thread::yield_now();
                    }
                    Ok(value)
                }
            };
            task.go_over(background.start_apart("task", work(1, is_first_slow)), now);
            task.go_over(background.start("task", work(2, !is_first_slow)), now);
            assert!(task.is_working() && task.next() == Some(now + LOOKS));
            assert_eq!(taken(&mut task, now).unwrap().0, 2);
            assert!(!task.is_working() && task.next().is_none() && task.take(now).is_none());
        }
    }

    /// Apart from pictures, long work has less of the processor than they have, and other work as much.
    #[test]
    #[cfg(target_os = "linux")]
    fn long_work_lets_pictures_go_first() {
        let background = Background::new(Arc::new(|| {}));
        let nice = |_: &Arc<Progress>| Ok(rustix::process::getpriority_process(None).unwrap_or(0));
        let here = nice(&Arc::default()).unwrap();
        // No thread is nicer than 19.
        assert_eq!(background.start_apart("apart", nice).unwrap().wait().unwrap(), (here + NICER).min(19));
        assert_eq!(background.start("beside", nice).unwrap().wait().unwrap(), here);
        assert_eq!(nice(&Arc::default()).unwrap(), here);
    }

    #[test]
    fn a_failure_is_shown_until_something_else_is_done() {
        let background = Background::new(Arc::new(|| {}));
        let (now, mut task) = (Instant::now(), BackgroundTask::new(Instant::now()));
        task.go_over(background.start("task", |_| Err(Error::input("scan", "wrong", "another"))), now);
        assert!(taken(&mut task, now).is_err() && task.failed().is_some_and(|why| why.contains("wrong")));
        task.go_over(background.start("task", |_| Ok(1)), now);
        assert!(task.failed().is_none() && task.progress().is_some());
        task.fail("cancelled");
        assert_eq!((task.failed(), task.next()), (Some("cancelled"), None));
        task.stop();
        assert!(task.failed().is_none());
    }
}
