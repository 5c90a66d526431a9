//! Leaping by the distance to the wall (the paper's potential-field assisted method), per voxel and per brick. Also
//! provides the empty distance around a position, which frame-to-frame reuse is proven by.
//!
//! The distances are made from the [`flags`](crate::space::flags) and stored in addition to them. They exist only for
//! renderers that leap or prove reuse by them; all others are spared the memory.

pub(crate) mod bricks;
mod bundles;
pub(crate) mod chessboard;
pub(crate) mod chosen;
pub(crate) mod crossings;
mod facing;
mod sixteen;
pub(crate) mod voxels;

use glam::Vec3;

use super::skip::is_empty_voxel;
use crate::space::PreparedVolume;
use crate::space::flags::BRICK_SHIFT;

pub use bricks::{BrickLeap, BrickWalls};
pub use bundles::Bundles;
pub use chosen::Leaper;
pub use crossings::{Crossings, RaysFrom};
pub use facing::Facing;
pub use voxels::{VoxelLeap, VoxelWalls};

/// Positions are computed in f32, so reported clearances are this much less than the known ones, voxels.
pub(crate) const SLACK: f32 = 0.01;

/// A source of distances from a position to the wall.
pub trait EmptyRadius: Sync {
    /// Returns a distance, voxels, such that all voxels nearer to `q` (grown voxel coordinates) along every axis are
    /// empty; 0 if nothing is known.
    fn around(&self, q: Vec3) -> f32;
}

/// The clearance known from flags and bricks.
pub struct Surroundings<'a> {
    /// The volume with its flags.
    pub volume: &'a PreparedVolume,
    /// The distances from brick to brick.
    pub bricks: &'a BrickWalls,
}

impl EmptyRadius for Surroundings<'_> {
    #[inline(always)]
    fn around(&self, q: Vec3) -> f32 {
        let among_bricks = self.bricks.around(q);
        // The neighbours of a voxel that is at most half a voxel away are empty; the next ones are two away from it.
        // Without a bit for each voxel, looking is too slow.
        if among_bricks == 0.0 && self.volume.flags().has_bits() && is_empty_voxel(self.volume, q) {
            1.5
        } else {
            among_bricks
        }
    }
}

/// Edge of a brick, voxels.
const EDGE: f32 = (1 << BRICK_SHIFT) as f32;

#[cfg(test)]
mod tests;
