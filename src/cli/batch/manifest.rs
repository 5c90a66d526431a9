//! The manifest: a CSV file with a row for each case.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use super::steps::{self, RowOption};
use crate::error::{Error, Result};

/// The longest id, characters: file names have 255 bytes.
const LONGEST: usize = 100;

/// A row.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Case {
    /// Name of its folder. It identifies no patient unless the manifest says so.
    pub id: String,
    /// Its scan.
    pub path: PathBuf,
    /// Number of its DICOM series.
    pub series: Option<String>,
    /// Options of its own, in the order of the row.
    pub options: Vec<RowOption>,
}

impl Case {
    /// True if it belongs to the shard `number` of `count`, counted from 1. Depends on the id alone, so that a row more moves no other.
    pub(super) fn is_in_shard(&self, [number, count]: [u64; 2]) -> bool {
        let hash = Sha256::digest(self.id.as_bytes());
        let first = hash.iter().take(8).fold(0u64, |all, byte| all << 8 | u64::from(*byte));
        first % count == number - 1
    }
}

/// Reads a manifest. Paths in it count from its own folder.
///
/// Fails with status 3 if it cannot be read, has no column `path`, or if a row is wrong or names the folder of another one.
pub(super) fn read(path: &Path) -> Result<Vec<Case>> {
    let text = std::fs::read(path).map_err(|e| Error::file(path, e.to_string(), "check the name").caused_by(e))?;
    let wrong = |why: String, hint: &str| Error::file(path, why, hint);
    let text = String::from_utf8(text).map_err(|_| wrong("is not UTF-8".to_owned(), "save it as UTF-8"))?;
    let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
    let mut rows = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes());
    let columns = rows.headers().map_err(|e| wrong(e.to_string(), "write it as CSV"))?.clone();
    let column = |name: &str| columns.iter().position(|c| c == name);
    let Some(scans) = column("path") else {
        return Err(wrong("has no column path".to_owned(), "begin it with a row such as: path,id,series,options"));
    };
    let (ids, series, options) = (column("id"), column("series"), column("options"));
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut cases = Vec::new();
    let mut places = BTreeMap::new();
    for (n, row) in rows.records().enumerate() {
        let row = row.map_err(|e| wrong(e.to_string(), "write it as CSV, with as many cells in each row"))?;
        // The first row has the columns' names.
        let number = n + 2;
        let cell = |at: Option<usize>| at.and_then(|at| row.get(at)).filter(|text| !text.is_empty());
        let in_row = |why: String, hint: &str| wrong(format!("row {number}: {why}"), hint);
        let Some(scan) = cell(Some(scans)) else {
            return Err(in_row("has no path".to_owned(), "give its scan, or leave the row out"));
        };
        let series = cell(series).map(str::to_owned);
        let id = cell(ids).map_or_else(|| id_of(scan, series.as_deref()), str::to_owned);
        if let Some(why) = no_folder(&id) {
            return Err(in_row(format!("the id {id:?} {why}"), "give an id that is a name of a folder"));
        }
        if let Some(other) = places.insert(id.clone(), number) {
            return Err(in_row(format!("is case {id}, as row {other} is"), "give each row an id of its own"));
        }
        let options = steps::row_options(cell(options).unwrap_or(""), folder)
            .map_err(|why| in_row(why, "see colvis batch --help for the options of a row"))?;
        cases.push(Case { id, path: folder.join(scan), series, options });
    }
    if cases.is_empty() {
        return Err(wrong("has no row".to_owned(), "give a row for each case"));
    }
    Ok(cases)
}

/// Returns the cases that `given` names, in the order of the manifest: each is an id, or several with commas between them.
///
/// Fails with status 2 for an id that no case has.
pub(super) fn only(cases: Vec<Case>, given: &[String]) -> Result<Vec<Case>> {
    if given.is_empty() {
        return Ok(cases);
    }
    let has = |id: &str| cases.iter().any(|c| c.id == id);
    // An id may have commas itself.
    let ids = given.iter().flat_map(|g| if has(g) { vec![&**g] } else { g.split(',').collect() });
    let ids: BTreeSet<String> = ids.map(str::to_owned).collect();
    if let Some(unknown) = ids.iter().find(|id| !has(id)) {
        let why = format!("no case of the manifest is {unknown:?}");
        return Err(Error::usage("--only", why, "--plan prints the ids of all cases"));
    }
    Ok(cases.into_iter().filter(|c| ids.contains(&c.id)).collect())
}

/// Returns the id of a row without one. Files are often named after patients, so the id must not be.
fn id_of(scan: &str, series: Option<&str>) -> String {
    let hash = Sha256::digest(format!("{scan}\0{}", series.unwrap_or("")).as_bytes());
    let hex: String = hash.iter().take(6).map(|byte| format!("{byte:02x}")).collect();
    format!("case-{hex}")
}

/// Returns why an id is no name of a folder.
fn no_folder(id: &str) -> Option<&'static str> {
    let bad = |c: char| c.is_control() || "/\\:*?\"<>|".contains(c);
    if id.starts_with('.') {
        Some("begins with a dot")
    } else if id.contains(bad) {
        Some("has characters that folders may not have")
    } else if id.len() > LONGEST {
        Some("is too long")
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_text(text: &[u8]) -> Result<Vec<Case>> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("list.csv");
        std::fs::write(&path, text).unwrap();
        read(&path).map(|cases| {
            let bare = |c: Case| Case { path: c.path.strip_prefix(dir.path()).unwrap_or(&c.path).to_owned(), ..c };
            cases.into_iter().map(bare).collect()
        })
    }

    #[test]
    fn rows_have_quotes_and_whatever_else_a_table_has() {
        let text = "\u{feff}id, path ,site,options,series\r\nA 1,\"scans/a, b.nii\",Ulm,\"--from 1,-2,3 --guide path\",\r\n\
                    ,/data/Müller,,,2\r\n";
        let cases = read_text(text.as_bytes()).unwrap();
        assert_eq!([cases[0].id.as_str(), &cases[1].id], ["A 1", &id_of("/data/Müller", Some("2"))]);
        assert_eq!(cases[0].path, Path::new("scans/a, b.nii"));
        assert_eq!(cases[1].path, Path::new("/data/Müller"));
        assert_eq!((cases[0].options.len(), cases[1].series.as_deref()), (2, Some("2")));
        assert!(!cases[1].id.contains("ller"), "an id of ours names no file");
    }

    #[test]
    fn what_is_wrong_is_told_with_its_row() {
        for (text, told) in [
            (&b"path\n\xff.nii\n"[..], "UTF-8"),
            (b"id,file\n1,a.nii\n", "no column path"),
            (b"path\n", "no row"),
            (b"", "no column path"),
            (b"path,id\na.nii,1\n,2\n", "row 3"),
            (b"path,id\na.nii,1\nb.nii,1\n", "row 3: is case 1, as row 2 is"),
            (b"path\na.nii\na.nii\n", "row 3"),
            (b"path,id\na.nii,../b\n", "row 2"),
            (b"path,id\na.nii,.b\n", "row 2"),
            (b"path,options\na.nii,--near 1\n", "row 2: --near"),
            (b"path,options\na.nii,--identity\n", "row 2: --identity"),
            (b"path,options\na.nii,--from\n", "row 2: --from"),
            (b"path,options\na.nii,\"--scene 'x\"\n", "row 2"),
            (b"path,id\na.nii\n", "record"),
        ] {
            let e = read_text(text).unwrap_err();
            assert!(e.kind == crate::error::Kind::Input && e.to_string().contains(told), "{told}: {e}");
        }
    }

    #[test]
    fn cases_are_chosen_by_their_ids() {
        let cases = read_text(b"path,id\n1,a\n2,b c\n3,\"a,d\"\n").unwrap();
        let of = |given: &[&str]| {
            let given: Vec<String> = given.iter().map(|&g| g.to_owned()).collect();
            only(cases.clone(), &given).map(|cases| cases.into_iter().map(|c| c.id).collect::<Vec<_>>().join("|"))
        };
        assert_eq!(of(&[]).unwrap(), "a|b c|a,d");
        assert_eq!(of(&["b c,a"]).unwrap(), "a|b c");
        assert_eq!(of(&["a,d", "b c"]).unwrap(), "b c|a,d", "an id with a comma");
        let e = of(&["a,e"]).unwrap_err();
        assert!(e.kind == crate::error::Kind::Usage && e.to_string().contains("\"e\""), "{e}");
        assert!(of(&[""]).is_err());
    }

    #[test]
    fn shards_share_the_cases_and_keep_theirs() {
        let case = |n: usize| Case { id: format!("c{n}"), path: PathBuf::new(), series: None, options: Vec::new() };
        for count in [1, 2, 7] {
            let mut sizes = vec![0; count];
            for n in 0..700 {
                let of: Vec<_> =
                    (1..=count as u64).filter(|&number| case(n).is_in_shard([number, count as u64])).collect();
                assert_eq!(of.len(), 1);
                sizes[of[0] as usize - 1] += 1;
            }
            assert!(sizes.iter().all(|&s| s * count > 500 && s * count < 900), "{sizes:?}");
        }
    }
}
