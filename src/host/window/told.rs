//! The file of the kinds that the reader gave to bodies of gas: places in the scan and names.
//!
//! It lies beside the session and is named like it. A session is removed once the flight has arrived; what the reader said stays.

use std::path::Path;

use glam::DVec3;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::folders;
use crate::error::Result;
use crate::fields::lumen::{GasKind, Told};

/// The current version of the file format.
const VERSION: u32 = 1;
/// Consequence of an invalid file, for messages.
const HINT: &str = "it is left as it is, and kinds are as judged";
/// Maximum number of places.
pub(crate) const MOST: usize = 200;
/// Largest coordinate of a place, mm.
const FARTHEST_MM: f64 = 1e5;

/// The file format.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Kept {
    version: u32,
    /// Each with `at`, world mm, and `kind`.
    told: Vec<Value>,
}

impl folders::Kept for Kept {
    const VERSION: u32 = VERSION;

    fn version(&self) -> u32 {
        self.version
    }
}

/// An entry of the file.
#[derive(Deserialize)]
struct Entry {
    at: [f64; 3],
    kind: GasKind,
}

/// Reads the kinds of a file; none if it does not exist. Entries that are invalid are ignored.
///
/// # Errors
/// Returns status 3 if it is no file of kinds.
pub(crate) fn read(path: &Path) -> Result<Vec<Told>> {
    let kept = folders::read_kept::<Kept>(path, HINT)?;
    let entries = kept.into_iter().flat_map(|k| k.told);
    let valid = entries.filter_map(|e| serde_json::from_value::<Entry>(e).ok());
    let near = valid.filter(|e| e.at.iter().all(|mm| mm.abs() <= FARTHEST_MM));
    Ok(near.map(|e| (DVec3::from_array(e.at), e.kind)).take(MOST).collect())
}

/// Writes kinds to a file.
///
/// # Errors
/// Returns status 5 if it cannot be written.
pub(crate) fn keep(path: &Path, told: &[Told]) -> Result<()> {
    let told = told.iter().map(|(at, kind)| json!({ "at": at.to_array(), "kind": kind })).collect();
    folders::keep(path, &Kept { version: VERSION, told })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_is_read_back() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("kinds").join("a.json");
        assert!(read(&path).unwrap().is_empty());
        let told: Vec<Told> =
            GasKind::ALL.iter().enumerate().map(|(n, k)| (DVec3::new(n as f64, -0.1, 1e-3), *k)).collect();
        keep(&path, &told).unwrap();
        assert_eq!(read(&path).unwrap(), told);
        assert!(std::fs::read_to_string(&path).unwrap().contains("\"small bowel\""));
    }

    #[test]
    fn entries_that_are_invalid_are_ignored() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.json");
        let text = r#"{"version": 1, "told": [7, null, {"at": [1, 2], "kind": "colon"}, {"at": [1, 2, 3], "kind": "gall bladder"},
            {"at": [1e300, 0, 0], "kind": "colon"}, {"at": [1, 2, 3], "kind": "lung", "more": []}, {"kind": "lung"}]}"#;
        std::fs::write(&path, text).unwrap();
        assert_eq!(read(&path).unwrap(), [(DVec3::new(1.0, 2.0, 3.0), GasKind::Lung)]);
        for bad in
            ["", "[]", "null", "{\"version\": 1}", "{\"version\": 2, \"told\": []}", "{\"version\": 1, \"told\": 3}"]
        {
            std::fs::write(&path, bad).unwrap();
            assert!(read(&path).is_err(), "{bad}");
        }
        assert!(read(dir.path()).is_err(), "a folder");
    }
}
