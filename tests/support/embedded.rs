//! The embedded phantom, which the tests of one binary share.

use std::sync::{Arc, OnceLock};

use colvis::phantom::Phantom;
use colvis::progress::Progress;
use colvis::render::{PreparedVolume, TransferFunction};

/// Returns the embedded phantom, prepared.
pub(crate) fn embedded() -> PreparedVolume {
    static EMBEDDED: OnceLock<PreparedVolume> = OnceLock::new();
    let make = || {
        let volume = Phantom::embedded(&Progress::new()).expect("not cancelled");
        PreparedVolume::new(Arc::new(volume), TransferFunction::default())
    };
    EMBEDDED.get_or_init(make).clone()
}
