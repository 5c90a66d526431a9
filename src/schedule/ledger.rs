//! Run times and faults of plug-ins.
//!
//! While systems run, each system's run condition identifies its owner ([`Ledger::begin`]), and time is booked to that
//! owner. A panic is reported with the owner's name, since each owner's systems are in a separate set. An owner that has
//! panicked is switched off and its systems no longer run. A flight without plug-ins has no such conditions.

use std::cell::RefCell;
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
}

/// A panic or failure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Fault {
    /// The subject: a system's full name, or the name that was reported.
    pub what: String,
    /// The cause: `panicked: …` with the panic's message.
    pub why: String,
}

/// Reports a panic in a part of a plug-in that was caught.
///
/// It ends the current step or frame with an error, and a headless flight in an orderly way. `what` names the part, for
/// example `preset distance`.
pub fn report_fault(what: impl Into<String>, why: impl Into<String>) {
    let fault = Fault { what: what.into(), why: format!("panicked: {}", why.into()) };
    FAULTS.with_borrow_mut(|faults| faults.push(fault));
}

/// Shows the user a message about a plug-in, once for each pair of `who` and `what`.
pub fn note(who: impl Into<String>, what: impl Into<String>) {
    NOTES.with_borrow_mut(|notes| notes.push((who.into(), what.into())));
}

/// Handles systems that fail in the world.
pub(super) fn system_failed(error: BevyError, context: ErrorContext) {
    let mut error = error;
    let why = match error.take_payload() {
        Some(payload) => format!("panicked: {}", panic_text(&*payload)),
        None => format!("failed: {error}"),
    };
    let what = match context {
        ErrorContext::RunCondition { system, .. } => system.to_string(),
        other => other.name().to_string(),
    };
    let fault = Fault { what, why };
    FAULTS.with_borrow_mut(|faults| faults.push(fault));
}

/// Books the time that a renderer, an overlay or a presenter of another crate took in this frame, under its name.
pub fn book_time(name: impl Into<String>, ms: f64) {
    TIMES.with_borrow_mut(|times| *times.entry(name.into()).or_default() += ms);
}

pub(super) fn take_times() -> BTreeMap<String, f64> {
    TIMES.take()
}

pub(super) fn take_faults() -> Vec<Fault> {
    FAULTS.take()
}

pub(super) fn take_notes() -> Vec<(String, String)> {
    NOTES.take()
}

/// Run time of a plug-in.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
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
    /// The limits are more than an eighth of the time between two steps, or a fifth of that between two frames at sixty
    /// per second.
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
        let mut book = self.book();
        book.close();
        let Some(owner) = owner else { return true };
        let on = book.accounts.get(owner).is_some_and(|a| !a.off);
        if on {
            book.since = Some((owner, Instant::now()));
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
