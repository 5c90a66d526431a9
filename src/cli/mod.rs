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

use std::any::Any;
use std::io::IsTerminal;
use std::panic::{self, AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;
use std::sync::{Arc, Mutex, PoisonError};

use clap::Parser;
use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};

use crate::error::{Error, Result};
use crate::host::terminal::Bar;
use crate::output;
use crate::progress::Progress;
use args::{Args, Command};

/// Runs the program and returns its exit status. Every failure prints exactly one line beginning `error: `.
pub fn main() -> ExitCode {
    let args = match Args::try_parse_from(args::command_first(std::env::args_os())) {
        Ok(args) => args,
        Err(e) => return args::refuse(&e),
    };
    match guarded(|| run(args)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("error: {e}");
            ExitCode::from(e.kind as u8)
        }
    }
}

/// Does the program's work; a panic is a fault of its own, told like any other.
fn guarded(work: impl FnOnce() -> Result<()>) -> Result<()> {
    static PLACE: Mutex<Option<String>> = Mutex::new(None);
    let place = || PLACE.lock().unwrap_or_else(PoisonError::into_inner);
    let usual = panic::take_hook();
    panic::set_hook(Box::new(move |info| {
        // The first is the one to report: what others do in its wake says less.
        place().get_or_insert_with(|| info.location().map_or_else(String::new, ToString::to_string));
        if std::env::var_os("RUST_BACKTRACE").is_some() {
            usual(info);
        }
    }));
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| Err(panicked(&*panic, place().as_deref())))
}

/// The fault that a panic stands for, which happened at `place`.
fn panicked(panic: &(dyn Any + Send), place: Option<&str>) -> Error {
    let text = panic.downcast_ref::<&str>().copied().or_else(|| panic.downcast_ref::<String>().map(String::as_str));
    let at = place.map_or_else(String::new, |p| format!(" ({p})"));
    Error::fault("colvis", format!("{}{at}", text.unwrap_or("panicked")), "report it, with the command")
}

fn run(args: Args) -> Result<()> {
    let progress = Arc::new(Progress::new());
    let on_interrupt = Arc::clone(&progress);
    ctrlc::set_handler(move || {
        // The second Ctrl-C ends at once: files are whole or absent in any case.
        if on_interrupt.is_cancelled() {
            output::remove_temporary();
            if std::io::stderr().is_terminal() {
                // A progress bar may stand on the line.
                eprintln!();
            }
            let e = Error::cancelled("colvis");
            eprintln!("error: {e}");
            std::process::exit(e.kind as i32);
        }
        on_interrupt.cancel();
    })
    .map_err(|e| Error::fault("interrupt handler", e.to_string(), "run it again"))?;
    let global = args.global;
    let _crew = crew(global.threads)?;
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

/// Makes this thread one of the `threads` (by default one for each processor) among which its work is parted.
///
/// rayon's common pool would take the work from it and wake all of its own threads, two of which the system often sets on
/// one processor for some milliseconds: a frame of 6 ms then takes 12. Threads beside this one, which load or plan, keep the
/// common pool, so that no frame waits for them.
fn crew(threads: Option<usize>) -> Result<ThreadPool> {
    let fault = |e: ThreadPoolBuildError| Error::fault("--threads", e.to_string(), "use fewer threads");
    if let Some(n) = threads {
        ThreadPoolBuilder::new().num_threads(n).build_global().map_err(fault)?;
    }
    ThreadPoolBuilder::new().num_threads(threads.unwrap_or(0)).use_current_thread().build().map_err(fault)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_one_line_and_a_fault() {
        let told = |panic: Box<dyn Any + Send>, place| panicked(&*panic, place);
        let e = told(Box::new("no\nvoxel"), Some("src/a.rs:3:5"));
        assert_eq!(e.to_string(), "colvis: no voxel (src/a.rs:3:5); report it, with the command");
        assert_eq!(e.kind as u8, 1);
        let e = told(Box::new("index 7".to_owned()), None);
        assert_eq!(e.why, "index 7");
        assert_eq!(told(Box::new(7), None).why, "panicked");
    }
}
