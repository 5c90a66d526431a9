//! The command line: arguments to calls, results to files and exit status.

pub mod args;
mod info;
mod phantom;
mod segment;

use std::process::ExitCode;
use std::sync::Arc;

use clap::Parser;

use crate::error::{Error, Result};
use crate::progress::Progress;
use args::{Args, Command};

/// Runs the program and returns its exit status. Every failure prints exactly one line beginning `error: `.
pub fn main() -> ExitCode {
    let args = match Args::try_parse() {
        Ok(args) => args,
        Err(e) => return args::refuse(&e),
    };
    match run(args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("error: {e}");
            ExitCode::from(e.kind as u8)
        }
    }
}

fn run(args: Args) -> Result<()> {
    let progress = Arc::new(Progress::new());
    let on_interrupt = Arc::clone(&progress);
    ctrlc::set_handler(move || {
        // The second Ctrl-C ends at once: files are whole or absent in any case.
        if on_interrupt.is_cancelled() {
            std::process::exit(4);
        }
        on_interrupt.cancel();
    })
    .map_err(|e| Error::fault("interrupt handler", e.to_string(), "run it again"))?;
    let global = args.global;
    if let Some(n) = global.threads {
        rayon::ThreadPoolBuilder::new()
            .num_threads(n)
            .build_global()
            .map_err(|e| Error::fault("--threads", e.to_string(), "use fewer threads"))?;
    }
    match args.command {
        Some(Command::Info(a)) => info::run(&a, &global, &progress),
        Some(Command::Phantom(a)) => phantom::run(&a, &global, &progress),
        Some(Command::Segment(a)) => segment::run(&a, &global, &progress),
        _ => Err(Error::not_built("this command")),
    }
}
