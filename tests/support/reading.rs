//! Reading a scan.

use std::path::Path;

use colvis::progress::Progress;
use colvis::volume::io::{self, LoadOptions, Loaded};

/// Loads a scan with default options.
pub(crate) fn load(path: &Path) -> colvis::error::Result<Loaded> {
    io::load(path, &LoadOptions::default(), &Progress::new())
}
