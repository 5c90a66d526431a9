//! Tests that cannot run here: they are counted and named, or fail.

use std::io::Write as _;
use std::panic::Location;

/// Reports that the test is skipped because a `part` it needs is missing: `data`, `screen`, `film`, `judges`, `slicer`, `archive` or
/// `peers`.
///
/// If the environment variable `COLVIS_SKIPS` is set, a line is appended to the file that it names. With
/// `COLVIS_NO_SKIP` set, a skip is a failure: `all` of them, or with `all-but-data,peers` all except the named parts.
#[track_caller]
pub(crate) fn skip(part: &str, why: &str) {
    let thread = std::thread::current();
    // On a single thread tests have no names; the location identifies them.
    let test = thread.name().filter(|n| *n != "main").unwrap_or("a test");
    let line = format!("{test} ({}) needs {part}: {why}", Location::caller());
    println!("skipped: {line}");
    if let Some(file) = std::env::var_os("COLVIS_SKIPS") {
        let mut file = std::fs::File::options().append(true).create(true).open(file).expect("the list of skips");
        // Write in one piece, since other tests write at the same time.
        file.write_all(format!("{line}\n").as_bytes()).expect("the list of skips can be written");
    }
    if let Ok(kept) = std::env::var("COLVIS_NO_SKIP") {
        let exempt = kept.strip_prefix("all-but-").is_some_and(|parts| parts.split(',').any(|p| p == part));
        assert!(exempt || kept.is_empty(), "skipped, which COLVIS_NO_SKIP={kept} forbids: {line}");
    }
}
