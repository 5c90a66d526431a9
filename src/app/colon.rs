//! The colon that is searched for candidates: cleansed, and cut out of the scan.

use crate::Timings;
use crate::error::Result;
use crate::fields::Lumen;
use crate::fields::cleanse::{self, Cleansed};
use crate::progress::Progress;
use crate::volume::Volume;

/// Distance beyond the lumen up to which the scan is kept, mm: enough for the wall and the tissue in it.
#[doc(hidden)]
pub const WALL_MM: f64 = 15.0;

/// Cleanses `volume`, whose lumen is `found`. Returns the cleansed lumen, and what was cleansed, with the values that the scan had.
/// `again` finds the lumen in the changed scan; `taken` receives what was cleansed before that. `with_along` measures along the scan
/// as scanned.
///
/// # Errors
/// Returns status 4 if interrupted, or an error of `again`.
#[doc(hidden)]
pub fn without_tag(
    volume: &mut Volume,
    found: Lumen,
    with_along: bool,
    again: impl FnOnce(&Volume) -> Result<Option<Lumen>>,
    taken: impl FnOnce(&Cleansed),
    timings: &mut Timings,
    progress: &Progress,
) -> Result<(Lumen, Option<Cleansed>)> {
    found.close_septa(volume);
    if with_along {
        timings.time("along_s", || found.along(volume, progress))?;
    }
    let mut cleansed = timings.time("cleanse_s", || cleanse::cleanse(volume, &found, progress))?;
    if cleansed.changes.is_empty() {
        return Ok((found, None));
    }
    taken(&cleansed);
    cleansed.changes.exchange(volume);
    // Gas stays gas, so a requested point still has some.
    let Some(mut lumen) = timings.time("cleansed_lumen_s", || again(volume))? else {
        return Ok((found, Some(cleansed)));
    };
    lumen.close_septa(volume);
    cleanse::keep_ends(&mut lumen, &found);
    lumen.keep_along(&found);
    Ok((lumen, Some(cleansed)))
}

/// A scan and its lumen without what is farther than `beyond_mm` from the lumen, in less memory.
#[doc(hidden)]
pub fn around(volume: Volume, lumen: Lumen, beyond_mm: f64) -> (Volume, Lumen) {
    match lumen.around(beyond_mm) {
        Some((first, dims)) => (volume.into_part(first, dims), lumen.into_part(first, dims)),
        None => (volume, lumen),
    }
}
