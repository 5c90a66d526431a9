//! `colvis segment`.

use crate::cli::args::{Global, SegmentArgs};
use crate::error::{Error, Result};
use crate::progress::Progress;

/// Runs the command.
pub fn run(_args: &SegmentArgs, _global: &Global, _progress: &Progress) -> Result<()> {
    Err(Error::not_built("segment"))
}
