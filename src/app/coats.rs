//! The coated spots of a scan.

use crate::boxed::boxed;
use crate::error::Result;
use crate::fields::Lumen;
use crate::fields::cleanse::{self, Cleansed};
use crate::fields::lumen::{self, Told};
use crate::polyps::{CoatedPlaces, Coats, Wall};
use crate::progress::Progress;
use crate::space::PreparedVolume;

/// The colour of coats: none that the wall, or what lies behind it, has.
#[doc(hidden)]
pub const COAT: [u8; 3] = [0, 210, 190];

/// Finds the coated spots of a scan. `cleansed` is what was cleansed in it; a scan as scanned is cleansed for this, and stays as it is.
///
/// # Errors
/// Returns status 4 if interrupted.
#[doc(hidden)]
pub fn find(
    volume: &PreparedVolume,
    lumen: &Lumen,
    cleansed: Option<&Cleansed>,
    told: &[Told],
    progress: &Progress,
) -> Result<CoatedPlaces> {
    let (volume, iso) = (volume.voxels(), volume.transfer().iso());
    if let Some(cleansed) = cleansed {
        let wall = Wall::new(volume, lumen, iso, progress)?;
        let coats = Coats::find(&wall, &boxed(volume, lumen, &cleansed.changes), Some(cleansed), progress)?;
        return Ok(CoatedPlaces::new(&coats, &wall));
    }
    let cleansed = cleanse::cleanse(volume, lumen, progress)?;
    let wall = if cleansed.changes.is_empty() {
        Wall::new(volume, lumen, iso, progress)?
    } else {
        let clean = cleansed.changes.applied(volume);
        let mut gas = lumen::find_told(&clean, told, progress)?;
        cleanse::keep_ends(&mut gas, lumen);
        Wall::new(&clean, &gas, iso, progress)?
    };
    let coats = Coats::find(&wall, volume, Some(&cleansed), progress)?;
    Ok(CoatedPlaces::new(&coats, &wall))
}
