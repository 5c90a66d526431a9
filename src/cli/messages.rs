//! What the command line prints: results, notes and failures.

use std::io::{self, Write};
use std::process::ExitCode;

use crate::error::{Error, Kind, Result};
use crate::output;

/// Writes to standard output; a reader that closes early (`colvis … | head -1`) is not an error.
pub(super) fn print(write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<()> {
    match write(&mut io::stdout().lock()) {
        Err(e) if e.kind() != io::ErrorKind::BrokenPipe => {
            Err(Error::new(Kind::Output, "standard output", e.to_string(), "free some space"))
        }
        _ => Ok(()),
    }
}

/// Prints a note for the user.
pub(super) fn say(note: &str) {
    output::to_stderr(format_args!("note: {}", note.replace(char::is_control, " ")));
}

/// Prints a failure and returns its exit status.
pub(super) fn failed(error: &Error) -> ExitCode {
    print_failure(error);
    ExitCode::from(error.kind as u8)
}

/// Prints the choices, one per line, and then the failure on one line.
pub(super) fn print_failure(error: &Error) {
    for choice in &error.choices {
        say(choice);
    }
    output::to_stderr(format_args!("error: {error}"));
}
