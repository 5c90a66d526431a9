//! Phantoms that unit tests share: making one takes a second or two, and most tests want the same few.

#[path = "kept.rs"]
mod kept;

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use crate::phantom::{Phantom, PhantomSettings};
use crate::progress::Progress;
use crate::volume::Volume;

type Made = (Arc<Phantom>, Arc<Volume>);

/// Phantoms by their settings.
static MADE: Mutex<BTreeMap<String, Arc<OnceLock<Made>>>> = Mutex::new(BTreeMap::new());

/// Returns a phantom and its voxels on its own grid.
pub(crate) fn shared(settings: &PhantomSettings) -> (Arc<Phantom>, Volume) {
    let mut made = MADE.lock().unwrap_or_else(PoisonError::into_inner);
    let slot = Arc::clone(made.entry(format!("{settings:?}")).or_default());
    drop(made);
    // Others that want the same one wait for it, but none waits for another one.
    let (phantom, volume) = slot.get_or_init(|| {
        let phantom = Phantom::new(settings);
        let grid = phantom.grid();
        let make = || phantom.voxelise(&grid, &Progress::new()).unwrap().data().to_vec();
        let volume = Volume::new(grid.clone(), kept::voxels(&format!("{settings:?}"), grid.len(), make));
        (Arc::new(phantom), Arc::new(volume))
    });
    (Arc::clone(phantom), Volume::clone(volume))
}
