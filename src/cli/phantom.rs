//! `colvis phantom`.

use crate::cli::args::{Global, PhantomArgs};
use crate::error::{Error, Result};
use crate::progress::Progress;

/// Runs the command.
pub fn run(_args: &PhantomArgs, _global: &Global, _progress: &Progress) -> Result<()> {
    Err(Error::not_built("phantom"))
}
