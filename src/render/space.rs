//! A volume made ready for rays, and the ramp that says what is wall.

use std::sync::Arc;

use crate::error::{Error, Result};
use crate::volume::Volume;

use super::flags::Flags;

/// The ramp of opacity over HU: nothing is seen up to `lo`, everything is opaque from `hi`, linear between.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TransferFunction {
    lo: f32,
    hi: f32,
}

impl TransferFunction {
    /// A ramp from `lo` to `hi`, HU.
    ///
    /// # Errors
    /// Wrong usage when a bound is not a finite 16-bit HU value or `lo` is not below `hi`.
    pub fn new(lo: f32, hi: f32) -> Result<Self> {
        let mend = "give LO,HI in HU with LO below HI, such as -800,-500";
        let range = -32767.0..=32767.0;
        if !range.contains(&lo) || !range.contains(&hi) {
            return Err(Error::usage("--wall", format!("{lo},{hi} is not within ±32767 HU"), mend));
        }
        if lo >= hi {
            return Err(Error::usage("--wall", format!("{lo} HU is not below {hi} HU"), mend));
        }
        Ok(Self { lo, hi })
    }

    /// Opacity begins above this value, HU.
    pub fn lo(self) -> f32 {
        self.lo
    }

    /// Opacity is 1 from this value on, HU.
    pub fn hi(self) -> f32 {
        self.hi
    }

    /// The wall itself: the ramp's middle, HU.
    pub fn iso(self) -> f64 {
        0.5 * (f64::from(self.lo) + f64::from(self.hi))
    }
}

impl Default for TransferFunction {
    /// −800 to −500 HU, the wall at −650.
    fn default() -> Self {
        Self { lo: -800.0, hi: -500.0 }
    }
}

/// A volume ready for rays: its voxels, what counts as wall, and where rays may leap. Cheap to clone.
#[derive(Clone, Debug)]
pub struct PreparedVolume {
    volume: Arc<Volume>,
    wall: TransferFunction,
    flags: Arc<Flags>,
}

impl PreparedVolume {
    /// Prepares `volume` for rays against `wall`: one parallel pass over the voxels.
    pub fn new(volume: Arc<Volume>, wall: TransferFunction) -> Self {
        let flags = Arc::new(Flags::new(&volume, wall));
        Self { volume, wall, flags }
    }

    /// As [`PreparedVolume::new`] with the least memory: bricks to leap by, but no bit for each voxel.
    pub fn lean(volume: Arc<Volume>, wall: TransferFunction) -> Self {
        let flags = Arc::new(Flags::bricks_only(&volume, wall));
        Self { volume, wall, flags }
    }

    /// The voxels.
    pub fn shared_volume(&self) -> Arc<Volume> {
        Arc::clone(&self.volume)
    }

    /// The voxels.
    pub fn volume(&self) -> &Volume {
        &self.volume
    }

    /// The ramp that the flags were made for.
    pub fn wall(&self) -> TransferFunction {
        self.wall
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wall_is_a_rising_finite_ramp() {
        assert_eq!(TransferFunction::default().iso(), -650.0);
        assert_eq!(TransferFunction::new(-800.0, -500.0).unwrap(), TransferFunction::default());
        for (lo, hi) in [(0.0, 0.0), (1.0, 0.0), (f32::NAN, 0.0), (0.0, f32::INFINITY), (-1e6, 0.0)] {
            let e = TransferFunction::new(lo, hi).unwrap_err();
            assert_eq!(e.kind, crate::error::Kind::Usage);
        }
    }
}
