//! A volume prepared for ray casting.

use std::sync::{Arc, OnceLock};

use crate::volume::Volume;

use super::flags::Flags;
use super::surround::Surround;
use super::transfer::TransferFunction;

/// A volume prepared for ray casting: its voxels, its transfer function, and the flags that let rays leap. Cheap to clone.
#[derive(Clone, Debug)]
pub struct PreparedVolume {
    volume: Arc<Volume>,
    transfer: TransferFunction,
    flags: Arc<Flags>,
    /// For lights that have shadows, once one asks for it.
    surround: Arc<OnceLock<Option<Surround>>>,
}

impl PreparedVolume {
    /// Prepares `volume` for rays that see it through `transfer`, in one parallel pass over the voxels. The bit for each voxel is left
    /// to the first renderer that looks at it.
    pub fn new(volume: Arc<Volume>, transfer: TransferFunction) -> Self {
        let flags = Arc::new(Flags::deferred(&volume, transfer));
        Self { volume, transfer, flags, surround: Arc::default() }
    }

    /// Prepares a volume as [`PreparedVolume::new`] does, with the least memory: bricks for leaping, but no bit per voxel.
    pub fn lean(volume: Arc<Volume>, transfer: TransferFunction) -> Self {
        let flags = Arc::new(Flags::bricks_only(&volume, transfer));
        Self { volume, transfer, flags, surround: Arc::default() }
    }

    /// Prepares other voxels in the same way, with the same transfer function.
    pub fn with_voxels(&self, volume: Arc<Volume>) -> Self {
        if self.flags.has_bits() { Self::new(volume, self.transfer) } else { Self::lean(volume, self.transfer) }
    }

    /// Changes the voxels: in place if they are not shared, else in a copy.
    #[doc(hidden)]
    pub fn change(&mut self, change: impl FnOnce(&mut Volume)) {
        change(Arc::make_mut(&mut self.volume));
        let voxels = Arc::clone(&self.volume);
        *self = self.with_voxels(voxels);
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

    /// Computes the bit for each voxel, if the volume is prepared to have one and nobody has done so, in one parallel pass over the
    /// voxels. Without it, the flags are the same and cost 27 voxels each.
    pub(crate) fn fill_flags(&self) {
        self.flags.fill(&self.volume);
    }

    /// Returns how much matter surrounds a place; `None` for a volume that has no room for cells. The first call makes it, in
    /// one parallel pass over the voxels.
    pub(crate) fn surround(&self) -> Option<&Surround> {
        if self.surround.get().is_none() {
            // Outside the lock: while the pass waits for its threads, this one may take over work that asks for the same.
            _ = self.surround.set(Surround::new(&self.volume, self.transfer));
        }
        self.surround.get().and_then(Option::as_ref)
    }

    /// Returns the memory in addition to the voxels, bytes.
    pub fn bytes(&self) -> usize {
        let surround = self.surround.get().and_then(Option::as_ref);
        self.flags.bytes() + surround.map_or(0, Surround::bytes)
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::space::first_crossing;
    use crate::volume::Grid;

    #[test]
    fn other_voxels_get_flags_of_their_own() {
        let grid = Grid::new([24; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let scan = |hu: i16| {
            let data = (0..grid.len()).map(|n| if n % 24 < 12 { -1000 } else { hu }).collect();
            Arc::new(Volume::new(grid.clone(), data))
        };
        let (air, tissue) = (scan(-1000), scan(40));
        let prepare: [fn(Arc<Volume>, TransferFunction) -> PreparedVolume; 2] =
            [PreparedVolume::new, PreparedVolume::lean];
        for prepare in prepare {
            let empty = prepare(Arc::clone(&air), TransferFunction::default());
            let filled = empty.with_voxels(Arc::clone(&tissue));
            assert_eq!(filled.flags().has_bits(), empty.flags().has_bits(), "prepared in the same way");
            // From −1000 at voxel 11 to 40 HU at voxel 12.
            let hit = first_crossing(&filled, DVec3::new(2.0, 12.0, 12.0), DVec3::X, 30.0).unwrap();
            assert!((hit - (9.0 + 350.0 / 1040.0)).abs() < 1e-9, "{hit}");
            let mut own = filled.clone();
            own.change(|volume| volume.data_mut().fill(-1000));
            assert_eq!((filled.voxels().get(20, 0, 0), own.voxels().get(20, 0, 0)), (40, -1000), "a copy is changed");
            assert!((0..64).all(|n| own.flags().empty_brick(n)) && own.flags().has_bits() == filled.flags().has_bits());
            let place = own.voxels().data().as_ptr();
            own.change(|volume| volume.data_mut()[0] = 40);
            assert!(
                own.voxels().data().as_ptr() == place && !own.flags().empty_brick(0),
                "in place, if it is not shared"
            );
            let drained = filled.with_voxels(Arc::clone(&air));
            assert!(drained.flags().homogeneous(drained.voxels(), 11, 12, 12), "no tissue is left beside it");
            assert!(!filled.flags().homogeneous(filled.voxels(), 11, 12, 12));
            let all = |v: &PreparedVolume| (0..64).all(|n| v.flags().empty_brick(n));
            assert!(all(&drained) && !all(&filled), "rays leap over all of it again");
        }
    }
}
