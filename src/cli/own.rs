//! Commands of other crates.

use std::fmt;
use std::path::Path;
use std::sync::Arc;

use clap::ArgMatches;

use crate::app::{Catalog, Scan, Scene};
use crate::cli::args::Global;
use crate::cli::messages::print;
use crate::cli::{Program, prepare};
use crate::error::{Error, Result};
pub use crate::host::terminal::Bar as ProgressBar;
use crate::panics::ask_plugin;
use crate::progress::Progress;

/// Context of another crate's command.
pub struct Session<'a> {
    pub(super) program: &'a Program,
    pub(super) global: &'a Global,
    pub(super) progress: &'a Arc<Progress>,
}

impl Session<'_> {
    /// Opens a scan with the global options (`--wall`, `--series`, …), or the embedded phantom without an input, and prints notes
    /// about it.
    ///
    /// # Errors
    /// Returns status 2 for invalid options, 3 if it cannot be read, 4 if interrupted.
    pub fn open(&self, input: Option<&Path>) -> Result<Scan> {
        let preset = self.scene().image.preset;
        prepare::open(input, self.global, preset, self.progress)
    }

    /// The default scene with the program's guides and plug-ins.
    pub fn scene(&self) -> Scene {
        let Catalog { guides, plugins, .. } = self.program.catalog.clone();
        Scene { guides, plugins, ..Scene::default() }
    }

    /// The program's catalog: guides, presets, cameras, shaders, overlays, plug-ins.
    pub fn catalog(&self) -> &Catalog {
        &self.program.catalog
    }

    /// The options that every command takes.
    pub fn global(&self) -> &Global {
        self.global
    }

    /// Progress of the work; reports interrupts.
    pub fn progress(&self) -> &Arc<Progress> {
        self.progress
    }

    /// Shows [`Session::progress`] on the terminal, as the commands of colvis do, until the bar is dropped: the stage, its share and
    /// the time. Shows nothing if standard error is not a terminal. Drop it before you print.
    ///
    /// colvis reports the stages of its own work, such as [`Session::open`]. Report those of yours with [`Progress::stage`] and
    /// [`Progress::advance`].
    pub fn progress_bar(&self) -> ProgressBar {
        ProgressBar::show(self.progress)
    }

    /// Writes to standard output. A reader that closes early (`… | head -1`) is not an error.
    ///
    /// # Errors
    /// Returns status 5 if it cannot be written.
    pub fn print(&self, text: impl fmt::Display) -> Result<()> {
        print(|out| writeln!(out, "{text}"))
    }
}

/// Function that runs a command with its arguments.
type Run = dyn Fn(&ArgMatches, &Session<'_>) -> Result<()> + Send + Sync;

/// A command of another crate.
#[derive(Clone)]
pub(super) struct OwnCommand {
    pub name: &'static str,
    pub summary: &'static str,
    augment: fn(clap::Command) -> clap::Command,
    run: Arc<Run>,
}

impl OwnCommand {
    pub(crate) fn new<A: clap::Args>(
        name: &'static str,
        summary: &'static str,
        run: impl Fn(&A, &Session<'_>) -> Result<()> + Send + Sync + 'static,
    ) -> Self {
        let run = move |matches: &ArgMatches, session: &Session<'_>| {
            let args = A::from_arg_matches(matches)
                .map_err(|e| Error::usage(name, e.to_string(), format!("see colvis {name} --help")))?;
            run(&args, session)
        };
        Self { name, summary, augment: A::augment_args, run: Arc::new(run) }
    }

    /// The command for the command line.
    pub(crate) fn line(&self) -> clap::Command {
        (self.augment)(clap::Command::new(self.name)).about(self.summary)
    }

    /// Runs the command with its arguments. Returns the error of the command, or status 1 with its name if it panics.
    pub(crate) fn run(&self, matches: &ArgMatches, session: &Session<'_>) -> Result<()> {
        ask_plugin(|| format!("command {}", self.name), || (self.run)(matches, session))
    }
}

impl fmt::Debug for OwnCommand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("OwnCommand").field("name", &self.name).finish_non_exhaustive()
    }
}
