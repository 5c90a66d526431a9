//! The process that makes the steps of a case, one after the other: they share the scan and its lumen.
//!
//! It reads a request on each line of its standard input and answers each with a line on its standard output, both as JSON. It ends when
//! its input ends, also in the middle of a step: whoever asked is gone.

use std::ffi::OsString;
use std::io::{BufRead, stdin};
use std::process::exit;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::thread;

use serde::{Deserialize, Serialize};

use crate::cli::messages::print;
use crate::cli::shared::Shared;
use crate::error::{Error, Kind, Result};
use crate::{memory, output};

/// What precedes an answer, so that nothing else is taken for one.
pub(super) const ANSWER: &str = "answer: ";

/// What a worker is asked for: a command line, without the program's name.
#[derive(Debug, Deserialize, Serialize)]
pub(super) enum Request {
    /// What a scan is: that of `info`'s input.
    Look(Vec<OsString>),
    /// A command.
    Run(Vec<OsString>),
}

/// What became of a request.
#[derive(Clone, Debug, Default, Deserialize, Serialize, PartialEq, Eq)]
pub(super) struct Answer {
    /// The exit status.
    pub status: u8,
    /// The error, if the status is not 0.
    pub line: String,
    /// What was looked at.
    pub seen: Option<Seen>,
}

/// A scan.
#[derive(Clone, Debug, Default, Deserialize, Serialize, PartialEq, Eq)]
pub(in crate::cli) struct Seen {
    /// Hash of its voxels and grid, whatever the format.
    pub content: String,
    /// Number of voxels.
    pub voxels: u64,
}

/// What a worker does: functions of a command line, which share what they find.
pub(in crate::cli) struct Work<'a> {
    pub look: &'a dyn Fn(Vec<OsString>, &Shared) -> Result<Seen>,
    pub perform: &'a dyn Fn(Vec<OsString>, &Shared) -> Result<()>,
}

/// Answers requests until there are no more. Fails with status 5 if it cannot answer.
pub(in crate::cli) fn run(work: &Work<'_>) -> Result<()> {
    let busy = Arc::new(AtomicBool::new(false));
    let (to, requests) = mpsc::channel();
    let is_busy = Arc::clone(&busy);
    // It never ends while the input is open.
    thread::spawn(move || {
        for line in stdin().lock().lines().map_while(std::io::Result::ok) {
            is_busy.store(true, Ordering::SeqCst);
            let _ = to.send(line);
        }
        if is_busy.load(Ordering::SeqCst) {
            output::abandon_temporary();
            exit(Kind::Incomplete as i32);
        }
    });
    let shared = Shared::keeping();
    for line in requests {
        memory::reset_peak();
        let answer = answer(&line, work, &shared);
        let text = serde_json::to_string(&answer)
            .map_err(|e| Error::fault("worker", e.to_string(), "report it").caused_by(e))?;
        busy.store(false, Ordering::SeqCst);
        print(|out| {
            writeln!(out, "{ANSWER}{text}")?;
            out.flush()
        })?;
    }
    Ok(())
}

fn answer(line: &str, work: &Work<'_>, shared: &Shared) -> Answer {
    let mut seen = None;
    let outcome = match serde_json::from_str(line) {
        Ok(Request::Look(line)) => (work.look)(line, shared).map(|found| seen = Some(found)),
        Ok(Request::Run(line)) => (work.perform)(line, shared),
        Err(e) => Err(Error::fault("worker", format!("was asked for something unknown: {e}"), "report it")),
    };
    // What is not kept goes back to the system before the next step.
    memory::release();
    match outcome {
        Ok(()) => Answer { status: 0, line: String::new(), seen },
        Err(e) => Answer { status: e.kind as u8, line: e.to_string().replace(char::is_control, " "), seen: None },
    }
}
