//! The command line: arguments to calls, results to files and exit status.

pub mod args;
mod centerline;
mod explain;
mod fly;
mod info;
mod phantom;
mod plane;
mod prepare;
mod render;
mod report;
mod segment;
mod values;

use std::process::ExitCode;
use std::sync::Arc;

use clap::Parser;

use crate::error::{Error, Result};
use crate::host::terminal::Bar;
use crate::progress::Progress;
use args::{Args, Command};

/// Runs the program and returns its exit status. Every failure prints exactly one line beginning `error: `.
pub fn main() -> ExitCode {
    let args = match Args::try_parse_from(args::command_first(std::env::args_os())) {
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
    // A flight shows its own progress: a window, or a bar that goes before the last word.
    let _bar = match args.command {
        Some(Command::Info(_) | Command::Phantom(_) | Command::Segment(_) | Command::Centerline(_)) => {
            Some(Bar::show(&progress))
        }
        _ => None,
    };
    match args.command {
        Some(Command::Info(a)) => info::run(&a, &global, &progress),
        Some(Command::Phantom(a)) => phantom::run(&a, &global, &progress),
        Some(Command::Segment(a)) => segment::run(&a, &global, &progress),
        Some(Command::Fly(a)) => fly::run(&a, &global, &progress),
        Some(Command::Render(a)) => render::run(&a, &global, &progress),
        Some(Command::Explain(a)) => explain::run(&a, &global, &progress),
        Some(Command::Centerline(a)) => centerline::run(&a, &global, &progress),
        Some(Command::Plane(a)) => plane::run(&a, &progress),
        Some(Command::Report(a)) => report::run(&a, &global, &progress),
        None => fly::run(&args.fly, &global, &progress),
    }
}

/// Writes to standard output; a reader that has seen enough (`colvis … | head -1`) is no failure.
fn print(write: impl FnOnce(&mut dyn std::io::Write) -> std::io::Result<()>) -> Result<()> {
    match write(&mut std::io::stdout().lock()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Error::new(crate::error::Kind::Output, "standard output", e.to_string(), "free some space"))
        }
        _ => Ok(()),
    }
}
