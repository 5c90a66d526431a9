//! What the commands of one process share of a scan: the steps of a batch read it once and find its colon once.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use crate::app::found::Found;
use crate::error::Result;
use crate::volume::Volume;
use crate::volume::io::{LoadOptions, Loaded};

/// What commands of this process share. A single command shares nothing, and keeps nothing.
#[derive(Clone, Debug, Default)]
pub(super) struct Shared(Option<Arc<Mutex<Option<Kept>>>>);

/// A scan that was read.
#[derive(Debug)]
struct Kept {
    path: PathBuf,
    options: LoadOptions,
    notes: Vec<String>,
    /// Unless a command changes it.
    volume: Option<Arc<Volume>>,
    found: Arc<Found>,
}

/// What a command does with a scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Use {
    /// Its voxels stay as read.
    Look,
    /// It may change them: they are read again for the next command, because a second copy would take as much memory as the scan.
    Change,
}

/// A scan, the notes from reading it, and what is known of it.
pub(super) type Read = (Arc<Volume>, Vec<String>, Arc<Found>);

impl Shared {
    /// Creates one that keeps the last scan.
    pub(super) fn keeping() -> Self {
        Self(Some(Arc::default()))
    }

    /// Returns the scan of `path`, which `read` reads unless it is kept. The file must not change meanwhile.
    pub(super) fn read(
        &self,
        path: &Path,
        options: &LoadOptions,
        purpose: Use,
        read: impl FnOnce() -> Result<Loaded>,
    ) -> Result<Read> {
        let Some(kept) = &self.0 else {
            return read().map(|loaded| (Arc::new(loaded.volume), loaded.notes, Arc::default()));
        };
        let mut kept = kept.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.as_ref().is_some_and(|k| k.path != path || k.options != *options) {
            *kept = None;
        }
        let mut known = match kept.take() {
            Some(known) => known,
            None => Kept {
                path: path.to_owned(),
                options: options.clone(),
                notes: Vec::new(),
                volume: None,
                found: Arc::new(Found::keeping()),
            },
        };
        let volume = match known.volume.take() {
            Some(volume) => volume,
            None => {
                let loaded = read()?;
                known.notes = loaded.notes;
                Arc::new(loaded.volume)
            }
        };
        if purpose == Use::Look {
            known.volume = Some(Arc::clone(&volume));
        }
        let told = (volume, known.notes.clone(), Arc::clone(&known.found));
        *kept = Some(known);
        Ok(told)
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::volume::Grid;

    #[test]
    fn a_scan_is_read_once_until_a_command_changes_it() {
        let grid = Grid::new([2; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let times = |shared: &Shared, uses: &[(&str, Use)]| {
            let mut times = 0;
            for (path, purpose) in uses {
                let read = || {
                    times += 1;
                    Ok(Loaded { volume: Volume::new(grid.clone(), vec![0; 8]), notes: vec!["n".to_owned()] })
                };
                let (volume, notes, _) = shared.read(Path::new(path), &LoadOptions::default(), *purpose, read).unwrap();
                assert_eq!(notes, ["n"]);
                assert!(*purpose == Use::Look || Arc::strong_count(&volume) == 1, "it is changed in place");
            }
            times
        };
        let same = [("a", Use::Look), ("a", Use::Look), ("a", Use::Change), ("a", Use::Change), ("a", Use::Look)];
        assert_eq!(times(&Shared::default(), &same), 5);
        assert_eq!(times(&Shared::keeping(), &same), 3);
        assert_eq!(times(&Shared::keeping(), &[("a", Use::Look), ("b", Use::Look), ("a", Use::Look)]), 3);
        let shared = Shared::keeping();
        let wide = LoadOptions { allow_gaps: true, ..LoadOptions::default() };
        assert_eq!(times(&shared, &same[..1]), 1);
        let wrong = shared.read(Path::new("a"), &wide, Use::Look, || {
            Err(crate::error::Error::input("a", "cannot be read", "check it"))
        });
        assert!(wrong.is_err(), "read in another way, it is another scan");
    }
}
