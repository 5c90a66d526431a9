//! Run times and faults of plug-ins.
//!
//! While systems run, each system's run condition identifies its owner ([`Ledger::begin`]), and time is booked to that
//! owner. A panic is reported with the owner's name, since each owner's systems are in a separate set. An owner that has
//! panicked is switched off and its systems no longer run. A flight without plug-ins has no such conditions.

use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use bevy_ecs::error::{BevyError, ErrorContext};

use super::Phase;
use crate::error::Error;
use crate::panics::panic_text;

thread_local! {
    /// Faults on this thread since they were last taken.
    static FAULTS: RefCell<Vec<Fault>> = const { RefCell::new(Vec::new()) };
    /// Time spent by the makers of pictures on this thread since it was last taken, ms.
    static TIMES: RefCell<BTreeMap<String, f64>> = const { RefCell::new(BTreeMap::new()) };
    /// Messages to the user: the subject and the text.
    static NOTES: RefCell<Vec<(String, String)>> = const { RefCell::new(Vec::new()) };
    /// The owner of the observer that has begun last, since the last system began.
    static OBSERVER: Cell<Option<usize>> = const { Cell::new(None) };
    /// True on a thread that runs a world.
    static IS_HOME: Cell<bool> = const { Cell::new(false) };
}

/// What threads without a world have reported: those that a plug-in or a renderer works on. The world that runs next takes it.
static ELSEWHERE: Mutex<Elsewhere> =
    Mutex::new(Elsewhere { faults: Vec::new(), times: BTreeMap::new(), notes: Vec::new() });

#[derive(Default)]
struct Elsewhere {
    faults: Vec<Fault>,
    times: BTreeMap<String, f64>,
    notes: Vec<(String, String)>,
}

fn elsewhere() -> MutexGuard<'static, Elsewhere> {
    ELSEWHERE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Makes this thread one that runs a world, while the guard lives; for good unless it belongs to a pool.
#[must_use]
#[doc(hidden)]
pub fn at_home() -> AtHome {
    AtHome(IS_HOME.replace(true) || rayon::current_thread_index().is_none())
}

/// A guard of [`at_home`].
#[derive(Debug)]
#[doc(hidden)]
pub struct AtHome(bool);

impl Drop for AtHome {
    fn drop(&mut self) {
        IS_HOME.set(self.0);
    }
}

/// A panic or failure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Fault {
    /// The subject: a system's full name, or the name that was reported.
    pub what: String,
    /// The cause: `panicked: …` with the panic's message.
    pub why: String,
    /// The owner of the observer that was running, if one was. A panic in an observer arrives as that of the command that triggered it.
    pub observer: Option<usize>,
}

/// Reports a panic in a part of a plug-in that was caught, from any thread.
///
/// What a thread reports that runs no flight goes to the flight of the process that runs next.
///
/// It ends the current step or frame with an error, and a headless flight in an orderly way. `what` names the part, for
/// example `preset distance`.
pub fn report_fault(what: impl Into<String>, why: impl Into<String>) {
    add_fault(Fault { what: what.into(), why: format!("panicked: {}", why.into()), observer: None });
}

fn add_fault(fault: Fault) {
    if IS_HOME.get() {
        FAULTS.with_borrow_mut(|faults| faults.push(fault));
    } else {
        elsewhere().faults.push(fault);
    }
}

/// Shows the user a message about a plug-in, once for each pair of `who` and `what`, from any thread.
pub fn note(who: impl Into<String>, what: impl Into<String>) {
    let note = (who.into(), what.into());
    if IS_HOME.get() {
        NOTES.with_borrow_mut(|notes| notes.push(note));
    } else {
        elsewhere().notes.push(note);
    }
}

/// Handles systems that fail in the world.
pub(super) fn system_failed(error: BevyError, context: ErrorContext) {
    let mut error = error;
    let payload = error.take_payload();
    // A command that fails without a panic fails by itself, not in an observer that it has triggered.
    let observer = match context {
        ErrorContext::Observer { .. } => OBSERVER.get(),
        ErrorContext::Command { .. } if payload.is_some() => OBSERVER.take(),
        _ => None,
    };
    let why = match payload {
        Some(payload) => format!("panicked: {}", panic_text(&*payload)),
        None => format!("failed: {error}"),
    };
    let what = match context {
        ErrorContext::RunCondition { system, .. } => system.to_string(),
        other => other.name().to_string(),
    };
    add_fault(Fault { what, why, observer });
}

/// Books the time that a renderer, an overlay or a presenter of another crate took in this frame, under its name, from any thread.
pub fn book_time(name: impl Into<String>, ms: f64) {
    let name = name.into();
    if IS_HOME.get() {
        TIMES.with_borrow_mut(|times| *times.entry(name).or_default() += ms);
    } else {
        *elsewhere().times.entry(name).or_default() += ms;
    }
}

/// Discards what an earlier world on this thread has left behind.
pub(super) fn discard() {
    drop((TIMES.take(), FAULTS.take(), NOTES.take()));
    OBSERVER.set(None);
}

pub(super) fn take_times() -> BTreeMap<String, f64> {
    let mut times = TIMES.take();
    for (name, ms) in std::mem::take(&mut elsewhere().times) {
        *times.entry(name).or_default() += ms;
    }
    times
}

pub(super) fn take_faults() -> Vec<Fault> {
    let mut faults = FAULTS.take();
    faults.append(&mut elsewhere().faults);
    faults
}

pub(super) fn take_notes() -> Vec<(String, String)> {
    let mut notes = NOTES.take();
    let mut others = std::mem::take(&mut elsewhere().notes);
    // Threads report in any order.
    others.sort();
    notes.extend(others);
    notes
}

/// Run time of a plug-in.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct PluginTime {
    /// Name of the plug-in.
    pub name: String,
    /// Milliseconds per step.
    pub step_ms: f64,
    /// Milliseconds per frame.
    pub frame_ms: f64,
}

impl PluginTime {
    /// Returns true if the plug-in delays the flight.
    ///
    /// The limits are more than an eighth of the time between two steps, or a fifth of that between two frames at sixty per second.
    pub fn is_slow(&self) -> bool {
        self.step_ms > 1.0 || self.frame_ms > 3.3
    }

    /// Returns a readable text: "plug-in snow takes 12.0 ms a step, 0.3 ms a frame".
    pub fn text(&self) -> String {
        format!("plug-in {} takes {:.1} ms a step, {:.1} ms a frame", self.name, self.step_ms, self.frame_ms)
    }
}

/// The account of a plug-in, or of a guide of another crate.
#[derive(Clone, Debug)]
struct Account {
    name: String,
    off: bool,
    /// Milliseconds of the current step or frame.
    now: f64,
    /// Milliseconds per step and per frame, averaged with most weight on the newest.
    usual: [Option<f64>; 2],
}

#[derive(Debug, Default)]
struct PluginAccounts {
    accounts: Vec<Account>,
    since: Option<(usize, Instant)>,
}

impl PluginAccounts {
    fn close(&mut self) {
        if let Some((owner, since)) = self.since.take()
            && let Some(account) = self.accounts.get_mut(owner)
        {
            account.now += since.elapsed().as_secs_f64() * 1e3;
        }
    }
}

/// The accounts of the owners of systems, with their run times.
#[derive(Debug, Default)]
pub(super) struct Ledger(Mutex<PluginAccounts>);

impl Ledger {
    fn book(&self) -> MutexGuard<'_, PluginAccounts> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Opens an account for an owner, or returns the existing one.
    pub(crate) fn open(&self, name: &str) -> usize {
        let mut book = self.book();
        if let Some(n) = book.accounts.iter().position(|a| a.name == name) {
            book.accounts[n].off = false;
            return n;
        }
        book.accounts.push(Account { name: name.to_owned(), off: false, now: 0.0, usual: [None; 2] });
        book.accounts.len() - 1
    }

    /// Records that a system of `owner` (`None` for this crate) is about to run. Returns false if it must not.
    pub(crate) fn begin(&self, owner: Option<usize>) -> bool {
        OBSERVER.set(None);
        let mut book = self.book();
        book.close();
        let Some(owner) = owner else { return true };
        let on = book.accounts.get(owner).is_some_and(|a| !a.off);
        if on {
            book.since = Some((owner, Instant::now()));
        }
        on
    }

    /// Records that an observer of `owner` is about to run. Returns false if it must not.
    pub(crate) fn begin_observer(&self, owner: usize) -> bool {
        let on = self.book().accounts.get(owner).is_some_and(|a| !a.off);
        if on {
            OBSERVER.set(Some(owner));
        }
        on
    }

    /// Ends a phase after all its systems have run.
    pub(crate) fn finish(&self, phase: Phase) {
        let mut book = self.book();
        book.close();
        for account in &mut book.accounts {
            let now = std::mem::take(&mut account.now);
            let usual = &mut account.usual[phase as usize];
            *usual = Some(usual.map_or(now, |u| u + (now - u) * 0.1));
        }
    }

    /// Switches an owner's systems off. Returns its name, and true if they were on.
    pub(crate) fn switch_off(&self, owner: usize) -> Option<(String, bool)> {
        let mut book = self.book();
        let account = book.accounts.get_mut(owner)?;
        let on = !std::mem::replace(&mut account.off, true);
        Some((account.name.clone(), on))
    }

    /// Returns the number of owners.
    pub(crate) fn owners(&self) -> usize {
        self.book().accounts.len()
    }

    /// Returns true if an owner's systems are switched off.
    pub(crate) fn is_off(&self, name: &str) -> bool {
        self.book().accounts.iter().any(|a| a.off && a.name == name)
    }

    /// Returns the run times of all owners.
    pub(crate) fn times(&self) -> Vec<PluginTime> {
        let time = |a: &Account| {
            let [step_ms, frame_ms] = a.usual.map(|u| u.unwrap_or(0.0));
            PluginTime { name: a.name.clone(), step_ms, frame_ms }
        };
        self.book().accounts.iter().map(time).collect()
    }
}

/// Converts a fault of `name` to an error.
pub(super) fn fault_error(name: Option<String>, fault: &Fault) -> Error {
    let what = match name {
        Some(name) => format!("plug-in {name} ({})", fault.what),
        None => fault.what.clone(),
    };
    Error::fault(what, fault.why.clone(), "fix it, or fly without it")
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_plugin_that_was_slow_once_is_not_slow_for_ever() {
        let ledger = Ledger::default();
        let owner = ledger.open("snow");
        assert!(ledger.begin(Some(owner)));
        std::thread::sleep(Duration::from_millis(2));
        ledger.finish(Phase::Step);
        let first = ledger.times()[0].clone();
        assert!(first.step_ms >= 2.0 && first.frame_ms == 0.0 && first.is_slow(), "{first:?}");
        // Steps and frames in which it does nothing.
        for _ in 0..100 {
            ledger.finish(Phase::Step);
            ledger.finish(Phase::Frame);
        }
        let later = ledger.times()[0].clone();
        assert!(later.step_ms < 1e-3 * first.step_ms && later.frame_ms == 0.0, "{later:?}");
    }
}
