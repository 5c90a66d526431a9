//! Writing files so that each appears whole or not at all.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::error::{Error, Kind, Result};

/// A file being written: a temporary one beside its target, renamed on [`Whole::finish`] and removed when dropped before.
///
/// A target that exists and is no regular file (`/dev/stdout`, a pipe) is written to directly, never replaced.
pub struct Whole {
    path: PathBuf,
    sink: BufWriter<Sink>,
}

enum Sink {
    Temporary(tempfile::NamedTempFile),
    Direct(File),
}

impl Write for Sink {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        match self {
            Self::Temporary(f) => f.write(buf),
            Self::Direct(f) => f.write(buf),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Temporary(f) => f.flush(),
            Self::Direct(f) => f.flush(),
        }
    }
}

impl Whole {
    /// Begins to write `path`.
    ///
    /// # Errors
    /// Status 5 when the folder is missing, not writable, or `path` is a folder.
    pub fn create(path: &Path) -> Result<Self> {
        let sink = match std::fs::metadata(path) {
            Ok(m) if m.is_dir() => return Err(Error::output(path, "is a folder", "name a file")),
            Ok(m) if !m.is_file() => {
                Sink::Direct(File::options().write(true).open(path).map_err(|e| cannot(path, &e))?)
            }
            _ => {
                let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
                let mut builder = tempfile::Builder::new();
                builder.prefix(".colvis-").suffix(".tmp");
                #[cfg(unix)]
                {
                    use std::os::unix::fs::PermissionsExt;
                    // The usual permissions (the umask still applies), not the owner-only ones of a temporary file.
                    builder.permissions(std::fs::Permissions::from_mode(0o666));
                }
                Sink::Temporary(builder.tempfile_in(folder).map_err(|e| cannot(path, &e))?)
            }
        };
        Ok(Self { path: path.to_owned(), sink: BufWriter::with_capacity(1 << 20, sink) })
    }

    /// Flushes and gives the file its name.
    ///
    /// # Errors
    /// Status 5 when the last bytes cannot be written or the file cannot be renamed.
    pub fn finish(mut self) -> Result<()> {
        self.sink.flush().map_err(|e| cannot(&self.path, &e))?;
        // `into_parts` cannot lose data: the buffer was flushed above.
        match self.sink.into_parts().0 {
            Sink::Temporary(f) => f.persist(&self.path).map(drop).map_err(|e| cannot(&self.path, &e.error)),
            Sink::Direct(_) => Ok(()),
        }
    }
}

impl Write for Whole {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        self.sink.write(buf)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.sink.flush()
    }
}

/// Writes `path` whole or not at all with what `fill` produces.
///
/// # Errors
/// Status 5 when it cannot be written; an [`Error`] wrapped in the `io::Error` by `fill` (a cancellation) is kept.
pub fn write_whole(path: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<()> {
    let mut file = Whole::create(path)?;
    fill(&mut file).map_err(|e| cannot(path, &e))?;
    file.finish()
}

/// Writes a JSON value, indented, whole or not at all.
///
/// # Errors
/// Status 5 when it cannot be written.
pub fn write_json(path: &Path, value: &impl serde::Serialize) -> Result<()> {
    write_whole(path, |w| {
        serde_json::to_writer_pretty(&mut *w, value)?;
        w.write_all(b"\n")
    })
}

/// Makes a folder (and its parents) for outputs.
///
/// # Errors
/// Status 5 when it cannot be made.
pub fn make_folder(path: &Path) -> Result<()> {
    std::fs::create_dir_all(path).map_err(|e| cannot(path, &e))
}

/// The output failure that an `io::Error` stands for.
pub fn cannot(path: &Path, e: &io::Error) -> Error {
    if let Some(own) = e.get_ref().and_then(|inner| inner.downcast_ref::<Error>()) {
        return own.clone();
    }
    let mend = match e.kind() {
        io::ErrorKind::PermissionDenied => "choose a place you may write to",
        io::ErrorKind::NotFound => "make the folder first",
        io::ErrorKind::StorageFull => "free some space, or choose another disk",
        _ => "choose another place",
    };
    Error::new(Kind::Output, path.display().to_string(), format!("cannot be written ({e})"), mend)
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

    #[test]
    fn a_device_is_written_to_and_not_replaced() {
        let e = write_whole(Path::new("/dev/full"), |w| w.write_all(b"x")).unwrap_err();
        assert_eq!(e.kind, Kind::Output);
        assert!(!std::fs::metadata("/dev/full").unwrap().is_file());
    }
}
