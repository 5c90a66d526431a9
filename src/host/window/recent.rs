//! The list of recently opened scans.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::host::folders::{self, Folder};

/// The current version of the file format.
const VERSION: u32 = 1;
/// Consequence of an invalid file, for messages.
const HINT: &str = "the file is left unchanged, and recent scans are not saved";
/// Maximum number of scans in the list.
const MOST: usize = 12;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Kept {
    version: u32,
    scans: Vec<PathBuf>,
}

impl folders::Kept for Kept {
    const VERSION: u32 = VERSION;

    fn version(&self) -> u32 {
        self.version
    }
}

/// Recently opened scans, the last one first.
#[derive(Debug, Default)]
pub(crate) struct Recent {
    scans: Vec<PathBuf>,
    /// The file of the list; `None` if it is not stored.
    file: Option<PathBuf>,
}

impl Recent {
    /// Returns the default file of the list; `None` on a system that defines no folder for it.
    pub(crate) fn usual_file() -> Option<PathBuf> {
        Folder::State.file("recent.json")
    }

    /// Reads the list stored in a file, with the error if the file is invalid. In that case the list is empty and the file is not
    /// overwritten.
    pub(crate) fn open(file: Option<PathBuf>) -> (Self, Option<Error>) {
        match file.as_deref().map_or(Ok(Vec::new()), read) {
            Ok(scans) => (Self { scans, file }, None),
            Err(e) => (Self::default(), Some(e)),
        }
    }

    /// Returns all scans of the list.
    pub(crate) fn scans(&self) -> &[PathBuf] {
        &self.scans
    }

    /// Adds an opened scan.
    ///
    /// # Errors
    /// Returns status 5 if the list cannot be stored.
    pub(crate) fn opened(&mut self, scan: &Path) -> Result<()> {
        let scan = std::path::absolute(scan).unwrap_or_else(|_| scan.to_owned());
        self.scans.retain(|s| *s != scan);
        self.scans.insert(0, scan);
        self.scans.truncate(MOST);
        let Some(path) = &self.file else { return Ok(()) };
        folders::keep(path, &Kept { version: VERSION, scans: self.scans.clone() })
    }
}

fn read(path: &Path) -> Result<Vec<PathBuf>> {
    let kept: Option<Kept> = folders::read_kept(path, HINT)?;
    Ok(kept.into_iter().flat_map(|k| k.scans).take(MOST).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_one_is_first_and_stands_once() {
        let dir = tempfile::tempdir().unwrap();
        let file = Some(dir.path().join("a").join("recent.json"));
        let (mut recent, error) = Recent::open(file.clone());
        assert!(error.is_none() && recent.scans().is_empty());
        for name in ["/a", "/b", "/a"] {
            recent.opened(Path::new(name)).unwrap();
        }
        assert_eq!(recent.scans(), [Path::new("/a"), Path::new("/b")]);
        (0..40).for_each(|n| recent.opened(Path::new(&format!("/{n}"))).unwrap());
        let (again, _) = Recent::open(file);
        assert_eq!((again.scans(), again.scans().len()), (recent.scans(), MOST));
    }

    #[test]
    fn a_damaged_list_is_left_as_it_is() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("recent.json");
        std::fs::write(&path, "[").unwrap();
        let (mut recent, error) = Recent::open(Some(path.clone()));
        assert!(error.is_some());
        recent.opened(Path::new("/a")).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "[");
    }
}
