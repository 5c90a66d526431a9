//! `colvis info`.

use crate::cli::args::{Global, InfoArgs};
use crate::error::{Error, Result};
use crate::progress::Progress;

/// Runs the command.
pub fn run(_args: &InfoArgs, _global: &Global, _progress: &Progress) -> Result<()> {
    Err(Error::not_built("info"))
}
