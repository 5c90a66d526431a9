//! Densities in a few bits, for what keeps regressions.

use crate::space::TransferFunction;

/// Densities quantised to a few bits.
///
/// Levels are evenly spaced over the storage's range of voxel values. The ramp's foot is on a level, so that what is
/// empty stays empty.
#[derive(Clone, Copy, Debug)]
pub(super) struct DensityScale {
    /// The ramp's foot, HU.
    foot: f32,
    /// The level of the ramp's foot.
    foot_level: f32,
    /// HU from one level to the next.
    step: f32,
    /// The greatest level.
    most: f32,
}

impl DensityScale {
    /// Creates a scale from `low` to `high` HU with `bits` bits, for the ramp of `wall`, which is between them.
    pub(super) fn new([low, high]: [f32; 2], wall: TransferFunction, bits: u32) -> Self {
        let most = ((1u32 << bits) - 1) as f32;
        // One level is lost by placing the foot on a level.
        let step = (high - low) / (most - 1.0);
        Self { foot: wall.lo(), foot_level: ((wall.lo() - low) / step).ceil(), step, most }
    }

    /// Returns true if the scale is fine enough to distinguish opacities of the ramp of `wall`.
    pub(super) fn serves(&self, wall: TransferFunction) -> bool {
        self.step <= (wall.hi() - wall.lo()) / 16.0
    }

    /// Returns the level nearest to a density, HU.
    #[inline(always)]
    pub(super) fn level(&self, density: f32) -> u32 {
        ((density - self.foot) / self.step + self.foot_level).round().clamp(0.0, self.most) as u32
    }

    /// Returns the density of a level, HU.
    #[inline(always)]
    pub(super) fn value(&self, level: u32) -> f32 {
        (level as f32 - self.foot_level) * self.step + self.foot
    }
}
