//! The files that a command reads and writes: none of its outputs may take the place of an input or of another output.

use std::path::{Path, PathBuf};

use crate::cli::args::{ArchiveAction, Args, Command, FlyArgs, PlaneArgs};
use crate::cli::candidates::gallery;
use crate::cli::case;
use crate::error::{Error, Result};
use crate::output;
use crate::volume::io::companions;

/// The files and folders that a command line names, by their use.
#[derive(Clone, Debug, Default)]
pub(super) struct Files {
    read: Vec<PathBuf>,
    written: Vec<PathBuf>,
}

impl Files {
    /// Those of a command line. Commands of other crates check theirs themselves.
    pub(super) fn of(args: &Args) -> Self {
        let none = Self::default;
        match &args.command {
            None => Self::fly(&args.fly),
            Some(Command::Fly(a)) => Self::fly(a),
            // It reads what the flight would read, and writes nothing.
            Some(Command::Explain(a)) => Self { written: Vec::new(), ..Self::fly(&a.fly) },
            Some(Command::Render(a)) => {
                none().reads([&a.input, &a.poses]).reads(&a.scene).writes([&a.out]).writes(&a.stats)
            }
            Some(Command::Slice(a)) => none().reads(&a.input).writes([&a.out]),
            Some(Command::Segment(a)) => none().reads([&a.input]).writes([&a.out]).writes(&a.stats).writes(&a.picture),
            Some(Command::Surface(a)) => none().reads(a.input.iter().chain(&a.mask)).writes([&a.out]).writes(&a.stats),
            Some(Command::Cleanse(a)) => none().reads([&a.input]).writes([&a.out]).writes(&a.stats),
            Some(Command::Centerline(a)) => {
                none().reads(a.input.iter().chain(&a.mask)).writes([&a.out]).writes(&a.stats)
            }
            Some(Command::Candidates(a)) => {
                let page = a.gallery.as_ref().map(|folder| folder.join(gallery::PAGE));
                none().reads([&a.input]).writes([&a.out]).writes(&a.stats).writes(&a.gallery).writes(page)
            }
            Some(Command::Case(a)) => {
                let files = case::FILES.map(|name| a.out.join(name));
                none()
                    .reads([&a.input, &a.findings])
                    .reads(a.scheme_file().iter().chain(&a.second))
                    .writes([&a.out])
                    .writes(files)
                    .writes(&a.stats)
            }
            // `get` writes and reads no file: its folder may have the archive's name.
            Some(Command::Archive(a)) => {
                let is_get = a.action == ArchiveAction::Get;
                none().reads(a.names.iter().filter(|_| !is_get)).writes(&a.out)
            }
            // Its files are those of the commands that it runs.
            Some(Command::BatchWorker) => none(),
            Some(Command::Batch(a)) => none().reads(a.manifest.iter().chain(&a.group)).writes([&a.out]),
            Some(Command::Match(a)) => none().reads([&a.a, &a.b]).writes([&a.out]).writes(&a.stats),
            Some(Command::Unfold(a)) => none().reads([&a.input]).writes([&a.out]).writes(a.map.iter().chain(&a.stats)),
            Some(Command::Measure(a)) => none().reads([&a.input]).writes(&a.out).writes(&a.stats),
            Some(Command::Phantom(a)) => {
                let more = a.twin.iter().chain(&a.second).chain(&a.labels).chain(&a.truth);
                none().reads(&a.into).writes([&a.out]).writes(more)
            }
            Some(Command::Dataset(a)) => none()
                .reads(a.input.iter().chain(&a.poses).chain(&a.replay).chain(&a.play).chain(&a.scene))
                .writes([&a.out])
                .writes(&a.stats),
            Some(Command::Info(a)) => none().reads([&a.input]),
            Some(Command::Plane(a)) => Self::plane(a),
            Some(Command::Report(a)) => none().reads(a.scan.iter().chain(&a.truth)).writes([&a.out]),
            Some(Command::Own { .. }) => none(),
        }
    }

    /// Those of a flight.
    pub(super) fn fly(a: &FlyArgs) -> Self {
        Self::default()
            .reads(a.input.iter().chain(&a.second).chain(&a.replay).chain(&a.play).chain(&a.scene).chain(&a.answers))
            .writes(a.record.as_ref().map(PathBuf::from))
            .writes(a.log.iter().chain(&a.stats).chain(&a.record_input).chain(&a.coverage_mesh))
    }

    /// Those of a flight through a drawing.
    pub(super) fn plane(a: &PlaneArgs) -> Self {
        Self::default().reads(a.lumen.iter().chain(&a.scene)).writes(&a.out)
    }

    fn reads<P: AsRef<Path>>(mut self, paths: impl IntoIterator<Item = P>) -> Self {
        self.read.extend(paths.into_iter().map(|p| p.as_ref().to_owned()));
        self
    }

    /// Adds outputs.
    pub(super) fn writes<P: AsRef<Path>>(mut self, paths: impl IntoIterator<Item = P>) -> Self {
        self.written.extend(paths.into_iter().map(|p| p.as_ref().to_owned()));
        self
    }

    /// Refuses outputs that would overwrite an input or each other, with the data files beside headers and the slices of folders.
    /// Fails with status 2.
    pub(super) fn check_apart(&self) -> Result<()> {
        let with = |paths: &[PathBuf], companion: fn(&Path) -> Option<PathBuf>| {
            paths.iter().flat_map(|p| std::iter::once(p.clone()).chain(companion(p))).collect::<Vec<_>>()
        };
        let (read, written) = (with(&self.read, companions::read_with), with(&self.written, companions::written_with));
        output::check_apart(&paths(&read), &paths(&written))?;
        for file in &written {
            if let Some(folder) = written.iter().find(|f| is_picture_of(f, file)) {
                let why = format!("is also the name of an image in the output folder {}", folder.display());
                return Err(Error::usage(file.display().to_string(), why, "give it another name"));
            }
        }
        for file in written.iter().filter(|w| w.is_file()) {
            if let Some(folder) = self.read.iter().find(|r| is_slice(r, file)) {
                let why = format!("is a slice of the input {}", folder.display());
                return Err(Error::usage(file.display().to_string(), why, "give it another name"));
            }
        }
        Ok(())
    }
}

fn paths(files: &[PathBuf]) -> Vec<&Path> {
    files.iter().map(PathBuf::as_path).collect()
}

/// True if an existing file is a slice of what is read.
fn is_slice(read: &Path, file: &Path) -> bool {
    let real = |path: &Path| std::fs::canonicalize(path).ok();
    let Some((folder, file)) = real(read).zip(real(file)) else { return false };
    folder.is_dir() && file.starts_with(&folder) && companions::is_slice_of(&folder, &file)
}

/// True if a file lies in a folder of numbered pictures and is named like one of them.
fn is_picture_of(folder: &Path, file: &Path) -> bool {
    let number = file.file_stem().and_then(|s| s.to_str()).map(|s| s.split(['-', '_', '.']).next().unwrap_or(s));
    let is_numbered = number.is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()));
    let is_png = file.extension().is_some_and(|e| e.eq_ignore_ascii_case("png"));
    is_png && is_numbered && file.parent().is_some_and(|p| p.components().eq(folder.components()))
}

/// Rejects outputs whose folder is missing, before any work is done. Fails with status 5.
pub(super) fn check_folders(out: &Path, beside: Option<&Path>) -> Result<()> {
    output::check_folders(&std::iter::once(out).chain(beside).collect::<Vec<_>>())
}

#[cfg(test)]
#[path = "files_tests.rs"]
mod tests;
