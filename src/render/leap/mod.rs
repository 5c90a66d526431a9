//! Leaping by the distance to the wall (the paper's potential-field assisted method), per voxel and per brick; and how
//! much emptiness is known to surround a place, which is what frame-to-frame reuse is proven by.
//!
//! The distances are in addition to the [`flags`](super::flags), made from them: they exist only for renderers that leap by them
//! or prove reuse by them, and would cost all others their memory.

pub mod bricks;
pub mod chessboard;
pub mod chosen;
pub mod voxels;

use glam::Vec3;

use super::flags::BRICK_SHIFT;
use super::prepared_volume::PreparedVolume;
use super::skip::is_empty_voxel;

pub use bricks::{BrickLeap, BrickWalls};
pub use chosen::Leaper;
pub use voxels::{VoxelLeap, VoxelWalls};

/// Places are computed in f32: this much less emptiness is claimed than is known, voxels.
pub const SLACK: f32 = 0.01;

/// Knows how far the wall is from a place.
pub trait EmptyRadius: Sync {
    /// All voxels nearer to `q` (grown voxel coordinates) than this along every axis are empty, voxels; 0 where nothing
    /// is known.
    fn around(&self, q: Vec3) -> f32;
}

/// The clearance that flags and bricks tell.
pub struct Surroundings<'a> {
    /// The flags.
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
