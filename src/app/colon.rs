//! The colon that is searched for candidates: cleansed, and cut out of the scan.

use std::sync::Arc;
use std::time::Instant;

use crate::Timings;
use crate::error::Result;
use crate::fields::Lumen;
use crate::fields::cleanse::{self, Cleansed};
use crate::found::Found;
use crate::progress::Progress;
use crate::volume::Volume;
use colvis_scan::memory;

/// Distance beyond the lumen up to which the scan is kept, mm: enough for the wall and the tissue in it.
#[doc(hidden)]
pub const WALL_MM: f64 = 15.0;

/// Cleanses `volume`, whose lumen is `found`. Returns the cleansed lumen, and what was cleansed, with the values that the scan had.
/// `again` finds the lumen in the changed scan; `taken` receives what was cleansed before that. `with_along` measures along the scan
/// as scanned. `known` is what was found in the scan as read.
///
/// # Errors
/// Returns status 4 if interrupted, or an error of `again`.
#[doc(hidden)]
pub fn without_tag(
    volume: &mut Volume,
    (found, known): (Arc<Lumen>, &Found),
    with_along: bool,
    again: impl FnOnce(&Volume) -> Result<Lumen> + Send,
    taken: impl FnOnce(&Cleansed),
    timings: &mut Timings,
    progress: &Progress,
) -> Result<(Lumen, Option<Cleansed>)> {
    found.close_septa(volume);
    let find = || cleanse::cleanse(volume, &found, progress);
    let cleansed = timings.time("cleanse_s", || known.cleansed(find))?;
    if cleansed.changes.is_empty() {
        if with_along {
            timings.time("along_s", || found.along(volume, progress))?;
        }
        return Ok((Arc::unwrap_or_clone(found), None));
    }
    let mut cleansed = Arc::unwrap_or_clone(cleansed);
    taken(&cleansed);
    cleansed.changes.exchange(volume);
    let now = &*volume;
    let beside = progress.beside();
    let measure = || found.along_before(now, &cleansed.changes, &beside);
    let find = || {
        let lumen = known.cleansed_lumen(|| again(now));
        (lumen, Instant::now())
    };
    let begun = Instant::now();
    let ((lumen, done), along) = match with_along {
        true => rayon::join(find, || Some(measure())),
        false => (find(), None),
    };
    memory::release();
    timings.add("cleansed_lumen_s", done.duration_since(begun).as_secs_f64());
    let mut lumen = Arc::unwrap_or_clone(lumen?);
    if let Some(along) = along {
        along?;
        // What it takes longer than the lumen, beside which it is measured.
        timings.add("along_s", done.elapsed().as_secs_f64());
    }
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
