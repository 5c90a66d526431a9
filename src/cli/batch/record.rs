//! A case's folder and its `case.json`, written whole or not at all.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, UNIX_EPOCH};

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use sha2::{Digest, Sha256};

use super::steps::{RowOption, Step};
use crate::error::{Error, Result};
use crate::output;
use crate::progress::Progress;

/// Name of the record in a case's folder.
pub(super) const FILE: &str = "case.json";
/// What precedes the name of a folder that is being written.
pub(super) const WORK: &str = ".work-";
/// What precedes the name of a folder that is being replaced.
pub(super) const OLD: &str = ".old-";

/// What is known of a case: `case.json`.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub(super) struct Record {
    pub id: String,
    /// `done` or `failed`.
    pub state: State,
    /// Version of the program.
    pub version: String,
    pub input: Input,
    /// The row's options as they were given.
    pub options: Vec<String>,
    /// What was made, by the steps' names.
    pub steps: BTreeMap<String, Made>,
    /// The first failure.
    pub failure: Option<Failure>,
    /// Those of later steps.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub also_failed: Vec<Failure>,
}

impl Record {
    /// Returns the failures of all steps, in their order.
    pub(super) fn failures(&self) -> impl Iterator<Item = &Failure> {
        self.failure.iter().chain(&self.also_failed)
    }
}

#[derive(Clone, Copy, Debug, Deserialize, Serialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub(super) enum State {
    Done,
    Failed,
}

/// The scan of a case. Names no file.
#[derive(Clone, Debug, Default, Deserialize, Serialize, PartialEq, Eq)]
pub(super) struct Input {
    /// Hash of its voxels and grid, whatever the format; empty if it cannot be read.
    pub content: String,
    /// Number of voxels.
    pub voxels: u64,
    /// The options with which it was read, and the number of its series: the content depends on them, too.
    pub read_with: Vec<String>,
    /// Number of its files, their bytes, and when the last was changed, ns since 1970: with these unchanged, it is not read again.
    pub files: u64,
    pub bytes: u64,
    pub modified_ns: u64,
}

/// What a step made.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub(super) struct Made {
    /// Hash of everything that the outputs depend on.
    pub key: String,
    /// SHA-256 of each output file, by its path in the folder.
    pub outputs: BTreeMap<String, String>,
    /// The command's statistics.
    pub results: Map<String, Value>,
    /// Its times, s, and its peak memory: all that differs from run to run.
    pub times: Map<String, Value>,
}

/// Why a step failed.
#[derive(Clone, Debug, Deserialize, Serialize, PartialEq, Eq)]
pub(super) struct Failure {
    /// `input` or the step's name.
    pub step: String,
    pub class: Class,
    /// The error in one line, without the scan's path.
    pub line: String,
    /// As in [`Made`].
    pub key: String,
}

/// Kinds of failures.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, PartialEq, Eq, PartialOrd, Ord)]
#[serde(rename_all = "lowercase")]
pub(super) enum Class {
    /// An internal error.
    Fault,
    /// The row's options are wrong.
    Usage,
    /// The scan cannot be read or used.
    Input,
    /// There is no colon, or no way through it.
    Incomplete,
    /// An output could not be written.
    Output,
    /// It took longer than allowed.
    Timeout,
    /// It took more memory than allowed.
    Memory,
    /// Something outside ended it, for example the system for want of memory.
    Killed,
}

impl Class {
    /// The class of an exit status.
    pub(super) fn of(status: u8) -> Self {
        match status {
            2 => Self::Usage,
            3 => Self::Input,
            4 => Self::Incomplete,
            5 => Self::Output,
            _ => Self::Fault,
        }
    }

    /// True if the same input and options fail in the same way again.
    pub(super) fn is_final(self) -> bool {
        matches!(self, Self::Usage | Self::Input | Self::Incomplete)
    }
}

/// Returns the key of a step: a hash of everything that its outputs depend on. Fails with status 3 if a file that the options name cannot be
/// read.
pub(super) fn key(step: Step, content: &str, series: Option<&str>, options: &[RowOption]) -> Result<String> {
    let mut hash = Sha256::new();
    let mut add = |text: &str| {
        hash.update((text.len() as u64).to_le_bytes());
        hash.update(text.as_bytes());
    };
    add(env!("CARGO_PKG_VERSION"));
    add(step.name());
    add(content);
    add(series.unwrap_or(""));
    for option in options {
        add(option.name);
        match option.file() {
            // Its content counts, wherever it lies.
            Some(file) => add(&hash_of(&file).map_err(|e| Error::file(&file, e.to_string(), "check the name"))?),
            None => add(option.value.as_deref().unwrap_or("")),
        }
    }
    Ok(hex(&hash.finalize()))
}

/// Returns the SHA-256 of a file.
fn hash_of(file: &Path) -> io::Result<String> {
    let mut from = BufReader::with_capacity(1 << 16, fs::File::open(file)?);
    let mut hash = Sha256::new();
    loop {
        let part = from.fill_buf()?;
        if part.is_empty() {
            return Ok(hex(&hash.finalize()));
        }
        hash.update(part);
        let length = part.len();
        from.consume(length);
    }
}

pub(super) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Returns the number, the size and the age of a scan's files, without its content.
pub(super) fn seen(scan: &Path) -> Input {
    fn add(path: &Path, to: &mut Input) {
        let Ok(meta) = fs::metadata(path) else { return };
        if meta.is_dir() {
            let Ok(entries) = fs::read_dir(path) else { return };
            entries.flatten().for_each(|e| add(&e.path(), to));
            return;
        }
        let age = meta.modified().ok().and_then(|m| m.duration_since(UNIX_EPOCH).ok()).map_or(0, |d| d.as_nanos());
        to.files += 1;
        to.bytes += meta.len();
        to.modified_ns = to.modified_ns.max(u64::try_from(age).unwrap_or(u64::MAX));
    }
    let mut found = Input::default();
    add(scan, &mut found);
    found
}

/// Time between two looks whether another run still makes a case.
const WAIT: Duration = Duration::from_millis(100);

/// Keeps other runs from a case.
#[derive(Debug)]
pub(super) struct Lock {
    _folder: Option<fs::File>,
}

/// The folders of one case.
pub(super) struct Folder {
    whole: PathBuf,
    work: PathBuf,
    old: PathBuf,
}

impl Folder {
    pub(super) fn new(out: &Path, id: &str) -> Self {
        let beside = |before: &str| out.join(format!("{before}{id}"));
        Self { whole: out.join(id), work: beside(WORK), old: beside(OLD) }
    }

    /// Puts an interrupted replacement right, and returns what was recorded.
    pub(super) fn record(&self) -> Option<Record> {
        if !self.whole.exists() && self.old.exists() {
            fs::rename(&self.old, &self.whole).ok()?;
        }
        serde_json::from_slice(&fs::read(self.whole.join(FILE)).ok()?).ok()
    }

    /// True if the outputs of a step are there.
    pub(super) fn has(&self, made: &Made) -> bool {
        made.outputs.keys().all(|file| self.whole.join(file).is_file())
    }

    /// The folder that is written.
    pub(super) fn work(&self) -> &Path {
        &self.work
    }

    /// Waits until no other run makes this case, but not beyond `deadline`: `None` then. Fails with status 4 if interrupted, 5 if there can
    /// be no folder.
    pub(super) fn lock(&self, deadline: Option<Instant>, progress: &Progress) -> Result<Option<Lock>> {
        loop {
            output::make_folder(&self.work)?;
            match self.try_lock().map_err(|e| output::cannot(&self.work, e))? {
                Some(lock) => return Ok(Some(lock)),
                None if deadline.is_some_and(|d| Instant::now() > d) => return Ok(None),
                None => std::thread::sleep(WAIT),
            }
            progress.check()?;
        }
    }

    /// Returns a lock of the folder that is written, or none if another run has it. It goes with the folder when that gets its name.
    #[cfg(unix)]
    fn try_lock(&self) -> io::Result<Option<Lock>> {
        use std::os::unix::fs::MetadataExt;
        let folder = match fs::File::open(&self.work) {
            Ok(folder) => folder,
            // Another run has just given it up.
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(e),
        };
        match folder.try_lock() {
            Ok(()) => {}
            Err(fs::TryLockError::WouldBlock) => return Ok(None),
            // A file system without locks: whoever starts two runs there must keep them apart.
            Err(fs::TryLockError::Error(_)) => return Ok(Some(Lock { _folder: Some(folder) })),
        }
        let inode = |meta: fs::Metadata| (meta.dev(), meta.ino());
        // Meanwhile another run may have given it its name.
        let is_there =
            fs::metadata(&self.work).is_ok_and(|there| folder.metadata().is_ok_and(|m| inode(m) == inode(there)));
        Ok(is_there.then_some(Lock { _folder: Some(folder) }))
    }

    #[cfg(not(unix))]
    fn try_lock(&self) -> io::Result<Option<Lock>> {
        Ok(Some(Lock { _folder: None }))
    }

    /// Returns an empty folder to write into. Fails with status 5 if there can be none.
    pub(super) fn begin(&self, _lock: &Lock) -> Result<&Path> {
        if self.old.exists() {
            fs::remove_dir_all(&self.old).map_err(|e| output::cannot(&self.old, e))?;
        }
        let cannot = |e| output::cannot(&self.work, e);
        for entry in fs::read_dir(&self.work).map_err(cannot)? {
            let path = entry.map_err(cannot)?.path();
            let gone = if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
            gone.map_err(|e| output::cannot(&path, e))?;
        }
        Ok(&self.work)
    }

    /// Gives the folder up that was to be written.
    pub(super) fn give_up(&self, _lock: Lock) {
        // The next run clears it otherwise.
        let _ = fs::remove_dir_all(&self.work);
    }

    /// Takes a step's outputs over from the folder that is there. Fails with status 5.
    pub(super) fn keep(&self, made: &Made) -> Result<()> {
        for file in made.outputs.keys() {
            let (from, to) = (self.whole.join(file), self.work.join(file));
            if let Some(parent) = to.parent() {
                output::make_folder(parent)?;
            }
            // Not every file system has links.
            fs::hard_link(&from, &to)
                .or_else(|_| fs::copy(&from, &to).map(drop))
                .map_err(|e| output::cannot(&to, e))?;
        }
        Ok(())
    }

    /// Removes what a failed step left. Fails with status 5.
    pub(super) fn drop_outputs(&self, step: Step) -> Result<()> {
        for name in step.outputs() {
            let path = self.work.join(name);
            let gone = if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
            if let Err(e) = gone
                && e.kind() != io::ErrorKind::NotFound
            {
                return Err(output::cannot(&path, e));
            }
        }
        Ok(())
    }

    /// Returns the SHA-256 of each file that a step has written, by its path in the folder. Fails with status 5.
    pub(super) fn outputs(&self, step: Step) -> Result<BTreeMap<String, String>> {
        let mut found = BTreeMap::new();
        let mut left: Vec<PathBuf> = step.outputs().iter().map(|name| self.work.join(name)).collect();
        while let Some(path) = left.pop() {
            if path.is_dir() {
                let entries = fs::read_dir(&path).map_err(|e| output::cannot(&path, e))?;
                left.extend(entries.flatten().map(|e| e.path()));
            } else if path.is_file() {
                let name = path.strip_prefix(&self.work).unwrap_or(&path).to_string_lossy().replace('\\', "/");
                found.insert(name, hash_of(&path).map_err(|e| output::cannot(&path, e))?);
            }
        }
        Ok(found)
    }

    /// Writes the record and puts the folder in its place. Fails with status 5.
    pub(super) fn finish(&self, record: &Record) -> Result<()> {
        output::write_json(&self.work.join(FILE), record)?;
        if self.whole.exists() {
            fs::rename(&self.whole, &self.old).map_err(|e| output::cannot(&self.whole, e))?;
        }
        fs::rename(&self.work, &self.whole).map_err(|e| output::cannot(&self.whole, e))?;
        if self.old.exists() {
            fs::remove_dir_all(&self.old).map_err(|e| output::cannot(&self.old, e))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::batch::steps::row_options;

    fn record() -> Record {
        Record {
            id: "a".to_owned(),
            state: State::Done,
            version: "1".to_owned(),
            input: Input::default(),
            options: Vec::new(),
            steps: BTreeMap::new(),
            failure: None,
            also_failed: Vec::new(),
        }
    }

    #[test]
    fn a_key_depends_on_what_the_step_takes_and_on_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let of = |step: Step, options: &str| {
            let options = row_options(options, dir.path()).unwrap();
            key(step, "sha256:1", None, &step.own_options(&options)).unwrap()
        };
        assert_eq!(of(Step::Segment, "--max 5"), of(Step::Segment, ""));
        assert_ne!(of(Step::Candidates, "--max 5"), of(Step::Candidates, "--max 6"));
        assert_ne!(of(Step::Segment, ""), of(Step::Surface, ""));
        // A file by its content.
        fs::write(dir.path().join("a.toml"), "x").unwrap();
        fs::write(dir.path().join("b.toml"), "x").unwrap();
        let before = of(Step::Fly, "--scene a.toml");
        assert_eq!(before, of(Step::Fly, "--scene b.toml"));
        fs::write(dir.path().join("a.toml"), "y").unwrap();
        assert_ne!(before, of(Step::Fly, "--scene a.toml"));
        let gone = row_options("--scene c.toml", dir.path()).unwrap();
        assert!(key(Step::Fly, "", None, &gone).is_err());
    }

    /// Whenever it is interrupted, the folder is the one before or the one after.
    #[test]
    fn a_folder_is_whole() {
        let dir = tempfile::tempdir().unwrap();
        let folder = Folder::new(dir.path(), "a");
        assert!(folder.record().is_none());
        let lock = || folder.lock(None, &Progress::new()).unwrap().unwrap();
        let held = lock();
        let work = folder.begin(&held).unwrap();
        fs::write(work.join("segment.nii.gz"), "voxels").unwrap();
        assert!(folder.record().is_none(), "not before it is finished");
        let outputs = folder.outputs(Step::Segment).unwrap();
        assert_eq!(outputs.keys().collect::<Vec<_>>(), ["segment.nii.gz"]);
        let made = Made { key: "k".to_owned(), outputs, results: Map::new(), times: Map::new() };
        let mut first = record();
        first.steps.insert("segment".to_owned(), made.clone());
        folder.finish(&first).unwrap();
        assert!(folder.has(&folder.record().unwrap().steps["segment"]));
        drop(held);
        // Interrupted before the end: what is there stays, and the next one begins anew.
        fs::write(folder.begin(&lock()).unwrap().join("half"), "").unwrap();
        assert!(folder.has(&folder.record().unwrap().steps["segment"]));
        // Interrupted while the old one has made way.
        fs::rename(&folder.whole, &folder.old).unwrap();
        assert!(folder.record().is_some());
        let held = lock();
        let work = folder.begin(&held).unwrap();
        assert!(!work.join("half").exists());
        folder.keep(&made).unwrap();
        folder.finish(&first).unwrap();
        assert_eq!(fs::read(folder.whole.join("segment.nii.gz")).unwrap(), b"voxels");
        folder.give_up(lock());
        let names: Vec<_> = fs::read_dir(dir.path()).unwrap().flatten().map(|e| e.file_name()).collect();
        assert_eq!(names, ["a"]);
    }

    #[cfg(unix)]
    #[test]
    fn one_run_makes_a_case_and_others_wait() {
        let dir = tempfile::tempdir().unwrap();
        let folder = || Folder::new(dir.path(), "a");
        let progress = Progress::new();
        let lock = |seconds: f64| {
            let deadline = Instant::now() + Duration::from_secs_f64(seconds);
            folder().lock(Some(deadline), &progress).unwrap()
        };
        let first = lock(0.0).unwrap();
        assert!(lock(0.0).is_none());
        std::thread::scope(|scope| {
            let waiting = scope.spawn(|| lock(60.0).is_some());
            folder().begin(&first).unwrap();
            folder().finish(&record()).unwrap();
            drop(first);
            assert!(waiting.join().unwrap(), "it has a folder of its own, and not the one that was finished");
        });
        assert!(folder().record().is_some());
        progress.cancel();
        let held = Folder::new(dir.path(), "a").lock(None, &Progress::new()).unwrap();
        assert!(held.is_some() && folder().lock(None, &progress).is_err());
    }
}
