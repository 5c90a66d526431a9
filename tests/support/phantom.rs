//! The synthetic colon.

use colvis::phantom::{Phantom, PhantomSettings, Truth};
use colvis::progress::Progress;
use colvis::volume::Volume;

/// Creates a phantom with its truth.
pub(crate) fn phantom(settings: &PhantomSettings) -> (Volume, Truth) {
    let phantom = Phantom::new(settings);
    let volume = phantom.voxelise(&phantom.grid(), &Progress::new()).expect("not cancelled");
    let truth = phantom.truth();
    (volume, truth)
}
