//! Voxels of phantoms that are kept from one test program to the next, below `target/phantoms`: making them is half of the time of
//! many tests.
//!
//! A folder belongs to one version of the code that makes phantoms, and a file to settings. A file appears at once, so programs that
//! run side by side may make the same one. Where nothing can be kept, phantoms are made each time.

use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash, Hasher};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// More bytes are not kept: a phantom of the size of a real scan takes 210 MB.
const MOST_BYTES: usize = 64 << 20;

/// What makes the voxels of a phantom, from the root of the workspace.
const SOURCES: [&str; 4] = ["Cargo.lock", "src/phantom", "src/scan/math", "src/scan/volume/grid.rs"];

/// Returns the voxels of a phantom with these settings, kept or made.
pub(crate) fn voxels(settings: &str, len: usize, make: impl FnOnce() -> Vec<i16>) -> Vec<i16> {
    let Some(folder) = folder().filter(|_| 2 * len <= MOST_BYTES) else { return make() };
    let mut hasher = DefaultHasher::new();
    settings.hash(&mut hasher);
    let path = folder.join(format!("{:016x}.i16", hasher.finish()));
    if let Some(kept) = std::fs::read(&path).ok().filter(|bytes| bytes.len() == 2 * len) {
        return kept.as_chunks().0.iter().map(|b| i16::from_le_bytes(*b)).collect();
    }
    let made = make();
    let bytes: Vec<u8> = made.iter().flat_map(|v| v.to_le_bytes()).collect();
    // A full disk is no failure of a test.
    let _ = keep(folder, &path, &bytes);
    made
}

fn keep(folder: &Path, path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let mut file = tempfile::NamedTempFile::new_in(folder)?;
    file.write_all(bytes)?;
    file.persist(path)?;
    Ok(())
}

/// Returns the folder of this version of the code, and removes those of others.
fn folder() -> Option<&'static Path> {
    static FOLDER: OnceLock<Option<PathBuf>> = OnceLock::new();
    FOLDER.get_or_init(open).as_deref()
}

fn open() -> Option<PathBuf> {
    // target/PROFILE/deps/TEST
    let all = std::env::current_exe().ok()?.ancestors().nth(3)?.join("phantoms");
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().find(|a| a.join("Cargo.lock").is_file())?;
    let mut hasher = DefaultHasher::new();
    for source in SOURCES {
        hash(&root.join(source), &mut hasher).ok()?;
    }
    let own = all.join(format!("{:016x}", hasher.finish()));
    if !own.is_dir() {
        for other in std::fs::read_dir(&all).into_iter().flatten().flatten() {
            let _ = std::fs::remove_dir_all(other.path());
        }
        std::fs::create_dir_all(&own).ok()?;
    }
    Some(own)
}

/// Hashes a file, or all files below a folder.
fn hash(path: &Path, hasher: &mut DefaultHasher) -> std::io::Result<()> {
    if path.is_dir() {
        let mut below = std::fs::read_dir(path)?.map(|e| Ok(e?.path())).collect::<std::io::Result<Vec<_>>>()?;
        below.sort();
        return below.iter().try_for_each(|p| hash(p, hasher));
    }
    std::fs::read(path)?.hash(hasher);
    Ok(())
}
