//! The synthetic colon.

#[path = "kept.rs"]
mod kept;

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use colvis::phantom::{Phantom, PhantomSettings, Size, Truth};
use colvis::progress::Progress;
use colvis::volume::Volume;

/// Small phantoms by their settings, so that tests of one binary that fly through the same one share it.
static SMALL: Mutex<BTreeMap<String, (Volume, Truth)>> = Mutex::new(BTreeMap::new());

/// Returns a phantom with its truth.
pub(crate) fn phantom(settings: &PhantomSettings) -> (Volume, Truth) {
    if settings.size != Size::Small {
        return made(settings);
    }
    // Held while it is made: others that want the same one wait for it.
    let mut small = SMALL.lock().unwrap_or_else(PoisonError::into_inner);
    small.entry(format!("{settings:?}")).or_insert_with(|| made(settings)).clone()
}

fn made(settings: &PhantomSettings) -> (Volume, Truth) {
    let phantom = Phantom::new(settings);
    let grid = phantom.grid();
    let make = || phantom.voxelise(&grid, &Progress::new()).expect("not cancelled").data().to_vec();
    let volume = Volume::new(grid.clone(), kept::voxels(&format!("{settings:?}"), grid.len(), make));
    let truth = phantom.truth();
    (volume, truth)
}
