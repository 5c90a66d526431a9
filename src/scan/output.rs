//! Atomic output files: each appears complete or not at all, even when the program is interrupted.

mod leftover;
mod npy;
#[doc(hidden)]
pub mod png;

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::error::{Error, Kind, Result};

pub use npy::{write_npy, write_npy_head, write_npy_values};

/// Writes a line to standard error. A standard error that is closed or full is ignored: it must not end the program or change its
/// exit status, as `eprintln!` would.
pub fn to_stderr(line: std::fmt::Arguments<'_>) {
    if cfg!(test) {
        // The test harness captures this, but not a direct write.
        eprintln!("{line}");
    } else {
        let _ = writeln!(io::stderr().lock(), "{line}");
    }
}

/// A file that appears only when it is complete.
///
/// Data goes to a temporary file beside the target. [`AtomicFile::finish`] renames it; dropping it earlier removes it.
/// Temporary files that killed programs left in the folder are removed first.
///
/// Symbolic links are followed. A target that exists and is not a regular file, or that is reached through `/dev` or
/// `/proc` (`/dev/stdout`), is written to directly and never replaced: a file behind it is appended to, as `>>` does. A replaced file
/// keeps its permissions.
pub struct AtomicFile {
    path: PathBuf,
    sink: BufWriter<Sink>,
}

enum Sink {
    Temporary(tempfile::NamedTempFile, Listed),
    Direct(File),
}

/// Temporary files that currently exist.
static TEMPORARY: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Keeps a temporary file in [`TEMPORARY`] until it is dropped.
struct Listed(PathBuf);

impl Listed {
    /// Lists the file that `create` creates. No file exists that is not listed, not even for a moment.
    fn create(
        create: impl FnOnce() -> io::Result<tempfile::NamedTempFile>,
    ) -> io::Result<(tempfile::NamedTempFile, Self)> {
        let mut listed = temporary();
        let file = create()?;
        let path = file.path().to_owned();
        listed.push(path.clone());
        Ok((file, Self(path)))
    }
}

impl Drop for Listed {
    fn drop(&mut self) {
        temporary().retain(|p| *p != self.0);
    }
}

fn temporary() -> MutexGuard<'static, Vec<PathBuf>> {
    TEMPORARY.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Removes all files being written. Call it before the process exits without running destructors.
///
/// The process can create no more of them: other threads that try, or that finish one, wait for its exit.
pub fn abandon_temporary() {
    let listed = temporary();
    for path in listed.iter() {
        // It may just have been renamed.
        let _ = std::fs::remove_file(path);
    }
    std::mem::forget(listed);
}

impl Write for Sink {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        match self {
            Self::Temporary(f, _) => f.write(buf),
            Self::Direct(f) => f.write(buf),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Temporary(f, _) => f.flush(),
            Self::Direct(f) => f.flush(),
        }
    }
}

impl AtomicFile {
    /// Starts writing `path`.
    ///
    /// # Errors
    /// Returns status 5 if the folder is missing or not writable, or if `path` is a folder.
    pub fn create(path: &Path) -> Result<Self> {
        let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        let special = is_special(&absolute);
        let existing = std::fs::metadata(path);
        let path = &std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let sink = match &existing {
            Ok(m) if m.is_dir() => return Err(Error::output(path, "is a folder", "name a file")),
            Ok(m) if !m.is_file() || special => Sink::Direct(
                File::options().append(m.is_file()).write(true).open(&absolute).map_err(|e| cannot(path, e))?,
            ),
            _ => {
                let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
                leftover::remove_once(folder);
                let set_up = |_builder: &mut tempfile::Builder<'_, '_>| {
                    #[cfg(unix)]
                    {
                        use std::os::unix::fs::PermissionsExt;
                        // Use default permissions (the umask still applies), not the owner-only ones of a temporary file.
                        let mode = existing.as_ref().map_or(0o666, |m| m.permissions().mode() & 0o777);
                        _builder.permissions(std::fs::Permissions::from_mode(mode));
                    }
                };
                let file = Listed::create(|| leftover::locked(folder, set_up));
                let (file, listed) = file.map_err(|e| cannot(path, e))?;
                Sink::Temporary(file, listed)
            }
        };
        Ok(Self { path: path.to_owned(), sink: BufWriter::with_capacity(1 << 20, sink) })
    }

    /// The temporary file's path, for another program to write to.
    pub fn place(&self) -> &Path {
        match self.sink.get_ref() {
            Sink::Temporary(f, _) => f.path(),
            Sink::Direct(_) => &self.path,
        }
    }

    /// Flushes the file and renames it to its target.
    ///
    /// # Errors
    /// Returns status 5 if the last bytes cannot be written or the file cannot be renamed.
    pub fn finish(mut self) -> Result<()> {
        self.sink.flush().map_err(|e| cannot(&self.path, e))?;
        // `into_parts` cannot lose data: the buffer was flushed above.
        match self.sink.into_parts().0 {
            Sink::Temporary(f, _listed) => f.persist(&self.path).map(drop).map_err(|e| cannot(&self.path, e.error)),
            Sink::Direct(_) => Ok(()),
        }
    }

    /// Finishes files that belong together: all of them are written before the first of them appears.
    ///
    /// # Errors
    /// As [`AtomicFile::finish`]. If the last bytes of one cannot be written, none has appeared.
    pub fn finish_all(mut files: Vec<Self>) -> Result<()> {
        for file in &mut files {
            file.sink.flush().map_err(|e| cannot(&file.path, e))?;
        }
        files.into_iter().try_for_each(Self::finish)
    }

    /// Same as [`AtomicFile::finish`], under the first of these names in its folder that is free; nothing is replaced. Returns the
    /// name; `None` if none is free.
    ///
    /// # Errors
    /// As [`AtomicFile::finish`].
    #[doc(hidden)]
    pub fn finish_as(mut self, names: impl Iterator<Item = PathBuf>) -> Result<Option<PathBuf>> {
        self.sink.flush().map_err(|e| cannot(&self.path, e))?;
        let Sink::Temporary(mut file, _listed) = self.sink.into_parts().0 else { return Ok(None) };
        for name in names {
            match file.persist_noclobber(&name) {
                Ok(_) => return Ok(Some(name)),
                Err(e) if e.error.kind() == io::ErrorKind::AlreadyExists => file = e.file,
                Err(e) => return Err(cannot(&name, e.error)),
            }
        }
        Ok(None)
    }
}

impl Write for AtomicFile {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        self.sink.write(buf)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.sink.flush()
    }
}

/// Writes `path` atomically with the bytes that `fill` produces.
///
/// # Errors
/// Returns status 5 if the file cannot be written. If `fill` wraps an [`Error`] in the `io::Error` (a cancellation),
/// that error is returned instead.
pub fn write_whole(path: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<()> {
    let mut file = AtomicFile::create(path)?;
    fill(&mut file).map_err(|e| cannot(path, e))?;
    file.finish()
}

/// Writes a JSON value, indented, atomically.
///
/// # Errors
/// Returns status 5 if the file cannot be written.
pub fn write_json(path: &Path, value: &impl serde::Serialize) -> Result<()> {
    write_whole(path, |w| {
        serde_json::to_writer_pretty(&mut *w, value)?;
        w.write_all(b"\n")
    })
}

/// Creates an output folder and its parents.
///
/// # Errors
/// Returns status 5 if the folder cannot be created.
pub fn make_folder(path: &Path) -> Result<()> {
    // A slash at the end would hide a file.
    let bare: PathBuf = path.components().collect();
    std::fs::create_dir_all(path).map_err(|e| match bare.ancestors().find(|p| p.exists()) {
        Some(file) if !file.is_dir() => {
            let why = format!("cannot be created: {} is a file", file.display());
            Error::output(path, why, "name another folder, or move the file away")
        }
        _ => cannot(path, e),
    })
}

/// Converts an `io::Error` to an output error about `path`. An [`Error`] wrapped inside is returned unchanged.
pub fn cannot(path: &Path, e: io::Error) -> Error {
    if let Some(own) = e.get_ref().and_then(|inner| inner.downcast_ref::<Error>()) {
        return own.clone();
    }
    let hint = match e.kind() {
        io::ErrorKind::PermissionDenied => "choose a place you may write to",
        io::ErrorKind::NotFound => "make the folder first",
        io::ErrorKind::StorageFull => "free some space, or choose another disk",
        _ => "choose another place",
    };
    let why = format!("cannot be written ({})", plain(&e));
    Error::new(Kind::Output, path.display().to_string(), why, hint).caused_by(e)
}

/// Reads a small text file whole: a scene, a list of poses.
///
/// # Errors
/// Returns status 3, with `hint`, if it cannot be read.
pub fn read_text(path: &Path, hint: &str) -> Result<String> {
    std::fs::read_to_string(path)
        .map_err(|e| Error::file(path, format!("cannot be read ({})", plain(&e)), hint).caused_by(e))
}

/// True if a path leads through the system's device folders. `/dev/shm` does not count: it holds ordinary files.
fn is_special(absolute: &Path) -> bool {
    ["/dev", "/proc"].iter().any(|root| absolute.starts_with(root)) && !absolute.starts_with("/dev/shm")
}

/// Returns the system's text for an error, without temporary file names and without the error number.
pub fn plain(e: &io::Error) -> String {
    // A wrapped error carries the temporary file's path, which means nothing to the user.
    let code = e.raw_os_error().or_else(|| {
        let mut source: Option<&(dyn std::error::Error + 'static)> = e.get_ref().map(|inner| inner as _);
        std::iter::from_fn(|| {
            let inner = source?;
            source = inner.source();
            Some(inner.downcast_ref::<io::Error>().and_then(io::Error::raw_os_error))
        })
        .find_map(|code| code)
    });
    let text = code.map_or_else(|| e.to_string(), |code| io::Error::from_raw_os_error(code).to_string());
    text.split(" (os error").next().unwrap_or(&text).to_lowercase()
}

/// Rejects files whose folder is missing.
///
/// # Errors
/// Returns status 5 if a folder is missing.
pub fn check_folders(outputs: &[&Path]) -> Result<()> {
    let is_missing = |p: &&&Path| place(p).parent().is_some_and(|f| !f.is_dir());
    outputs.iter().find(is_missing).map_or(Ok(()), |path| {
        if place(path).ancestors().skip(1).find(|p| p.exists()).is_some_and(|p| !p.is_dir()) {
            let why = "cannot be written (its folder is a file)";
            return Err(Error::output(path, why, "name another folder"));
        }
        Err(Error::output(path, "cannot be written (its folder does not exist)", "make the folder first"))
    })
}

/// Returns the absolute path with links followed, also where the file itself does not exist yet.
fn place(path: &Path) -> PathBuf {
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    if is_special(&absolute) {
        return absolute;
    }
    let real = |folder: &Path| std::fs::canonicalize(folder).ok().map(|f| (folder.to_owned(), f));
    match absolute.ancestors().find_map(real) {
        Some((folder, there)) => match absolute.strip_prefix(&folder) {
            Ok(rest) if rest.as_os_str().is_empty() => there,
            Ok(rest) => there.join(rest),
            Err(_) => absolute,
        },
        None => absolute,
    }
}

/// Rejects outputs (files or folders) that would overwrite an input or each other.
///
/// # Errors
/// Returns status 2 if two paths are the same.
pub fn check_apart(inputs: &[&Path], outputs: &[&Path]) -> Result<()> {
    let mut taken: Vec<PathBuf> = inputs.iter().map(|p| place(p)).collect();
    for &path in outputs {
        let at = place(path);
        if taken.contains(&at) && !is_special(&at) {
            let why = "is used twice, and one use would overwrite the other";
            return Err(Error::usage(path.display().to_string(), why, "give each its own name"));
        }
        taken.push(at);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_nothing_and_keeps_what_was_there() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.json");
        std::fs::write(&path, "old").unwrap();
        let e = write_whole(&path, |w| {
            w.write_all(b"half")?;
            Err(io::Error::other("disk full"))
        })
        .unwrap_err();
        assert_eq!(e.kind, Kind::Output);
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "no temporary file stays behind");
    }

    #[cfg(unix)]
    #[test]
    fn a_link_is_followed_and_permissions_are_kept() {
        use std::os::unix::fs::PermissionsExt;
        let dir = tempfile::tempdir().unwrap();
        let (file, link) = (dir.path().join("file"), dir.path().join("link"));
        std::fs::write(&file, "old").unwrap();
        std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o600)).unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        write_whole(&link, |w| w.write_all(b"new")).unwrap();
        assert!(std::fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "new");
        assert_eq!(std::fs::metadata(&file).unwrap().permissions().mode() & 0o777, 0o600);
    }

    #[test]
    fn targets_that_collide_are_refused_before_any_work() {
        let dir = tempfile::tempdir().unwrap();
        let at = |n: &str| dir.path().join(n);
        std::fs::write(at("scan"), "x").unwrap();
        let check = |o: &[&Path]| check_apart(&[&at("scan")], o).and_then(|()| check_folders(o)).map_err(|e| e.kind);
        assert_eq!(check(&[&at("a"), &at("b")]), Ok(()));
        assert_eq!(check(&[&at("scan")]), Err(Kind::Usage));
        assert_eq!(check(&[&at("a"), &at("a")]), Err(Kind::Usage));
        assert_eq!(check(&[&at("none/a")]), Err(Kind::Output));
        let in_file = check_folders(&[&at("scan/a")]).unwrap_err().to_string();
        assert!(in_file.contains("is a file"), "{in_file}");
        assert_eq!(check_folders(&[&at("scan/deep/er")]).unwrap_err().to_string().matches("is a file").count(), 1);
        for folder in [at("scan"), at("scan/"), at("scan/deep/er")] {
            let e = make_folder(&folder).unwrap_err().to_string();
            assert!(e.contains("scan is a file"), "{e}");
        }
        let apart = |i: &Path, o: &Path| check_apart(&[i], &[o]).map_err(|e| e.kind);
        assert_eq!(apart(dir.path(), &dir.path().join("")), Err(Kind::Usage), "the same folder, with a slash");
        assert_eq!(apart(dir.path(), &at("none/of/it/")), Ok(()));
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(dir.path(), at("link")).unwrap();
            assert_eq!(check(&[&at("a"), &at("link/a")]), Err(Kind::Usage), "through a link, and neither exists");
        }
    }

    #[test]
    fn files_being_written_are_known() {
        let dir = tempfile::tempdir().unwrap();
        let file = AtomicFile::create(&dir.path().join("a")).unwrap();
        let place = file.place().to_owned();
        assert!(temporary().contains(&place));
        file.finish().unwrap();
        assert!(!temporary().contains(&place));
    }

    #[test]
    fn a_device_is_written_to_and_not_replaced() {
        let e = write_whole(Path::new("/dev/full"), |w| w.write_all(b"x")).unwrap_err();
        assert_eq!(e.kind, Kind::Output);
        assert!(!std::fs::metadata("/dev/full").unwrap().is_file());
        // Shared memory behaves like an ordinary folder.
        if let Ok(dir) = tempfile::tempdir_in("/dev/shm") {
            let path = dir.path().join("a.txt");
            for text in ["longer", "short"] {
                write_whole(&path, |w| w.write_all(text.as_bytes())).unwrap();
                assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
            }
        }
    }
}
