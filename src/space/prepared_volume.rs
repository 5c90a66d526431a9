//! A volume prepared for ray casting.

use std::sync::Arc;

use crate::volume::Volume;

use super::flags::Flags;
use super::transfer::TransferFunction;

/// A volume prepared for ray casting: its voxels, its transfer function, and the flags that let rays leap. Cheap to
/// clone.
#[derive(Clone, Debug)]
pub struct PreparedVolume {
    volume: Arc<Volume>,
    transfer: TransferFunction,
    flags: Arc<Flags>,
}

impl PreparedVolume {
    /// Prepares `volume` for rays that see it through `transfer`, in one parallel pass over the voxels.
    pub fn new(volume: Arc<Volume>, transfer: TransferFunction) -> Self {
        let flags = Arc::new(Flags::new(&volume, transfer));
        Self { volume, transfer, flags }
    }

    /// Prepares a volume as [`PreparedVolume::new`] does, with the least memory: bricks for leaping, but no bit per
    /// voxel.
    pub fn lean(volume: Arc<Volume>, transfer: TransferFunction) -> Self {
        let flags = Arc::new(Flags::bricks_only(&volume, transfer));
        Self { volume, transfer, flags }
    }

    /// Prepares other voxels in the same way, with the same transfer function.
    pub fn with_voxels(&self, volume: Arc<Volume>) -> Self {
        if self.flags.has_bits() { Self::new(volume, self.transfer) } else { Self::lean(volume, self.transfer) }
    }

    /// Returns the voxels with shared ownership.
    pub fn shared_voxels(&self) -> Arc<Volume> {
        Arc::clone(&self.volume)
    }

    /// Returns the voxels.
    pub fn voxels(&self) -> &Volume {
        &self.volume
    }

    /// Returns the transfer function that the flags were made for.
    pub fn transfer(&self) -> TransferFunction {
        self.transfer
    }

    /// Returns the flags that show where rays may leap.
    pub fn flags(&self) -> &Flags {
        &self.flags
    }

    /// Returns the memory beside the voxels, bytes.
    pub fn bytes(&self) -> usize {
        self.flags.bytes()
    }
}
