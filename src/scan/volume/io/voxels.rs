//! The voxels of a file that is written: their meaning, and their bytes in blocks.

use super::deflate::BLOCK;

/// The voxels to write.
#[derive(Clone, Copy)]
pub(crate) enum Voxels<'a> {
    /// HU.
    Scan(&'a [i16]),
    /// Mask labels.
    Labels(&'a [u8]),
}

/// The meaning of the voxels, which determines how they are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum VoxelKind {
    /// HU, as `i16`.
    Scan,
    /// Mask labels, as `u8`.
    Labels,
}

impl Voxels<'_> {
    /// Returns their meaning.
    pub(super) fn kind(self) -> VoxelKind {
        match self {
            Self::Scan(_) => VoxelKind::Scan,
            Self::Labels(_) => VoxelKind::Labels,
        }
    }

    /// Returns their size, bytes.
    pub(super) fn bytes(self) -> usize {
        match self {
            Self::Scan(v) => size_of_val(v),
            Self::Labels(v) => v.len(),
        }
    }

    /// Returns the number of their [blocks](BLOCK).
    pub(super) fn blocks(self) -> usize {
        self.bytes().div_ceil(BLOCK)
    }

    /// Returns the little-endian bytes of one block.
    pub(super) fn block(self, k: usize) -> Vec<u8> {
        let (from, to) = (k * BLOCK, self.bytes().min((k + 1) * BLOCK));
        match self {
            Self::Scan(v) => v[from / 2..to / 2].iter().flat_map(|x| x.to_le_bytes()).collect(),
            Self::Labels(v) => v[from..to].to_vec(),
        }
    }
}
