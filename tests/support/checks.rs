//! How many cases a test takes.

/// Returns `full` with `COLVIS_CHECKS=full`, which `.ci/full` sets, and else `quick`: fewer cases, for a test that would take more
/// than two seconds with all of them.
pub(crate) fn cases<T>(full: T, quick: T) -> T {
    if std::env::var_os("COLVIS_CHECKS").is_some_and(|checks| checks == "full") { full } else { quick }
}
