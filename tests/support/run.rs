//! The program under test, run to its end.

use std::process::Output;

use super::program::colvis;

/// Runs the program and returns what it said; prints it when the status is not as wanted.
pub fn run(args: &[&str], status: i32) -> Output {
    let out = colvis().args(args).output().expect("the program can be run");
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(status), "colvis {args:?} said: {said}");
    assert_eq!(said.lines().filter(|l| l.starts_with("error: ")).count(), usize::from(status != 0), "{said}");
    out
}
