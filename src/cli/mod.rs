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
mod surface;
mod unbuilt;
mod values;

use std::any::Any;
use std::io::IsTerminal;
use std::panic::{self, AssertUnwindSafe, PanicHookInfo, catch_unwind};
use std::process::ExitCode;
use std::sync::{Arc, Mutex, PoisonError};

use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};

use crate::app::{Catalog, Overlay};
use crate::error::{Error, Result};
use crate::fence::is_fenced;
use crate::host::terminal::Bar;
use crate::output;
use crate::progress::Progress;
use crate::render::{CameraModel, Preset};
use crate::schedule::{Guide, Plugin};
use args::{Args, Command};

/// The program `colvis`, with whatever another program adds to it.
///
/// ```no_run
/// # use colvis::dynamics::Body;
/// # use colvis::schedule::{App, Guide};
/// # #[derive(Clone, Debug, Default, serde::Deserialize)]
/// # struct Drift {}
/// # impl Guide for Drift {
/// #     const NAME: &'static str = "drift";
/// #     const SUMMARY: &'static str = "drifts";
/// #     fn cruise_mm_s(&self, _: &Body) -> f64 { 0.0 }
/// #     fn plug(&self, _: &mut App) -> colvis::error::Result<()> { Ok(()) }
/// # }
/// fn main() -> std::process::ExitCode {
///     colvis::cli::Program::default().guide::<Drift>().run() // has `--guide drift`, too
/// }
/// ```
#[derive(Clone, Debug, Default)]
pub struct Program {
    catalog: Catalog,
}

impl Program {
    /// Adds a guide: to `--guide`, scene files, the keys and their help, `explain`.
    #[must_use]
    pub fn guide<G: Guide>(self) -> Self {
        Self { catalog: self.catalog.guide::<G>() }
    }

    /// Adds a renderer: to `--preset`, scene files, `explain`.
    #[must_use]
    pub fn preset(self, preset: Preset) -> Self {
        Self { catalog: self.catalog.preset(preset) }
    }

    /// Adds a camera: to `--camera`.
    #[must_use]
    pub fn camera(self, camera: CameraModel) -> Self {
        Self { catalog: self.catalog.camera(camera) }
    }

    /// Adds an overlay to the window, with its key and its row of help.
    #[must_use]
    pub fn overlay(self, overlay: Overlay) -> Self {
        Self { catalog: self.catalog.overlay(overlay) }
    }

    /// Adds a plug-in to every flight: in the window, headless, in `explain` and in `report scenes`.
    ///
    /// One whose name is taken is refused when the program runs.
    #[must_use]
    pub fn plugin(self, plugin: impl Plugin) -> Self {
        Self { catalog: self.catalog.plugin(plugin) }
    }

    /// Runs the program and returns its exit status. Every failure prints exactly one line beginning `error: `.
    pub fn run(self) -> ExitCode {
        let args = match Args::read(std::env::args_os(), &self.catalog) {
            Ok(args) => args,
            Err(e) => return args::refuse(&e),
        };
        match guarded(|| run(&self, args)) {
            Ok(()) => ExitCode::SUCCESS,
            Err(e) => {
                eprintln!("error: {e}");
                ExitCode::from(e.kind as u8)
            }
        }
    }
}

/// What is called for every panic.
type PanicHook = Box<dyn Fn(&PanicHookInfo<'_>) + Sync + Send>;

/// Where the first panic happened that no fence caught.
static PANICKED_AT: Mutex<Option<String>> = Mutex::new(None);

/// Does the program's work; a panic is a fault of its own, told like any other.
fn guarded(work: impl FnOnce() -> Result<()>) -> Result<()> {
    panic::set_hook(noting(panic::take_hook()));
    let place = || PANICKED_AT.lock().unwrap_or_else(PoisonError::into_inner).clone();
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| Err(panicked(&*panic, place().as_deref())))
}

/// The program's panic hook: it notes where the first panic happened and prints nothing, or what `usual` prints if
/// `RUST_BACKTRACE` is set. Of a panic that a [fence](crate::fence) catches it takes no note.
fn noting(usual: PanicHook) -> PanicHook {
    Box::new(move |info| {
        if is_fenced() {
            return;
        }
        // The first is the one to report: what others do in its wake says less.
        let place = || info.location().map_or_else(String::new, ToString::to_string);
        PANICKED_AT.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert_with(place);
        if std::env::var_os("RUST_BACKTRACE").is_some() {
            usual(info);
        }
    })
}

/// The fault that a panic stands for, which happened at `place`.
fn panicked(panic: &(dyn Any + Send), place: Option<&str>) -> Error {
    let text = panic.downcast_ref::<&str>().copied().or_else(|| panic.downcast_ref::<String>().map(String::as_str));
    let at = place.map_or_else(String::new, |p| format!(" ({p})"));
    Error::fault("colvis", format!("{}{at}", text.unwrap_or("panicked")), "report it, with the command")
}

fn run(program: &Program, args: Args) -> Result<()> {
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
    prepare::check(program, &global)?;
    let _crew = crew(global.threads)?;
    // A flight shows its own progress: a window, or a bar that goes before the last word.
    let _bar = match args.command {
        Some(
            Command::Info(_) | Command::Phantom(_) | Command::Segment(_) | Command::Surface(_) | Command::Centerline(_),
        ) => Some(Bar::show(&progress)),
        _ => None,
    };
    match args.command {
        Some(Command::Info(a)) => info::run(&a, &global, &progress),
        Some(Command::Phantom(a)) => phantom::run(&a, &global, &progress),
        Some(Command::Segment(a)) => segment::run(&a, &global, &progress),
        Some(Command::Surface(a)) => surface::run(&a, &global, &progress),
        Some(Command::Fly(a)) => fly::run(program, &a, &global, &progress),
        Some(Command::Render(a)) => render::run(program, &a, &global, &progress),
        Some(Command::Explain(a)) => explain::run(program, &a, &global, &progress),
        Some(Command::Centerline(a)) => centerline::run(&a, &global, &progress),
        Some(Command::Plane(a)) => plane::run(&a, &progress),
        Some(Command::Report(a)) => report::run(program, &a, &global, &progress),
        None => fly::run(program, &args.fly, &global, &progress),
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
    use crate::fence;

    #[test]
    fn a_fenced_panic_is_not_the_one_reported() {
        let _hook = fence::HOOK.lock().unwrap_or_else(PoisonError::into_inner);
        let usual = Arc::new(panic::take_hook());
        let mine = std::thread::current().id();
        let (note, others) = (noting(Box::new(|_| {})), Arc::clone(&usual));
        panic::set_hook(Box::new(
            move |info| if std::thread::current().id() == mine { note(info) } else { others(info) },
        ));
        let place = || PANICKED_AT.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let caught = fence::fenced(|| panic!("a decoder's"));
        let after_fence = place();
        let escaped = catch_unwind(|| panic!("the program's"));
        panic::set_hook(Box::new(move |info| usual(info)));
        assert!(caught == Err::<(), _>(fence::Panicked) && escaped.is_err());
        assert_eq!(after_fence, None);
        assert!(place().is_some_and(|p| p.contains(file!())), "{:?}", place());
    }

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
