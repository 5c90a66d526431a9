//! The index of a medium (DICOMDIR, PS3.10): the files that it lists.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsString;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::dataset::Tag;
use super::parse::parse;
use crate::error::{Error, Result};
use crate::volume::io::source;

const FILE_SET_ID: Tag = (0x0004, 0x1130);
const RECORDS: Tag = (0x0004, 0x1220);
const FILE_ID: Tag = (0x0004, 0x1500);
/// Maximum size of an index, bytes; more than any medium has.
const MOST_BYTES: u64 = 1 << 28;
/// Maximum number of files that are listed; more than any scan has.
const MOST_FILES: usize = 200_000;
/// Maximum number of parts of a listed name (PS3.10, 8.2, allows eight).
const MOST_PARTS: usize = 16;

/// The files that an index lists.
#[derive(Debug, Default)]
pub(crate) struct Index {
    /// Those that are there, each once, in the order of the list.
    pub files: Vec<PathBuf>,
    /// Names of those that are missing.
    pub missing: Vec<String>,
    /// Number of names that lead out of the index's folder.
    pub outside: usize,
}

/// Reads the index of a medium; `None` if the file is not an index. Fails with status 3 if the file cannot be read, or if it is too
/// large.
pub(crate) fn read(path: &Path) -> Result<Option<Index>> {
    let (file, len) = source::open(path)?;
    if len > MOST_BYTES {
        return Err(Error::file(path, format!("is an index of {len} bytes"), "give the folder of one scan"));
    }
    let mut bytes = Vec::new();
    file.take(len).read_to_end(&mut bytes).map_err(|e| source::unreadable(path, e))?;
    let Ok((set, _)) = parse(&bytes) else { return Ok(None) };
    let records = set.root.items(RECORDS);
    if records.is_empty() && set.root.text(FILE_SET_ID).is_none() {
        return Ok(None);
    }
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let root = folder.canonicalize().map_err(|e| source::unreadable(path, e))?;
    let (mut index, mut known, mut names) = (Index::default(), BTreeSet::new(), Names::default());
    for id in records.iter().filter_map(|r| r.text(FILE_ID)) {
        if index.files.len() + index.missing.len() + index.outside >= MOST_FILES {
            return Err(Error::file(
                path,
                format!("lists more than {MOST_FILES} files"),
                "give the folder of one scan",
            ));
        }
        let Some(parts) = parts(&id) else {
            index.outside += 1;
            continue;
        };
        match names.find(folder, &parts) {
            None => index.missing.push(parts.join("/")),
            // A link may lead out of the folder.
            Some(found) if !found.canonicalize().is_ok_and(|f| f.starts_with(&root)) => index.outside += 1,
            Some(found) => {
                if known.insert(found.clone()) {
                    index.files.push(found);
                }
            }
        }
    }
    Ok(Some(index))
}

impl Index {
    /// Returns a note on what the index lists and what cannot be opened; `None` if all of it can.
    pub(crate) fn note(&self, path: &Path) -> Option<String> {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let missing = (self.missing.first()).map(|first| {
            let first: String = first.chars().filter(|c| !c.is_control()).take(80).collect();
            format!("{} files that are missing, the first: {first}", self.missing.len())
        });
        let outside =
            (self.outside > 0).then(|| format!("{} files outside its folder, which were left out", self.outside));
        let both: Vec<String> = missing.into_iter().chain(outside).collect();
        (!both.is_empty()).then(|| format!("{name} lists {}", both.join(", and ")))
    }
}

/// Returns the parts of a listed name; `None` if they may lead out of the folder.
fn parts(id: &str) -> Option<Vec<&str>> {
    let parts: Vec<&str> = id.split('\\').map(str::trim).collect();
    let plain = |p: &&str| !p.is_empty() && *p != "." && *p != ".." && !p.contains(['/', ':', '\0']);
    (parts.len() <= MOST_PARTS && parts.iter().all(plain)).then_some(parts)
}

/// Names of files in folders. Media are mounted in small letters or capitals, some with a version behind each name.
#[derive(Default)]
struct Names {
    folders: BTreeMap<PathBuf, BTreeMap<String, OsString>>,
}

impl Names {
    fn find(&mut self, folder: &Path, parts: &[&str]) -> Option<PathBuf> {
        let exact = parts.iter().fold(folder.to_owned(), |p, part| p.join(part));
        if exact.is_file() {
            return Some(exact);
        }
        let mut at = folder.to_owned();
        for part in parts {
            let names = self.folders.entry(at.clone()).or_insert_with(|| {
                let entries = std::fs::read_dir(&at).into_iter().flatten().flatten();
                entries.map(|e| (plain(&e.file_name().to_string_lossy()), e.file_name())).collect()
            });
            at = at.join(names.get(&plain(part))?);
        }
        at.is_file().then_some(at)
    }
}

/// Returns a name in small letters, without the version that ISO 9660 appends (`;1`).
fn plain(name: &str) -> String {
    let name = name.split(';').next().unwrap_or(name);
    name.trim_end_matches('.').to_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_in_the_folder() {
        assert_eq!(parts("DICOM\\ST000 \\IM0001"), Some(vec!["DICOM", "ST000", "IM0001"]));
        for id in ["..\\a", "a\\..\\..\\b", "/etc/passwd", "a\\/b", "C:\\a", "", "a\\\\b", "."] {
            assert_eq!(parts(id), None, "{id:?}");
        }
    }

    #[test]
    fn names_are_found_in_other_letters() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir(dir.path().join("dicom")).unwrap();
        for name in ["im01", "IM02;1", "IM03."] {
            std::fs::write(dir.path().join("dicom").join(name), "x").unwrap();
        }
        let mut names = Names::default();
        for name in ["IM01", "IM02", "IM03"] {
            assert!(names.find(dir.path(), &["DICOM", name]).is_some(), "{name}");
        }
        assert_eq!(names.find(dir.path(), &["DICOM", "IM04"]), None);
        assert_eq!(names.find(dir.path(), &["DICOM"]), None, "a folder");
    }
}
