//! The colon of a scan as `match` and `unfold` take it: cleansed, with the measure along it.

use std::path::Path;
use std::sync::Arc;

use crate::app::Timings;
use crate::cli::args::Global;
use crate::cli::messages::say;
use crate::cli::prepare;
use crate::cli::shared::Use;
use crate::error::Result;
use crate::fields::{Along, Lumen, lumen};
use crate::progress::Progress;
use crate::volume::Volume;

/// A colon, cleansed.
pub(crate) struct Colon {
    pub lumen: Lumen,
    /// The measure along it: along the line of the scan as it is, if the order of its pieces is known.
    pub along: Arc<Along>,
    /// True if it is along the line of the cleansed scan.
    pub is_cleansed: bool,
}

impl Colon {
    /// Reads a scan and cleanses it. Returns its colon, and the cleansed scan. Fails as [`prepare::load`] and [`prepare::Input::cleanse`]
    /// do.
    pub(crate) fn cleansed(
        input: &Path,
        global: &Global,
        timings: &mut Timings,
        progress: &Progress,
    ) -> Result<(Self, Arc<Volume>)> {
        // The scan is cleansed here; `--cleanse` must not do it first.
        let global = Global { cleanse: false, ..global.clone() };
        let mut read = prepare::load(input, &global, Use::Change, timings, progress)?;
        let (lumen, _) = read.cleanse(None, true, timings, progress)?;
        let along = lumen.along(&read.volume, progress)?;
        if !along.is_whole() {
            // Fluid may hide which way a piece runs, and a cleansed lumen keeps the order of the scan's.
            let lumen = timings.time("cleansed_lumen_s", || lumen::find(&read.volume, progress))?;
            let cleansed = timings.time("along_s", || Along::new(&read.volume, &lumen, progress))?;
            if cleansed.is_whole() {
                say(
                    "the order of the pieces of this colon is known only without its fluid: distances are those of `centerline --cleanse`",
                );
                return Ok((Self { lumen, along: Arc::new(cleansed), is_cleansed: true }, read.volume));
            }
        }
        Ok((Self { lumen, along, is_cleansed: false }, read.volume))
    }
}
