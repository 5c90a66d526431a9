//! The program under test.

use std::process::Command;

/// Returns a command that runs the program under test.
pub(crate) fn colvis() -> Command {
    Command::new(env!("CARGO_BIN_EXE_colvis"))
}
