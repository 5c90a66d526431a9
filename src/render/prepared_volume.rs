//! A volume made ready for rays.

use std::sync::Arc;

use crate::volume::Volume;

use super::flags::Flags;
use super::transfer::TransferFunction;

/// A volume ready for rays: its voxels, what counts as wall, and where rays may leap. Cheap to clone.
#[derive(Clone, Debug)]
pub struct PreparedVolume {
    volume: Arc<Volume>,
    transfer: TransferFunction,
    flags: Arc<Flags>,
}

impl PreparedVolume {
    /// Prepares `volume` for rays that see it by `transfer`: one parallel pass over the voxels.
    pub fn new(volume: Arc<Volume>, transfer: TransferFunction) -> Self {
        let flags = Arc::new(Flags::new(&volume, transfer));
        Self { volume, transfer, flags }
    }

    /// As [`PreparedVolume::new`] with the least memory: bricks to leap by, but no bit for each voxel.
    pub fn lean(volume: Arc<Volume>, transfer: TransferFunction) -> Self {
        let flags = Arc::new(Flags::bricks_only(&volume, transfer));
        Self { volume, transfer, flags }
    }

    /// Other voxels made ready in the same way, for the same transfer function.
    pub fn with_voxels(&self, volume: Arc<Volume>) -> Self {
        if self.flags.has_bits() { Self::new(volume, self.transfer) } else { Self::lean(volume, self.transfer) }
    }

    /// The voxels.
    pub fn shared_voxels(&self) -> Arc<Volume> {
        Arc::clone(&self.volume)
    }

    /// The voxels.
    pub fn voxels(&self) -> &Volume {
        &self.volume
    }

    /// The transfer function that the flags were made for.
    pub fn transfer(&self) -> TransferFunction {
        self.transfer
    }

    /// Where rays may leap.
    pub fn flags(&self) -> &Flags {
        &self.flags
    }

    /// Memory beside the voxels.
    pub fn bytes(&self) -> usize {
        self.flags.bytes()
    }
}
