//! What plug-ins take, and what has gone wrong in them.
//!
//! While systems run, a system's run condition says whose it is ([`Ledger::begin`]), and time is booked to its owner. A panic is
//! told with the owner's name: each owner's systems are in a set of their own. An owner that has panicked is switched off: its systems do not run any more. A flight
//! without plug-ins has no such conditions.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use bevy_ecs::error::{BevyError, ErrorContext};

use super::Phase;
use crate::error::Error;
use crate::panics::panic_text;

thread_local! {
    /// What went wrong on this thread since it was last asked for.
    static FAULTS: RefCell<Vec<Fault>> = const { RefCell::new(Vec::new()) };
    /// What makers of pictures have taken on this thread since it was last asked for, ms.
    static TIMES: RefCell<BTreeMap<String, f64>> = const { RefCell::new(BTreeMap::new()) };
    /// What is to be said to the user: who, and what of it.
    static NOTES: RefCell<Vec<(String, String)>> = const { RefCell::new(Vec::new()) };
}

/// Something that panicked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Fault {
    /// What it is: a system's full name, or what was reported.
    pub what: String,
    /// What happened: `panicked: …`, with what the panic said.
    pub why: String,
}

/// Reports that something of a plug-in has panicked and was caught: it ends the step or the frame under way with an error, and
/// a headless flight in order. `what` names it, for example `preset distance`.
pub fn report_fault(what: impl Into<String>, why: impl Into<String>) {
    let fault = Fault { what: what.into(), why: format!("panicked: {}", why.into()) };
    FAULTS.with_borrow_mut(|faults| faults.push(fault));
}

/// Says something about a plug-in to the user, once for each `who` and `what`.
pub fn note(who: impl Into<String>, what: impl Into<String>) {
    NOTES.with_borrow_mut(|notes| notes.push((who.into(), what.into())));
}

/// The world's handler for systems that fail.
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

/// Books what a renderer, an overlay or a presenter of another crate has taken in this frame, by its name.
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

/// What a plug-in takes.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct PluginTime {
    /// Its name.
    pub name: String,
    /// Milliseconds of a step.
    pub step_ms: f64,
    /// Milliseconds of a frame.
    pub frame_ms: f64,
}

impl PluginTime {
    /// Whether it holds the flight up: by more than an eighth of the time between two steps, or a fifth of that between two
    /// frames of sixty a second.
    pub fn is_slow(&self) -> bool {
        self.step_ms > 1.0 || self.frame_ms > 3.3
    }

    /// As a person reads it: "plug-in snow takes 12.0 ms a step, 0.3 ms a frame".
    pub fn text(&self) -> String {
        format!("plug-in {} takes {:.1} ms a step, {:.1} ms a frame", self.name, self.step_ms, self.frame_ms)
    }
}

/// A plug-in, or a guide of another crate.
#[derive(Clone, Debug)]
struct Account {
    name: String,
    off: bool,
    /// Milliseconds of the step or frame under way.
    now: f64,
    /// Milliseconds of a step and of a frame, the newest counting most.
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

/// The owners of systems, and their times.
#[derive(Debug, Default)]
pub(super) struct Ledger(Mutex<PluginAccounts>);

impl Ledger {
    fn book(&self) -> MutexGuard<'_, PluginAccounts> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// An account for an owner; the one that is there if it has one.
    pub fn open(&self, name: &str) -> usize {
        let mut book = self.book();
        if let Some(n) = book.accounts.iter().position(|a| a.name == name) {
            book.accounts[n].off = false;
            return n;
        }
        book.accounts.push(Account { name: name.to_owned(), off: false, now: 0.0, usual: [None; 2] });
        book.accounts.len() - 1
    }

    /// A system of `owner` (none: this crate's) is about to run; whether it may.
    pub fn begin(&self, owner: Option<usize>) -> bool {
        let mut book = self.book();
        book.close();
        let Some(owner) = owner else { return true };
        let on = book.accounts.get(owner).is_some_and(|a| !a.off);
        if on {
            book.since = Some((owner, Instant::now()));
        }
        on
    }

    /// All systems of a phase have run.
    pub fn finish(&self, phase: Phase) {
        let mut book = self.book();
        book.close();
        for account in &mut book.accounts {
            let now = std::mem::take(&mut account.now);
            let usual = &mut account.usual[phase as usize];
            *usual = Some(usual.map_or(now, |u| u + (now - u) * 0.1));
        }
    }

    /// Switches an owner's systems off; its name, and whether they were on.
    pub fn switch_off(&self, owner: usize) -> Option<(String, bool)> {
        let mut book = self.book();
        let account = book.accounts.get_mut(owner)?;
        let on = !std::mem::replace(&mut account.off, true);
        Some((account.name.clone(), on))
    }

    /// How many owners there are.
    pub fn owners(&self) -> usize {
        self.book().accounts.len()
    }

    /// Whether an owner's systems are switched off.
    pub fn is_off(&self, name: &str) -> bool {
        self.book().accounts.iter().any(|a| a.off && a.name == name)
    }

    /// What each owner takes.
    pub fn times(&self) -> Vec<PluginTime> {
        let time = |a: &Account| {
            let [step_ms, frame_ms] = a.usual.map(|u| u.unwrap_or(0.0));
            PluginTime { name: a.name.clone(), step_ms, frame_ms }
        };
        self.book().accounts.iter().map(time).collect()
    }
}

/// The error that a fault of `name` is.
pub(super) fn fault_error(name: Option<String>, fault: &Fault) -> Error {
    let what = match name {
        Some(name) => format!("plug-in {name} ({})", fault.what),
        None => fault.what.clone(),
    };
    Error::fault(what, fault.why.clone(), "fix it, or fly without it")
}
