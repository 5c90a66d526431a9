//! The platform's folders for settings and for files that the window keeps, and reading and writing of small files in them.

use std::path::{Path, PathBuf};

#[cfg(feature = "window")]
use serde::Serialize;
#[cfg(feature = "window")]
use serde::de::DeserializeOwned;

use crate::error::{Error, Result};
#[cfg(feature = "window")]
use crate::output;

/// Maximum size of the program's files, bytes.
const MOST_BYTES: u64 = 1 << 20;

/// Purpose of a folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Folder {
    /// Files that the user has written.
    Configuration,
    /// State that the program remembers.
    #[cfg(any(feature = "window", test))]
    State,
}

impl Folder {
    /// Returns the path of a colvis file in it; `None` on a system that defines no such folder.
    pub(crate) fn file(self, name: impl AsRef<Path>) -> Option<PathBuf> {
        self.of(|name| std::env::var_os(name).map(PathBuf::from)).map(|f| f.join("colvis").join(name))
    }

    /// Determines the folder from the environment. A relative path there must be ignored.
    fn of(self, variable: impl Fn(&str) -> Option<PathBuf>) -> Option<PathBuf> {
        let absolute = |name: &str| variable(name).filter(|p| p.is_absolute());
        let (windows, xdg, home) = match self {
            Self::Configuration => ("APPDATA", "XDG_CONFIG_HOME", ".config"),
            #[cfg(any(feature = "window", test))]
            Self::State => ("LOCALAPPDATA", "XDG_STATE_HOME", ".local/state"),
        };
        if cfg!(windows) {
            return absolute(windows);
        }
        let home = if cfg!(target_os = "macos") { "Library/Application Support" } else { home };
        absolute(xdg).or_else(|| absolute("HOME").map(|h| h.join(home)))
    }
}

/// Reads a small file; `None` if it does not exist. `hint` becomes the hint of an error.
///
/// # Errors
/// Returns status 3 if it cannot be read, or is larger than the program's files can be.
pub(crate) fn read(path: &Path, hint: &str) -> Result<Option<Vec<u8>>> {
    let bad = |why: String| Error::file(path, why, hint);
    match std::fs::metadata(path) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(bad(format!("cannot be read ({e})"))),
        Ok(m) if !m.is_file() => return Err(bad("is not a file".to_owned())),
        Ok(m) if m.len() > MOST_BYTES => return Err(bad(format!("is larger than {MOST_BYTES} bytes"))),
        Ok(_) => {}
    }
    std::fs::read(path).map(Some).map_err(|e| bad(format!("cannot be read ({e})")))
}

/// Data stored as JSON.
#[cfg(feature = "window")]
pub(crate) trait Kept: Serialize + DeserializeOwned {
    /// The current version of the format.
    const VERSION: u32;

    /// Returns the version of the format that it was written in.
    fn version(&self) -> u32;
}

/// Reads stored data from a file; `None` if it does not exist. `hint` becomes the hint of an error.
///
/// # Errors
/// Returns status 3 if it cannot be read, is damaged or has another version.
#[cfg(feature = "window")]
pub(crate) fn read_kept<T: Kept>(path: &Path, hint: &str) -> Result<Option<T>> {
    let Some(bytes) = read(path, hint)? else { return Ok(None) };
    let bad = |why: String| Error::file(path, why, hint);
    let kept: T = serde_json::from_slice(&bytes).map_err(|e| bad(e.to_string()))?;
    if kept.version() == T::VERSION {
        Ok(Some(kept))
    } else {
        Err(bad(format!("has version {}; this program reads version {}", kept.version(), T::VERSION)))
    }
}

/// Writes the data to a file, and creates its folder.
///
/// # Errors
/// Returns status 5 if it cannot be written. An existing file stays unchanged.
#[cfg(feature = "window")]
pub(crate) fn keep<T: Kept>(path: &Path, kept: &T) -> Result<()> {
    if let Some(folder) = path.parent() {
        output::make_folder(folder)?;
    }
    output::write_json(path, kept)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn relative_folders_are_ignored() {
        let with = |list: &'static [(&str, &str)]| {
            Folder::State.of(move |name| list.iter().find(|v| v.0 == name).map(|v| PathBuf::from(v.1)))
        };
        assert_eq!(with(&[]), None);
        if cfg!(target_os = "linux") {
            assert_eq!(with(&[("XDG_STATE_HOME", "x"), ("HOME", "/h")]), Some(PathBuf::from("/h/.local/state")));
            assert_eq!(with(&[("XDG_STATE_HOME", "/s"), ("HOME", "/h")]), Some(PathBuf::from("/s")));
        }
    }

    #[test]
    fn only_small_files_are_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a");
        assert_eq!(read(&path, "").unwrap(), None);
        std::fs::write(&path, "b").unwrap();
        assert_eq!(read(&path, "").unwrap().unwrap(), b"b");
        std::fs::write(&path, vec![0; MOST_BYTES as usize + 1]).unwrap();
        assert!(read(&path, "").is_err() && read(dir.path(), "").is_err());
    }
}
