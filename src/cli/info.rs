//! `colvis info`.

use crate::app::Timings;
use crate::cli::args::{Global, InfoArgs};
use crate::cli::batch::worker::Seen;
use crate::cli::messages::{print, say};
use crate::cli::prepare;
use crate::cli::shared::Use;
use crate::error::Result;
use crate::progress::Progress;
use crate::volume::content_hash;
use crate::volume::io::{self, LoadOptions};

/// Prints an input's contents as JSON. Notes about reading it go to standard error. Fails with status 3 when the input cannot be
/// read, 5 when standard output cannot be written.
pub(crate) fn run(args: &InfoArgs, global: &Global, progress: &Progress) -> Result<()> {
    let options = LoadOptions { allow_gaps: true, ..prepare::load_options(global) };
    let (value, notes) = io::inspect(&args.input, &options, progress)?;
    if global.allow_gaps && value.get("slice_gaps").is_none() {
        say("--allow-gaps is ignored: the scan is not DICOM");
    }
    notes.iter().for_each(|note| say(note));
    print(|out| writeln!(out, "{value:#}"))
}

/// Returns what tells a scan from others. Fails as every command that reads it.
pub(super) fn look(args: &InfoArgs, global: &Global, progress: &Progress) -> Result<Seen> {
    let input = prepare::load(&args.input, global, Use::Look, &mut Timings::default(), progress)?;
    Ok(Seen { content: content_hash(&input.volume), voxels: input.volume.data().len() as u64 })
}
