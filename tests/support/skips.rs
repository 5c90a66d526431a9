//! Tests that cannot be run here: counted and named, or failed.

use std::io::Write as _;
use std::panic::Location;

/// Tells that the test is skipped, for it needs a `part` that is not there: `data`, `screen`, `film` or `peers`.
///
/// A line about it is appended to the file that the environment variable `COLVIS_SKIPS` names, if it is set. With
/// `COLVIS_NO_SKIP` set, a skip is a failure: `all` of them, or `all-but-data,peers` but for the parts named.
#[track_caller]
pub fn skip(part: &str, why: &str) {
    let thread = std::thread::current();
    // On one thread alone tests have no names: the place tells.
    let test = thread.name().filter(|n| *n != "main").unwrap_or("a test");
    let line = format!("{test} ({}) needs {part}: {why}", Location::caller());
    println!("skipped: {line}");
    if let Some(file) = std::env::var_os("COLVIS_SKIPS") {
        let mut file = std::fs::File::options().append(true).create(true).open(file).expect("the list of skips");
        // In one piece, as other tests write at the same time.
        file.write_all(format!("{line}\n").as_bytes()).expect("the list of skips can be written");
    }
    if let Ok(kept) = std::env::var("COLVIS_NO_SKIP") {
        let exempt = kept.strip_prefix("all-but-").is_some_and(|parts| parts.split(',').any(|p| p == part));
        assert!(exempt || kept.is_empty(), "skipped, which COLVIS_NO_SKIP={kept} forbids: {line}");
    }
}
