//! `colvis info`.

use std::io::Write;

use crate::cli::args::{Global, InfoArgs};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::io::{self, LoadOptions};

/// Prints what is in an input, as JSON; what there is to say about reading it goes to standard error.
///
/// # Errors
/// Status 3 when the input cannot be read, 5 when standard output cannot be written.
pub fn run(args: &InfoArgs, global: &Global, progress: &Progress) -> Result<()> {
    let options = LoadOptions {
        spacing: global.spacing.map(|s| s.0),
        hu: global.hu.map(|p| (p.0, p.1)),
        series: global.series,
        allow_gaps: true,
    };
    let (value, notes) = io::inspect(&args.input, &options, progress)?;
    for note in notes {
        eprintln!("note: {}", note.replace(char::is_control, " "));
    }
    let text = format!("{value:#}\n");
    match std::io::stdout().lock().write_all(text.as_bytes()) {
        // The reader of a pipe may have seen enough (`colvis info … | head -1`).
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Error::new(crate::error::Kind::Output, "standard output", e.to_string(), "free some space"))
        }
        _ => Ok(()),
    }
}
