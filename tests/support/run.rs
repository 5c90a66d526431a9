//! Complete runs of the program under test.

use std::process::Output;

use super::program::colvis;

/// Runs the program and returns its output, which is printed if the exit status is not as expected.
pub(crate) fn run(args: &[&str], status: i32) -> Output {
    let out = colvis().args(args).output().expect("the program can be run");
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(status), "colvis {args:?} said: {said}");
    assert_eq!(said.lines().filter(|l| l.starts_with("error: ")).count(), usize::from(status != 0), "{said}");
    out
}
