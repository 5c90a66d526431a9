//! The command line: arguments to calls, results to files and exit status.

#[cfg(feature = "dicom")]
mod archive;
pub mod args;
mod batch;
mod candidates;
mod case;
mod centerline;
mod cleanse;
mod colon;
mod dataset;
mod explain;
mod files;
mod fly;
mod info;
mod intrinsics;
mod matching;
mod measure;
mod messages;
mod outside;
mod own;
mod pair;
mod phantom;
mod phantom_args;
mod plane;
mod prepare;
mod render;
#[cfg(feature = "report")]
mod report;
mod segment;
mod shared;
mod slice;
mod surface;
mod unfold;
mod values;

use std::any::Any;
use std::ffi::OsString;
use std::io::IsTerminal;
use std::panic::{self, AssertUnwindSafe, PanicHookInfo, catch_unwind};
use std::process::ExitCode;
use std::sync::{Arc, Mutex, MutexGuard, Once, PoisonError};

use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};

use crate::app::{Catalog, Overlay};
use crate::error::{Error, Result};
use crate::host::terminal::Bar;
#[cfg(feature = "window")]
use crate::host::window::panels::{ActionEntry, PanelEntry};
use crate::output;
use crate::panics::{is_catching, note_place};
use crate::polyps::Detector;
use crate::progress::Progress;
use crate::render::{CameraModel, Preset, ShaderModel};
#[cfg(feature = "window")]
use crate::schedule::Guides;
use crate::schedule::{Guide, Look, Plugin};
use args::{Args, Command, SeriesChoice};
pub use clap;
use files::Files;
use messages::{failed, print, print_failure};
use own::OwnCommand;
pub use own::{ProgressBar, Session};
use shared::Shared;

/// The program `colvis`, with everything that another program adds to it.
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
///
/// | method | adds | reached by |
/// |---|---|---|
/// | [`guide`](Self::guide) | a navigation method | `--guide`, its key, scene files |
/// | [`preset`](Self::preset) | a renderer | `--preset`, `[render] preset` |
/// | [`camera`](Self::camera) | a camera model | `--camera`, `[render] camera` |
/// | [`shader`](Self::shader) | shading of the wall | `[render] shade` |
/// | [`look`](Self::look) | where the camera looks | `[view] look` |
/// | [`overlay`](Self::overlay) | marks over the picture | its key, `fly --overlay` |
/// | `panel` | a part of the window | its key, the menu |
/// | `action` | an action in the window | its key, the menu, panels |
/// | [`detector`](Self::detector) | a method that finds polyps | `--detector` of `candidates` and `fly`, `report candidates` |
/// | [`plugin`](Self::plugin) | systems, views, post-processes | every flight |
/// | [`command`](Self::command) | a command | its name |
///
/// Guides, presets, cameras, shaders, overlays and plug-ins may have settings in a scene file, in a table with their name
/// (`[overlay.NAME]` for an overlay). Duplicate names and keys are refused when the program runs.
#[derive(Clone, Debug, Default)]
pub struct Program {
    catalog: Catalog,
    commands: Vec<OwnCommand>,
    #[cfg(feature = "window")]
    panels: Vec<PanelEntry>,
    #[cfg(feature = "window")]
    actions: Vec<ActionEntry>,
}

impl Program {
    /// Adds a guide: to `--guide`, scene files, the keys and their help, `explain`.
    #[must_use]
    pub fn guide<G: Guide>(self) -> Self {
        Self { catalog: self.catalog.guide::<G>(), ..self }
    }

    /// Adds a renderer: to `--preset`, scene files, `explain`.
    #[must_use]
    pub fn preset(self, preset: Preset) -> Self {
        Self { catalog: self.catalog.preset(preset), ..self }
    }

    /// Adds a camera: to `--camera`, scene files.
    #[must_use]
    pub fn camera(self, camera: CameraModel) -> Self {
        Self { catalog: self.catalog.camera(camera), ..self }
    }

    /// Adds a shader: to `[render] shade` in scene files.
    #[must_use]
    pub fn shader(self, shader: ShaderModel) -> Self {
        Self { catalog: self.catalog.shader(shader), ..self }
    }

    /// Adds an overlay to the window, with its key and its row of help.
    #[must_use]
    pub fn overlay(self, overlay: Overlay) -> Self {
        Self { catalog: self.catalog.overlay(overlay), ..self }
    }

    /// Adds a choice of where the camera looks: to `[view] look` of scene files.
    #[must_use]
    pub fn look(self, look: Look) -> Self {
        Self { catalog: self.catalog.look(look), ..self }
    }

    /// Adds a detector of polyps: to `--detector` of `candidates` and of the window, and to `report candidates`, which measures
    /// it beside the others.
    #[must_use]
    pub fn detector(self, detector: Detector) -> Self {
        Self { catalog: self.catalog.detector(detector), ..self }
    }

    /// Adds a panel to the window: to its menu, with the key that shows and hides it and its row of help.
    ///
    /// A duplicate name or key is refused when the program runs.
    #[cfg(feature = "window")]
    #[must_use]
    pub fn panel(mut self, panel: PanelEntry) -> Self {
        self.panels.push(panel);
        self
    }

    /// Adds an action to the window: to its menu *Flight*, with its key and its row of help, to the settings file, and for panels.
    ///
    /// A duplicate id or key is refused when the program runs.
    #[cfg(feature = "window")]
    #[must_use]
    pub fn action(mut self, action: ActionEntry) -> Self {
        self.actions.push(action);
        self
    }

    /// All panels of the window.
    #[cfg(feature = "window")]
    fn all_panels(&self) -> Vec<PanelEntry> {
        crate::host::window::panels::BUILT_IN.iter().chain(&self.panels).copied().collect()
    }

    /// The window's keys and their actions; empty in builds without a window.
    fn key_help(&self) -> Result<Vec<(String, String)>> {
        #[cfg(feature = "window")]
        return crate::host::window::key_help(
            &self.catalog.guides,
            &self.catalog.overlays,
            &self.all_panels(),
            &self.actions,
        );
        #[cfg(not(feature = "window"))]
        Ok(Vec::new())
    }

    /// The window's keys by groups, as its list shows them.
    fn key_page(&self) -> Result<String> {
        #[cfg(feature = "window")]
        return crate::host::window::key_page(
            &self.catalog.guides,
            &self.catalog.overlays,
            &self.all_panels(),
            &self.actions,
        );
        #[cfg(not(feature = "window"))]
        Err(Error::usage("--help keys", "this build has no window", "build it with the feature window"))
    }

    /// Id, keys and text of every action of a window with these guides, with the user's keys, and the error in the user's settings.
    #[cfg(feature = "window")]
    fn action_list(&self, guides: &Guides) -> Result<(Vec<[String; 3]>, Option<Error>)> {
        crate::host::window::action_list(guides, &self.catalog.overlays, &self.all_panels(), &self.actions)
    }

    /// Adds a plug-in to every flight: in the window, headless, in `explain` and in `report scenes`.
    ///
    /// A duplicate name is refused when the program runs.
    #[must_use]
    pub fn plugin(self, plugin: impl Plugin) -> Self {
        Self { catalog: self.catalog.plugin(plugin), ..self }
    }

    /// Adds a command. Its arguments are a type that derives `clap::Args` (your crate depends on clap 4, like this one, with the
    /// feature `derive`). The command also takes the global options, and `--help` lists it.
    ///
    /// ```no_run
    /// use colvis::cli::Program;
    ///
    /// #[derive(clap::Args)]
    /// struct Volume {
    ///     /// Scan [default: the embedded phantom]
    ///     input: Option<std::path::PathBuf>,
    /// }
    ///
    /// fn main() -> std::process::ExitCode {
    ///     let program = Program::default().command::<Volume>("volume", "Prints the lumen's volume", |args, session| {
    ///         let lumen = session.open(args.input.as_deref())?.lumen()?;
    ///         session.print(format!("{:.0} ml", lumen.segments.iter().map(|s| s.ml).sum::<f64>()))
    ///     });
    ///     program.run()
    /// }
    /// ```
    #[must_use]
    pub fn command<A: clap::Args>(
        mut self,
        name: &'static str,
        summary: &'static str,
        run: impl Fn(&A, &Session<'_>) -> Result<()> + Send + Sync + 'static,
    ) -> Self {
        self.commands.push(OwnCommand::new(name, summary, run));
        self
    }

    /// Runs the program with its command-line arguments and returns its exit status. Every failure prints exactly one line that
    /// begins with `error: `.
    pub fn run(self) -> ExitCode {
        self.run_from(std::env::args_os())
    }

    /// Like [`Program::run`], with these arguments; the first is the program's name.
    pub fn run_from<T: Into<OsString>>(self, args: impl IntoIterator<Item = T>) -> ExitCode {
        if let Err(e) = self.check() {
            return failed(&e);
        }
        let args: Vec<OsString> = args.into_iter().map(Into::into).collect();
        if let [_, help, keys] = &args[..]
            && ["--help", "-h", "help"].iter().any(|h| help == h)
            && keys == "keys"
        {
            return end(&self.key_page().and_then(|page| print(|out| write!(out, "{page}"))));
        }
        let args = match self.parse(args) {
            Ok(args) => args,
            Err(e) => return args::refuse(&e),
        };
        end(&guarded(|| run(&self, args)))
    }

    /// Reads a command line; the first argument is the program's name.
    ///
    /// # Errors
    /// What is wrong with the arguments; also when help or the version is requested.
    pub fn parse<T: Into<OsString>>(
        &self,
        args: impl IntoIterator<Item = T>,
    ) -> std::result::Result<Args, args::ParseError> {
        Args::read(args.into_iter().map(Into::into), self)
    }

    /// Checks that no name, key or command is used twice.
    ///
    /// # Errors
    /// Returns status 2 for the first one that is used twice, and names both owners.
    pub fn check(&self) -> Result<()> {
        self.catalog.check()?;
        let taken = crate::app::catalog::taken;
        for (n, own) in self.commands.iter().enumerate() {
            let what = format!("command {:?}", own.name);
            if args::is_command(own.name) {
                return Err(taken(&what, "a command of colvis", "a command of this program", "name"));
            }
            if self.commands[..n].iter().any(|o| o.name == own.name) {
                return Err(taken(&what, "a command of this program", "another one", "name"));
            }
        }
        // Two actions on one key would leave one of them without.
        self.key_help().map(drop)
    }
}

/// Type of a panic hook.
type PanicHook = Box<dyn Fn(&PanicHookInfo<'_>) + Sync + Send>;

/// Location of the first panic that [`panics`](crate::panics) did not catch.
static PANICKED_AT: Mutex<Option<String>> = Mutex::new(None);

/// Runs the program's work; turns a panic into an internal error.
fn guarded(work: impl FnOnce() -> Result<()>) -> Result<()> {
    static NOTING: Once = Once::new();
    NOTING.call_once(|| panic::set_hook(noting(panic::take_hook())));
    *PANICKED_AT.lock().unwrap_or_else(PoisonError::into_inner) = None;
    let place = || PANICKED_AT.lock().unwrap_or_else(PoisonError::into_inner).clone();
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| Err(panicked(&*panic, place().as_deref())))
}

/// The program's panic hook: it notes where the first panic happened and prints nothing, or what `usual` prints if
/// `RUST_BACKTRACE` is set. Panics that [`panics`](crate::panics) catches are ignored.
fn noting(usual: PanicHook) -> PanicHook {
    Box::new(move |info| {
        if is_catching() {
            note_place(info.location().map_or_else(String::new, ToString::to_string));
            return;
        }
        // Report the first panic: later ones are often its consequences.
        let place = || info.location().map_or_else(String::new, ToString::to_string);
        PANICKED_AT.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert_with(place);
        if std::env::var_os("RUST_BACKTRACE").is_some() {
            usual(info);
        }
    })
}

/// The internal error for a panic at `place`.
fn panicked(panic: &(dyn Any + Send), place: Option<&str>) -> Error {
    let text = panic.downcast_ref::<&str>().copied().or_else(|| panic.downcast_ref::<String>().map(String::as_str));
    let at = place.map_or_else(String::new, |p| format!(" ({p})"));
    Error::fault("colvis", format!("{}{at}", text.unwrap_or("panicked")), "report it, with the command")
}

/// The current or last run.
static UNDER_WAY: Mutex<Option<UnderWay>> = Mutex::new(None);

/// A run that an interrupt cancels.
struct UnderWay {
    progress: Arc<Progress>,
    /// The exit status, once the run is over.
    ended: Option<u8>,
}

fn under_way() -> MutexGuard<'static, Option<UnderWay>> {
    UNDER_WAY.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Ends the current run: prints its failure and returns its exit status.
///
/// An interrupt that ends the program prints a line of its own, and holds the lock from then on. So only one of the two prints.
fn end(outcome: &Result<()>) -> ExitCode {
    let mut run = under_way();
    let status = outcome.as_ref().map_or_else(|e| e.kind as u8, |()| 0);
    if let Err(e) = outcome {
        print_failure(e);
    }
    if let Some(run) = &mut *run {
        run.ended = Some(status);
    }
    ExitCode::from(status)
}

/// Makes interrupts cancel `progress` instead of an earlier run's.
fn on_interrupt(progress: &Arc<Progress>) -> Result<()> {
    let first = under_way().replace(UnderWay { progress: Arc::clone(progress), ended: None }).is_none();
    if !first {
        return Ok(());
    }
    ctrlc::set_handler(move || {
        let run = under_way();
        let Some(UnderWay { progress, ended }) = &*run else { return };
        if let Some(status) = ended {
            std::process::exit(i32::from(*status));
        }
        // The second Ctrl-C ends at once: files are whole or absent in any case.
        if progress.is_cancelled() {
            output::abandon_temporary();
            if std::io::stderr().is_terminal() {
                // A progress bar may occupy the line.
                output::to_stderr(format_args!(""));
            }
            let e = Error::cancelled("colvis");
            output::to_stderr(format_args!("error: {e}"));
            std::process::exit(e.kind as i32);
        }
        progress.cancel();
    })
    .map_err(|e| Error::fault("interrupt handler", e.to_string(), "run it again").caused_by(e))
}

/// Checks what every command has in common, and returns the progress that an interrupt cancels.
fn begin(program: &Program, args: &Args) -> Result<Arc<Progress>> {
    let progress = Arc::new(Progress::new());
    on_interrupt(&progress)?;
    let files = Files::of(args);
    let global = &args.global;
    let scene = match &args.command {
        None => args.fly.scene.as_deref(),
        Some(Command::Fly(a)) => a.scene.as_deref(),
        Some(Command::Explain(a)) => a.fly.scene.as_deref(),
        _ => None,
    };
    if let (Some(SeriesChoice::Uid(uid)), false) = (&global.series, matches!(args.command, Some(Command::Archive(_)))) {
        let why = format!("{uid} is not a whole number from 1 to 4096");
        return Err(Error::usage("--series", why, "give the number of the series in the folder"));
    }
    prepare::check(program, global, scene)?;
    files.check_apart()?;
    gather_threads(global.threads)?;
    Ok(progress)
}

fn run(program: &Program, args: Args) -> Result<()> {
    let progress = begin(program, &args)?;
    let global = args.global;
    // A flight shows its own progress: a window, or a bar that disappears before the last message.
    let _bar = match args.command {
        Some(
            Command::Info(_)
            | Command::Phantom(_)
            | Command::Slice(_)
            | Command::Segment(_)
            | Command::Candidates(_)
            | Command::Match(_)
            | Command::Unfold(_)
            | Command::Measure(_)
            | Command::Case(_)
            | Command::Archive(_)
            | Command::Surface(_)
            | Command::Cleanse(_)
            | Command::Centerline(_),
        ) => Some(Bar::show(&progress)),
        _ => None,
    };
    match args.command {
        Some(Command::Dataset(a)) => dataset::run(program, &a, &global, &progress),
        Some(Command::Info(a)) => info::run(&a, &global, &progress),
        Some(Command::Phantom(a)) => phantom::run(&a, &global, &progress),
        Some(Command::Slice(a)) => slice::run(&a, &global, &progress),
        Some(Command::Segment(a)) => segment::run(&a, &global, &progress),
        Some(Command::Measure(a)) => measure::run(&a, &global, &progress),
        Some(Command::Match(a)) => matching::run(&a, &global, &progress),
        Some(Command::Unfold(a)) => unfold::run(&a, &global, &progress),
        Some(Command::Case(a)) => case::run(&a, &global, &progress),
        Some(Command::Batch(a)) => batch::run(&a, &global, &progress),
        Some(Command::BatchWorker) => work(program),
        #[cfg(feature = "dicom")]
        Some(Command::Archive(a)) => archive::run(&a, &global, &progress),
        #[cfg(not(feature = "dicom"))]
        Some(Command::Archive(_)) => {
            Err(Error::usage("archive", "is not part of this program", "build colvis with its feature `dicom`"))
        }
        Some(Command::Candidates(a)) => candidates::run(program, &a, &global, &progress),
        Some(Command::Surface(a)) => surface::run(&a, &global, &progress),
        Some(Command::Cleanse(a)) => cleanse::run(&a, &global, &progress),
        Some(Command::Fly(a)) => fly::run(program, &a, &global, &progress),
        Some(Command::Render(a)) => render::run(program, &a, &global, &progress),
        Some(Command::Explain(a)) => explain::run(program, &a, &global, &progress),
        Some(Command::Centerline(a)) => centerline::run(&a, &global, &progress),
        Some(Command::Plane(a)) => plane::run(&a, &progress),
        #[cfg(feature = "report")]
        Some(Command::Report(a)) => report::run(program, &a, &global, &progress),
        #[cfg(not(feature = "report"))]
        Some(Command::Report(_)) => {
            Err(Error::usage("report", "is not part of this program", "build colvis with its feature `report`"))
        }
        Some(Command::Own { name, matches }) => {
            let session = Session { program, global: &global, progress: &progress };
            let own = program.commands.iter().find(|c| c.name == name);
            own.map_or(Ok(()), |own| own.run(&matches, &session))
        }
        None => fly::run(program, &args.fly, &global, &progress),
    }
}

/// Makes the steps of a case in this process.
fn work(program: &Program) -> Result<()> {
    let parsed = |line: Vec<OsString>, shared: &Shared| {
        let mut args = program
            .parse([OsString::from(crate::error::program_name())].into_iter().chain(line))
            .map_err(|e| e.error())?;
        args.global.shared = shared.clone();
        Ok(args)
    };
    let look = |line: Vec<OsString>, shared: &Shared| {
        let args = parsed(line, shared)?;
        let Some(Command::Info(info)) = &args.command else {
            return Err(Error::fault("batch", "looks at no scan", "report it"));
        };
        let mut seen = None;
        guarded(|| {
            let progress = begin(program, &args)?;
            seen = Some(info::look(info, &args.global, &progress)?);
            Ok(())
        })?;
        seen.ok_or_else(|| Error::fault("batch", "saw no scan", "report it"))
    };
    let step = |line: Vec<OsString>, shared: &Shared| {
        let args = parsed(line, shared)?;
        guarded(|| run(program, args))
    };
    batch::worker::run(&batch::worker::Work { look: &look, perform: &step })
}

/// Makes this thread one of the `threads` (default: one per processor) that share its work.
///
/// rayon's global pool would move the work to its own threads, and the system often runs two of them on one processor for some
/// milliseconds: a frame of 6 ms then takes 12. Loading and planning stay on the global pool, so that no frame waits for them.
///
/// A process keeps its threads: a later run with a different number is refused.
fn gather_threads(threads: Option<usize>) -> Result<()> {
    static GATHERED: Mutex<Option<(Option<usize>, ThreadPool)>> = Mutex::new(None);
    let mut gathered = GATHERED.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((before, _)) = &*gathered {
        return match threads {
            Some(n) if Some(n) != *before => {
                let why = "this process already uses another number of threads";
                Err(Error::usage(format!("--threads {n}"), why, "choose it in the first run, or leave it out"))
            }
            _ => Ok(()),
        };
    }
    let fault = |e: ThreadPoolBuildError| Error::fault("--threads", e.to_string(), "use fewer threads").caused_by(e);
    // rayon takes any number from its environment variable, however long it takes to start as many.
    let asked = std::env::var("RAYON_NUM_THREADS").ok().and_then(|n| n.parse::<usize>().ok());
    let number = threads.or(asked.filter(|n| *n > values::MOST_THREADS).map(|_| values::MOST_THREADS));
    if let Some(n) = number {
        ThreadPoolBuilder::new().num_threads(n).build_global().map_err(fault)?;
    }
    let pool = ThreadPoolBuilder::new().num_threads(number.unwrap_or(0)).use_current_thread().build().map_err(fault)?;
    *gathered = Some((threads, pool));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::panics;

    /// Runs `work` with the program's panic hook on this thread. The panics of other tests do not belong to the program.
    fn hooked<T>(work: impl FnOnce() -> T) -> T {
        let usual = Arc::new(panic::take_hook());
        let mine = std::thread::current().id();
        let (note, others) = (noting(Box::new(|_| {})), Arc::clone(&usual));
        panic::set_hook(Box::new(
            move |info| if std::thread::current().id() == mine { note(info) } else { others(info) },
        ));
        let outcome = work();
        panic::set_hook(Box::new(move |info| usual(info)));
        outcome
    }

    fn forget_panics() {
        *PANICKED_AT.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }

    #[test]
    fn a_fenced_panic_is_not_the_one_reported() {
        let _hook = panics::HOOK.lock().unwrap_or_else(PoisonError::into_inner);
        forget_panics();
        let place = || PANICKED_AT.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let (caught, after_fence, escaped) = hooked(|| {
            let caught = panics::catch_panic(|| panic!("a decoder's"));
            (caught, place(), catch_unwind(|| panic!("the program's")))
        });
        assert!(caught == Err::<(), _>(panics::Panicked) && escaped.is_err());
        assert_eq!(after_fence, None);
        assert!(place().is_some_and(|p| p.contains(file!())), "{:?}", place());
        forget_panics();
    }

    #[test]
    fn each_run_reports_the_place_of_its_own_panic() {
        let _hook = panics::HOOK.lock().unwrap_or_else(PoisonError::into_inner);
        // The first run in a process replaces the panic hook.
        let before = panic::take_hook();
        guarded(|| Ok(())).unwrap();
        panic::set_hook(before);
        let mut lines = [0; 2];
        let [first, second] = hooked(|| {
            let first = guarded(|| {
                lines[0] = line!() + 1;
                panic!("the first")
            });
            let second = guarded(|| {
                lines[1] = line!() + 1;
                let _ = catch_unwind(|| panic!("its cause"));
                panic!("the second")
            });
            [first, second].map(|outcome| outcome.unwrap_err().why)
        });
        let is = |why: &str, text: &str, line: u32| why.starts_with(text) && why.contains(&format!(":{line}:"));
        assert!(is(&first, "the first", lines[0]), "{first}");
        assert!(is(&second, "the second", lines[1]), "{second}: the place of the run's first panic");
        forget_panics();
    }

    #[test]
    fn what_is_added_stays_beside_what_was_added_before() {
        let overlay = Overlay { name: "own overlay", ..Overlay::PLAIN };
        let program = Program::default()
            .overlay(overlay)
            .preset(Preset { name: "own preset", ..Preset::default() })
            .camera(CameraModel { name: "own camera", ..CameraModel::default() })
            .shader(ShaderModel { name: "own shader", ..ShaderModel::default() })
            .plugin(("own plug-in", |_: &mut crate::schedule::App| Ok(())));
        program.check().unwrap();
        let catalog = &program.catalog;
        assert_eq!(catalog.find_overlay("own overlay").unwrap().name, "own overlay");
        assert_eq!(catalog.find_preset("own preset").unwrap().name, "own preset");
        assert_eq!(catalog.find_camera("own camera").unwrap().name, "own camera");
        assert_eq!(catalog.find_shader("own shader").unwrap().name, "own shader");
        assert_eq!(catalog.plugins.iter().map(|p| p.name()).collect::<Vec<_>>(), ["own plug-in"]);
    }

    #[cfg(feature = "window")]
    #[test]
    fn a_key_of_the_window_is_refused_to_overlays_and_panels_of_a_program() {
        let overlay = |key| Program::default().overlay(Overlay { name: "own", key, ..Overlay::PLAIN });
        let panel = |key| Program::default().panel(PanelEntry { name: "own", title: "Own", key, ..PanelEntry::NONE });
        // W flies forward.
        for program in [
            overlay(Some('w')),
            panel(Some('w')),
            overlay(Some('z')).panel(PanelEntry { name: "other", key: Some('Z'), ..PanelEntry::NONE }),
        ] {
            let e = program.check().unwrap_err();
            assert!(e.kind as u8 == 2, "{e}");
        }
        overlay(None).check().unwrap();
        panel(None).check().unwrap();
    }

    #[test]
    fn a_panic_is_one_line_and_a_fault() {
        let reported = |panic: Box<dyn Any + Send>, place| panicked(&*panic, place);
        let e = reported(Box::new("no\nvoxel"), Some("src/a.rs:3:5"));
        assert_eq!(e.to_string(), "colvis: no voxel (src/a.rs:3:5); report it, with the command");
        assert_eq!(e.kind as u8, 1);
        let e = reported(Box::new("index 7".to_owned()), None);
        assert_eq!(e.why, "index 7");
        assert_eq!(reported(Box::new(7), None).why, "panicked");
    }
}
