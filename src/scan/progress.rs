//! Progress of a long-running job, shared between worker and display, with cancellation.

use std::fmt;
use std::sync::atomic::Ordering::{Relaxed, SeqCst};
use std::sync::atomic::{AtomicBool, AtomicU64};
use std::sync::{Arc, Mutex, OnceLock};

use crate::error::{Error, Result};
use crate::panics;

/// Progress of one job, cheap to update from any thread. A clone refers to the same job.
///
/// ```
/// # use colvis_scan as colvis;
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
    cancelled: Arc<AtomicBool>,
    /// True if the cancellation has ended a call.
    ended: AtomicBool,
    listener: Option<Listener>,
}

/// A callback, and the values that it received last.
struct Listener {
    /// The callback. Its lock is held while it runs, so that it runs once at a time.
    call: Mutex<Box<OnChange>>,
    /// Number of changes to report.
    changes: AtomicU64,
    /// The last percentage of this stage that counted as a change, plus one.
    percent: AtomicU64,
    /// Why it is not called any more: it has panicked.
    fault: OnceLock<String>,
}

type OnChange = dyn Fn(&str, Option<f64>) + Send + Sync;

impl fmt::Debug for Listener {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Listener").field("fault", &self.fault).finish_non_exhaustive()
    }
}

impl Progress {
    /// Creates a job that has not begun.
    pub fn new() -> Self {
        Self::default()
    }

    /// Creates a job that calls `on_change` with the name of the stage and its share that is done, 0 to 1 (`None` if the whole is
    /// unknown): at the beginning of each stage, and whenever another per cent of it is done.
    ///
    /// It is called on the thread that does the work, which may be any thread of a pool, and one call at a time. The work waits for
    /// it, so it should be fast. It may cancel the job. If it panics, it is not called again, and the work ends with an error that
    /// says so.
    ///
    /// ```
    /// # use colvis_scan as colvis;
    /// use std::sync::mpsc::channel;
    ///
    /// use colvis::progress::Progress;
    ///
    /// let (send, changes) = channel();
    /// let progress = Progress::with_callback(move |stage, share| send.send((stage.to_owned(), share)).unwrap());
    /// // A scan that is opened with it (`OpenOptions::progress`) calls these.
    /// progress.stage("reading", 4);
    /// progress.advance(2)?;
    /// assert_eq!(changes.try_iter().collect::<Vec<_>>(), [("reading".to_owned(), Some(0.0)), ("reading".to_owned(), Some(0.5))]);
    /// # Ok::<(), colvis::error::Error>(())
    /// ```
    pub fn with_callback(on_change: impl Fn(&str, Option<f64>) + Send + Sync + 'static) -> Self {
        let listener = Listener {
            call: Mutex::new(Box::new(on_change)),
            changes: AtomicU64::new(0),
            percent: AtomicU64::new(0),
            fault: OnceLock::new(),
        };
        Self(Arc::new(Job { listener: Some(listener), ..Job::default() }))
    }

    /// Returns a job for work that runs beside this one: it is cancelled with it, and its stages are not shown.
    #[must_use]
    pub fn beside(&self) -> Self {
        Self(Arc::new(Job { cancelled: Arc::clone(&self.0.cancelled), ..Job::default() }))
    }

    /// Begins a stage of `total` units (bytes, slices, …; 0 if unknown). `name` is shown to the user.
    pub fn stage(&self, name: &str, total: u64) {
        *self.0.stage.lock().unwrap_or_else(std::sync::PoisonError::into_inner) = name.to_owned();
        self.0.done.store(0, Relaxed);
        self.0.total.store(total, Relaxed);
        if let Some(listener) = &self.0.listener {
            // Progress of 0 is reported here, so that it does not count as a change later.
            listener.percent.store(1, Relaxed);
            self.tell(listener);
        }
    }

    /// Reports a change. If another thread is reporting one, it reports this one, too, so that no thread waits, and the callback
    /// may itself begin a stage.
    fn tell(&self, listener: &Listener) {
        listener.changes.fetch_add(1, SeqCst);
        loop {
            let call = match listener.call.try_lock() {
                Ok(call) => call,
                Err(std::sync::TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
                Err(std::sync::TryLockError::WouldBlock) => return,
            };
            let told = listener.changes.load(SeqCst);
            if listener.fault.get().is_none() {
                let (stage, done, total) = self.snapshot();
                let share = (total > 0).then(|| done.min(total) as f64 / total as f64);
                if let Err(why) = panics::catch(|| call(&stage, share)) {
                    listener.fault.get_or_init(|| why);
                }
            }
            drop(call);
            if listener.changes.load(SeqCst) == told {
                return;
            }
        }
    }

    /// Counts `n` finished units.
    ///
    /// # Errors
    /// As [`Progress::check`]. The worker gives up and leaves nothing half done.
    pub fn advance(&self, n: u64) -> Result<()> {
        let done = self.0.done.fetch_add(n, Relaxed).saturating_add(n);
        if let Some(listener) = &self.0.listener {
            let total = self.0.total.load(Relaxed);
            let percent = if total > 0 { (u128::from(done.min(total)) * 100 / u128::from(total)) as u64 } else { 0 };
            if listener.percent.fetch_max(percent + 1, Relaxed) < percent + 1 {
                self.tell(listener);
            }
        }
        self.check()
    }

    /// Checks for cancellation.
    ///
    /// # Errors
    /// Returns status 4 if the job was cancelled, and 1 if its callback has panicked.
    pub fn check(&self) -> Result<()> {
        if let Some(why) = self.0.listener.as_ref().and_then(|l| l.fault.get()) {
            return Err(Error::fault("progress callback", format!("panicked: {why}"), "fix it or leave it out"));
        }
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
    fn work_beside_a_job_is_cancelled_with_it_and_not_shown() {
        let progress = Progress::new();
        progress.stage("reading", 3);
        let beside = progress.beside();
        beside.stage("measuring", 5);
        beside.advance(2).unwrap();
        assert_eq!(progress.snapshot(), ("reading".to_owned(), 0, 3));
        progress.cancel();
        assert!(beside.check().is_err());
    }

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

    type Heard = Arc<Mutex<Vec<(String, Option<f64>)>>>;

    /// Returns a job, and the values that its callback received.
    fn heard() -> (Progress, Heard) {
        let heard = Arc::new(Mutex::new(Vec::new()));
        let told = Arc::clone(&heard);
        let progress =
            Progress::with_callback(move |stage, share| told.lock().unwrap().push((stage.to_owned(), share)));
        (progress, heard)
    }

    #[test]
    fn a_callback_is_told_each_stage_and_each_per_cent_of_it() {
        let (progress, heard) = heard();
        progress.stage("reading", 1000);
        let thread = std::thread::current().id();
        (0..1000).for_each(|_| progress.clone().advance(1).unwrap());
        progress.stage("of unknown length", 0);
        progress.advance(7).unwrap();
        progress.stage("short", 2);
        progress.advance(1).unwrap();
        progress.advance(9).unwrap();
        let heard = std::mem::take(&mut *heard.lock().unwrap());
        let of = |stage: &str| heard.iter().filter(|h| h.0 == stage).map(|h| h.1).collect::<Vec<_>>();
        assert_eq!(of("reading"), (0..=100).map(|n| Some(f64::from(n) / 100.0)).collect::<Vec<_>>());
        assert_eq!(of("of unknown length"), [None]);
        assert_eq!(of("short"), [Some(0.0), Some(0.5), Some(1.0)]);
        let on = Arc::new(Mutex::new(Vec::new()));
        let threads = Arc::clone(&on);
        let progress = Progress::with_callback(move |_, _| threads.lock().unwrap().push(std::thread::current().id()));
        progress.stage("here", 1);
        assert_eq!(*on.lock().unwrap(), [thread], "the one that works");
    }

    #[test]
    fn a_callback_of_many_threads_hears_the_end_and_never_goes_back() {
        for _ in 0..20 {
            let (progress, heard) = heard();
            progress.stage("flying", 400);
            std::thread::scope(|s| {
                for _ in 0..4 {
                    s.spawn(|| (0..100).for_each(|_| progress.advance(1).unwrap()));
                }
            });
            let shares: Vec<f64> = heard.lock().unwrap().iter().map(|h| h.1.unwrap()).collect();
            assert!(shares.is_sorted() && shares.last() == Some(&1.0), "{shares:?}");
        }
    }

    #[test]
    fn a_callback_may_cancel_and_begin_a_stage_and_its_panic_is_told() {
        let own = Arc::new(OnceLock::<Progress>::new());
        let inside = Arc::clone(&own);
        let progress = Progress::with_callback(move |stage, _| {
            let Some(progress) = inside.get() else { return };
            match stage {
                "first" => progress.stage("second", 0),
                _ => progress.cancel(),
            }
        });
        own.set(progress.clone()).unwrap();
        progress.stage("first", 10);
        assert!(progress.is_cancelled() && progress.snapshot().0 == "second");
        assert_eq!(progress.advance(1).unwrap_err().kind as u8, 4);

        let calls = Arc::new(AtomicU64::new(0));
        let counted = Arc::clone(&calls);
        let progress = Progress::with_callback(move |_, _| {
            counted.fetch_add(1, Relaxed);
            panic!("told badly");
        });
        progress.stage("reading", 10);
        let e = progress.advance(5).unwrap_err();
        let told = e.to_string();
        assert!(e.kind as u8 == 1 && told.contains("progress callback: panicked: told badly"), "{told}");
        assert_eq!(calls.load(Relaxed), 1, "not again");
    }
}
