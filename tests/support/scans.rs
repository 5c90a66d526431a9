//! Real scans.

use std::path::PathBuf;

use super::skips::skip;

/// Returns a file of the test data. The test is skipped if there is no test data; otherwise all of it must be there.
#[track_caller]
pub(crate) fn data(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("COLVIS_TEST_DATA").map_or_else(|| PathBuf::from("../shared/data"), PathBuf::from);
    if !folder.exists() {
        skip("data", &format!("there is no {}", folder.display()));
        return None;
    }
    let path = folder.join(name);
    assert!(path.exists(), "the test data in {} has no {name}", folder.display());
    Some(path)
}
