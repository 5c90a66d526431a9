//! The command line of colvis.

use std::process::ExitCode;

fn main() -> ExitCode {
    colvis::cli::Program::default().run()
}
