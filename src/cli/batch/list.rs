//! The list of all cases of a batch, kept beside their folders: ids alone, so that it names no file.

use std::collections::BTreeSet;
use std::path::Path;

use super::manifest::Case;
use crate::error::{Error, Result};
use crate::output;

/// Its name in the folder of cases.
pub(super) const FILE: &str = "cases.csv";

/// Writes the list into the folder of cases, whatever the shard. Fails with status 5.
pub(super) fn write(out: &Path, cases: &[Case]) -> Result<()> {
    let path = out.join(FILE);
    let mut rows = csv::Writer::from_writer(Vec::new());
    let written = rows
        .write_record(["id"])
        .and_then(|()| cases.iter().try_for_each(|c| rows.write_record([&c.id])))
        .map_err(std::io::Error::other)
        .and_then(|()| rows.into_inner().map_err(|e| std::io::Error::other(e.to_string())));
    let text = written.map_err(|e| output::cannot(&path, e))?;
    // Machines with a shard each write the same list.
    if std::fs::read(&path).is_ok_and(|old| old == text) {
        return Ok(());
    }
    output::write_whole(&path, |w| w.write_all(&text))
}

/// Reads a list. Fails with status 3 if it cannot be read or has no column `id`.
pub(super) fn read(path: &Path) -> Result<BTreeSet<String>> {
    let wrong = |why: String| Error::file(path, why, "run colvis batch again, or give its manifest");
    let mut rows = csv::Reader::from_path(path).map_err(|e| wrong(e.to_string()))?;
    let column = rows.headers().map_err(|e| wrong(e.to_string()))?.iter().position(|c| c == "id");
    let Some(column) = column else { return Err(wrong("has no column id".to_owned())) };
    let ids = rows.records().map(|row| row.map(|row| row.get(column).unwrap_or_default().to_owned()));
    ids.collect::<std::result::Result<_, _>>().map_err(|e| wrong(e.to_string()))
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;

    #[test]
    fn a_list_has_the_ids_and_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let case = |id: &str| Case {
            id: id.to_owned(),
            path: PathBuf::from("/data/SMITH.nii"),
            series: None,
            options: Vec::new(),
        };
        write(dir.path(), &[case("b, c"), case("=a"), case("Müller's")]).unwrap();
        let path = dir.path().join(FILE);
        assert!(!std::fs::read_to_string(&path).unwrap().contains("SMITH"));
        assert_eq!(read(&path).unwrap().into_iter().collect::<Vec<_>>(), ["=a", "Müller's", "b, c"]);
        let before = std::fs::metadata(&path).unwrap().modified().unwrap();
        write(dir.path(), &[case("b, c"), case("=a"), case("Müller's")]).unwrap();
        assert_eq!(before, std::fs::metadata(&path).unwrap().modified().unwrap(), "the same list is left alone");
        for text in [&b"path\na.nii\n"[..], b"id,x\na\n", b"id\n\xff\n", b""] {
            std::fs::write(&path, text).unwrap();
            assert!(read(&path).is_err());
        }
        assert!(read(&dir.path().join("none")).is_err());
    }
}
