//! The examples: each is built with the tests and runs to completion.

use std::path::Path;
use std::process::Command;

use crate::support::program::colvis;
use crate::support::skips::skip;

/// Runs each example in a separate folder, without arguments.
#[test]
#[ignore = "slow: every example"]
fn every_example_runs() {
    let Ok(examples) = std::fs::read_dir("examples") else { return };
    // `cargo test` builds them once. As targets with tests each would be linked a second time.
    let built = Path::new(colvis().get_program()).with_file_name("examples");
    for example in examples.map(|e| e.unwrap().path()) {
        let name = example.file_stem().unwrap();
        let program = built.join(name).with_extension(std::env::consts::EXE_EXTENSION);
        if !program.exists() {
            skip("examples", &format!("{} is not built: plain `cargo test --release` builds it", program.display()));
            continue;
        }
        let folder = tempfile::tempdir().unwrap();
        let out = Command::new(&program).current_dir(folder.path()).output().unwrap();
        assert!(out.status.success(), "{}: {}", example.display(), String::from_utf8_lossy(&out.stderr));
    }
}
