//! The files of a report, which appear together or not at all.

use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::error::Result;
use crate::output::{AtomicFile, cannot};

/// The element that names the maker, in explicit little endian; and how far from the beginning of a file it is looked for.
const MAKER: &[u8] = b"\x08\x00\x70\x00LO\x06\x00colvis";
const HEAD: u64 = 4096;

/// Files that are written and have not appeared yet. Dropped, they are gone.
pub(super) struct Outputs<'a> {
    folder: &'a Path,
    files: Vec<AtomicFile>,
    names: Vec<String>,
}

impl<'a> Outputs<'a> {
    /// Begins the files of a folder.
    pub(super) fn new(folder: &'a Path) -> Self {
        Self { folder, files: Vec::new(), names: Vec::new() }
    }

    /// Returns the path of a file of the folder.
    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Adds a file of the folder with the bytes that `fill` writes. Fails with status 5 if they cannot be written.
    pub(super) fn add(&mut self, name: &str, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<()> {
        let path = self.path(name);
        let mut file = AtomicFile::create(&path)?;
        fill(&mut file).map_err(|e| cannot(&path, e))?;
        self.add_file(name, file);
        Ok(())
    }

    /// Adds a file of the folder that is written.
    pub(super) fn add_file(&mut self, name: &str, file: AtomicFile) {
        self.files.push(file);
        self.names.push(name.to_owned());
    }

    /// Adds a JSON file, of the folder or at another path. Fails with status 5 if it cannot be written.
    pub(super) fn add_json(&mut self, name: &str, value: &impl Serialize) -> Result<()> {
        self.add(name, |w| {
            serde_json::to_writer_pretty(&mut *w, value)?;
            w.write_all(b"\n")
        })
    }

    /// Lets them all appear, and removes objects of a report before this one that have no place in this one. Fails with status 5 if one
    /// cannot be written.
    pub(super) fn finish(self) -> Result<()> {
        AtomicFile::finish_all(self.files)?;
        let entries = std::fs::read_dir(self.folder).into_iter().flatten().flatten();
        for entry in entries.filter(|e| e.file_type().is_ok_and(|t| t.is_file())) {
            let name = entry.file_name().to_string_lossy().into_owned();
            if is_of_report(&name) && !self.names.contains(&name) && is_ours(&entry.path()) {
                std::fs::remove_file(entry.path()).map_err(|e| cannot(&entry.path(), e))?;
            }
        }
        Ok(())
    }
}

/// True if a file is a DICOM object that colvis has written.
fn is_ours(path: &Path) -> bool {
    let mut head = Vec::new();
    let read = std::fs::File::open(path).and_then(|file| file.take(HEAD).read_to_end(&mut head));
    read.is_ok() && head.get(128..132) == Some(b"DICM") && head.windows(MAKER.len()).any(|w| w == MAKER)
}

/// True if a file has the name of an object that some reports have and others do not.
pub(super) fn is_of_report(name: &str) -> bool {
    let numbered = |before: &str| {
        let number = name.strip_prefix(before).and_then(|rest| rest.strip_suffix(".dcm"));
        number.is_some_and(|n| n.len() >= 2 && n.bytes().all(|b| b.is_ascii_digit()))
    };
    ["report.dcm", "segments.dcm"].contains(&name) || numbered("segments-") || numbered("capture-")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_replaces_the_one_before_it_and_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let own = [&[0; 128][..], b"DICM", MAKER].concat();
        let old = ["report.html", "report.dcm", "capture-03.dcm", "capture-x.dcm", "mine.txt", "segments-02.dcm"];
        old.iter().for_each(|name| std::fs::write(dir.path().join(name), &own).unwrap());
        // Another program's.
        std::fs::write(dir.path().join("capture-2024.dcm"), "old").unwrap();
        let read = || {
            let mut names: Vec<String> = std::fs::read_dir(dir.path())
                .unwrap()
                .map(|e| e.unwrap().file_name().into_string().unwrap())
                .filter(|name| !name.starts_with('.'))
                .collect();
            names.sort();
            names
        };
        let mut outputs = Outputs::new(dir.path());
        outputs.add("report.html", |w| w.write_all(b"new")).unwrap();
        outputs.add("capture-01.dcm", |w| w.write_all(b"new")).unwrap();
        // Not yet, and not after a failure.
        assert_eq!(std::fs::read(dir.path().join("report.html")).unwrap(), own);
        assert!(outputs.add("segments.dcm", |_| Err(io::Error::other("full"))).is_err());
        assert_eq!(read().len(), old.len() + 1);
        outputs.finish().unwrap();
        assert_eq!(read(), ["capture-01.dcm", "capture-2024.dcm", "capture-x.dcm", "mine.txt", "report.html"]);
        assert_eq!(std::fs::read(dir.path().join("report.html")).unwrap(), b"new");
    }
}
