//! Cleanup of abandoned temporary files. If a writer was killed or the machine went down, the next program that writes
//! into the same folder removes its temporary files.
//!
//! A writer holds an advisory lock on its temporary file while writing, and the system releases the lock however the
//! writer ends. A file is removed only under that lock, so a live writer's file is never removed, whichever process or
//! container of this machine owns it.
//!
//! The file name contains the machine's name. On a shared disk, locks may not work across machines, so files of other
//! machines are left alone. Files on a disk without locks are left alone too.

use std::collections::BTreeSet;
use std::fs::{File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{LazyLock, Mutex, PoisonError};

/// Number of attempts at creating a file when another program removes each one before it is locked.
const TRIES: usize = 16;
/// Suffix of temporary file names.
pub(super) const SUFFIX: &str = ".tmp";

/// Prefix of this machine's temporary file names.
static PREFIX: LazyLock<String> = LazyLock::new(|| prefix(&machine()));

/// Folders that this program has already checked.
static LOOKED_AT: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// Returns the prefix of a machine's temporary file names. It ends with a dot, which the machine part cannot contain,
/// so the prefix of machine `a` does not match files of machine `ab`.
fn prefix(machine: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || c == '-' { c } else { '-' };
    format!(".colvis-{}.", machine.chars().take(40).map(plain).collect::<String>())
}

/// Returns the machine's name, or `here` if the system does not report one.
fn machine() -> String {
    let files = ["/proc/sys/kernel/hostname", "/etc/hostname"].into_iter().map(std::fs::read_to_string);
    let reported =
        files.filter_map(io::Result::ok).chain(["COMPUTERNAME", "HOSTNAME"].map(std::env::var).into_iter().flatten());
    reported.map(|name| name.trim().to_owned()).find(|name| !name.is_empty()).unwrap_or_else(|| "here".to_owned())
}

/// Creates a temporary file in `folder`, locked if the disk supports locks. `set_up` configures the builder further. Fails if the
/// file cannot be created.
pub(super) fn locked(
    folder: &Path,
    set_up: impl Fn(&mut tempfile::Builder<'_, '_>),
) -> io::Result<tempfile::NamedTempFile> {
    let prefix = format!("{}{}-", *PREFIX, std::process::id());
    for _ in 0..TRIES {
        let mut builder = tempfile::Builder::new();
        builder.prefix(&prefix).suffix(SUFFIX);
        set_up(&mut builder);
        let file = builder.tempfile_in(folder)?;
        match file.as_file().try_lock() {
            // Before we locked it, another program may have removed it as abandoned.
            Ok(()) if is_at(file.as_file(), file.path()) => return Ok(file),
            Ok(()) | Err(TryLockError::WouldBlock) => {}
            // The disk has no locks, so no program removes files there.
            Err(TryLockError::Error(_)) => return Ok(file),
        }
    }
    Err(io::Error::other("another program removes its temporary files"))
}

/// Removes abandoned files in `folder`, once for each folder. Files that cannot be removed stay.
pub(super) fn remove_once(folder: &Path) {
    let place = std::fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned());
    if LOOKED_AT.lock().unwrap_or_else(PoisonError::into_inner).insert(place) {
        remove(folder, &PREFIX);
    }
}

fn remove(folder: &Path, prefix: &str) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let is_ours = name.to_str().is_some_and(|n| n.starts_with(prefix) && n.ends_with(SUFFIX));
        // Skip links and anything that could block on open.
        if is_ours && entry.file_type().is_ok_and(|t| t.is_file()) {
            // Another program may be removing it at the same time.
            let _ = remove_abandoned(&entry.path());
        }
    }
}

/// Removes a file if no process holds its lock.
fn remove_abandoned(path: &Path) -> io::Result<()> {
    // Some disks only lock files opened for writing.
    let file = File::options().read(true).write(true).open(path)?;
    // Since it was opened, the file may have been renamed and another created under the temporary name.
    if file.try_lock().is_ok() && is_at(&file, path) { std::fs::remove_file(path) } else { Ok(()) }
}

/// True if `path` leads to this exact file.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let place = |m: std::fs::Metadata| (m.dev(), m.ino());
    match (file.metadata(), std::fs::symlink_metadata(path)) {
        (Ok(own), Ok(there)) => place(own) == place(there),
        _ => false,
    }
}

/// True if `path` exists. On these systems an open file keeps its name.
#[cfg(not(unix))]
fn is_at(_: &File, path: &Path) -> bool {
    path.exists()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn there(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> =
            std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn only_what_nobody_writes_is_taken_away() {
        let dir = tempfile::tempdir().unwrap();
        let living = locked(dir.path(), |_| {}).unwrap();
        let name = living.path().file_name().unwrap().to_str().unwrap().to_owned();
        assert!(name.starts_with(&*PREFIX) && name.contains(&format!(".{}-", std::process::id())));
        let [gone, other, own] =
            [format!("{}7-abc.tmp", *PREFIX), format!("{}7-abc.tmp", prefix("elsewhere.org")), "scan.tmp".to_owned()];
        for n in [&gone, &other, &own] {
            std::fs::write(dir.path().join(n), "x").unwrap();
        }
        std::fs::create_dir(dir.path().join(format!("{}7-folder.tmp", *PREFIX))).unwrap();
        remove(dir.path(), &PREFIX);
        let left = there(dir.path());
        assert!(!left.contains(&gone), "its writer is gone: {left:?}");
        assert!([&name, &other, &own].into_iter().all(|n| left.contains(n)) && left.len() == 4, "{left:?}");
        // Once its writer releases it, any program may remove it.
        let (file, path) = living.keep().unwrap();
        remove(dir.path(), &PREFIX);
        assert!(path.exists());
        drop(file);
        remove(dir.path(), &PREFIX);
        assert!(!path.exists());
    }

    #[test]
    fn a_machine_is_told_from_another_by_the_name() {
        assert_eq!(prefix("vm.a/b"), ".colvis-vm-a-b.");
        assert!(!format!("{}1-x.tmp", prefix("vma")).starts_with(&prefix("vm")));
    }

    #[cfg(unix)]
    #[test]
    fn a_file_that_has_got_its_name_is_not_the_one_that_was_opened() {
        let dir = tempfile::tempdir().unwrap();
        let (a, b) = (dir.path().join("a"), dir.path().join("b"));
        std::fs::write(&a, "x").unwrap();
        let file = File::open(&a).unwrap();
        assert!(is_at(&file, &a));
        std::fs::rename(&a, &b).unwrap();
        assert!(!is_at(&file, &a));
        std::fs::write(&a, "y").unwrap();
        assert!(!is_at(&file, &a) && is_at(&file, &b));
    }
}
