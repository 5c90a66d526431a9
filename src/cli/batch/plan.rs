//! What each case is expected to take: for the queue, and for whatever runs cases on other machines.

use std::io;
use std::path::Path;

use serde::Serialize;
use sha2::{Digest, Sha256};

use super::manifest::Case;
use super::queue::{self, MEMORY, Queue, TIME, Waiting};
use super::record::{self, Class, Folder, Input, Record, State};
use super::steps::Step;
use super::work;
use crate::cli::messages::print;
use crate::error::Result;

/// What was recorded of a case, in short: a list may have many.
#[derive(Clone, Copy)]
struct Before {
    state: State,
    /// The class of its failure.
    class: Option<Class>,
    /// Whether its files were packed, their bytes, and the memory that it took, bytes; 0 if unknown.
    took: (bool, u64, u64),
    /// The time that it took, ms; 0 if unknown.
    ms: u64,
}

impl Before {
    fn of(case: &Case, record: &Record) -> Self {
        Self {
            state: record.state,
            class: record.failure.as_ref().map(|f| f.class),
            took: (queue::is_packed(&case.path), record.input.bytes, peak(record)),
            ms: ms(record),
        }
    }
}

/// What is known of a case before it is run.
pub(super) struct Expected {
    before: Option<Before>,
    seen: Input,
    /// Bytes.
    pub memory: u64,
    pub ms: u64,
}

/// What the cases of a run are found to take while it runs.
pub(super) struct Learning<'a> {
    cases: &'a [Case],
    expected: Vec<Expected>,
    /// Whether a case's files were packed, their bytes, and the memory that it took.
    took: Vec<(bool, u64, u64)>,
    /// True for cases that make way for others: what they took is known.
    known: Vec<bool>,
}

impl<'a> Learning<'a> {
    pub(super) fn new(cases: &'a [Case], out: &Path) -> Self {
        let expected = expected(cases, out);
        let known: Vec<bool> = expected.iter().map(|e| e.before.is_some_and(|b| b.took.2 > 0)).collect();
        let took = expected.iter().filter_map(|e| e.before.map(|b| b.took)).collect();
        Self { cases, expected, took, known }
    }

    /// Returns the cases as they wait.
    pub(super) fn waiting(&self) -> Vec<Waiting> {
        self.expected.iter().enumerate().map(|(case, e)| Waiting { case, memory: e.memory }).collect()
    }

    /// Notes what a case took that has ended, and corrects what those like it are expected to take.
    pub(super) fn learn(&mut self, case: usize, out: &Path, queue: &mut Queue) {
        let Some(record) = Folder::new(out, &self.cases[case].id).record() else { return };
        self.took.push(Before::of(&self.cases[case], &record).took);
        let need = MEMORY.learn(self.took.iter().copied());
        let of = |n: usize| need.expected(&self.cases[n].path, self.expected[n].seen.bytes);
        queue.correct(|n| (!self.known[n]).then(|| of(n)));
    }

    /// Notes that a case took more than expected: what others take no longer tells of it.
    pub(super) fn exceed(&mut self, case: usize) {
        self.known[case] = true;
    }
}

/// A case of `--plan`.
#[derive(Serialize)]
struct Row<'a> {
    id: &'a str,
    /// `null` if it was never run.
    state: Option<State>,
    /// The class of its failure.
    class: Option<Class>,
    memory_bytes: u64,
    seconds: f64,
    /// Changes with all that decides whether there is something to do: the version, the steps, the options with their files, and the scan
    /// as far as its files show without being read.
    key: String,
}

/// Returns what each case is expected to take. What it took before counts most; what the others took, next.
pub(super) fn expected(cases: &[Case], out: &Path) -> Vec<Expected> {
    let before: Vec<_> =
        cases.iter().map(|c| Folder::new(out, &c.id).record().map(|record| Before::of(c, &record))).collect();
    let known = || before.iter().flatten();
    let memory = MEMORY.learn(known().map(|b| b.took));
    let time = TIME.learn(known().map(|b| (b.took.0, b.took.1, b.ms)));
    let of = |(case, before): (&Case, &Option<Before>)| {
        let seen = record::seen(&case.path);
        let took = |took: fn(&Before) -> u64| before.as_ref().map(took).filter(|&t| t > 0);
        let memory = took(|b| b.took.2).unwrap_or_else(|| memory.expected(&case.path, seen.bytes));
        let ms = took(|b| b.ms).unwrap_or_else(|| time.expected(&case.path, seen.bytes));
        Expected { before: *before, seen, memory, ms }
    };
    cases.iter().zip(&before).map(of).collect()
}

/// The most memory that a step took, bytes; 0 if unknown.
fn peak(record: &Record) -> u64 {
    record.steps.values().filter_map(|m| m.times.get("peak_rss_bytes")?.as_u64()).max().unwrap_or(0)
}

/// The time of all steps, ms; 0 if unknown.
fn ms(record: &Record) -> u64 {
    (record.steps.values().filter_map(|m| m.times.get("seconds")?.as_f64()).sum::<f64>() * 1e3) as u64
}

/// Prints the plan as JSON.
pub(super) fn tell(cases: &[Case], out: &Path, steps: &[Step]) -> Result<()> {
    let expected = expected(cases, out);
    let rows = cases.iter().zip(&expected).map(|(case, e)| Row {
        id: &case.id,
        state: e.before.map(|b| b.state),
        class: e.before.and_then(|b| b.class),
        memory_bytes: e.memory,
        seconds: e.ms as f64 / 1e3,
        key: key(case, &e.seen, steps),
    });
    let rows: Vec<Row<'_>> = rows.collect();
    print(|to| {
        serde_json::to_writer(&mut *to, &rows).map_err(io::Error::from)?;
        writeln!(to)
    })
}

fn key(case: &Case, seen: &Input, steps: &[Step]) -> String {
    let seen = format!("{} {} {} {:?}", seen.files, seen.bytes, seen.modified_ns, work::read_with(case));
    let mut hash = Sha256::new();
    for step in steps {
        // An option's file that cannot be read is a failure that changes when the file is there.
        let key = record::key(*step, &seen, case.series.as_deref(), &case.options);
        hash.update(key.unwrap_or_else(|e| e.to_string()));
    }
    record::hex(&hash.finalize())
}
