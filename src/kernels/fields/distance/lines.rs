//! Planes of the grid by lines, and the part of one that is looked at.

use std::ops::Range;

use crate::fields::voxels::{VoxelBits, VoxelSet};

/// The rows of one plane of the grid, in order: those of a slice (fixed k, along y) or of a layer (fixed j, along z).
#[derive(Clone, Copy, Debug)]
pub(super) struct Lines {
    pub(super) dims: [usize; 3],
    /// 1: a slice at k = `at`; 2: a layer at j = `at`.
    pub(super) axis: usize,
    pub(super) at: usize,
}

impl Lines {
    pub(super) fn place(&self, n: usize) -> (usize, usize) {
        if self.axis == 1 { (n, self.at) } else { (self.at, n) }
    }

    pub(super) fn row<'s>(&self, set: &'s VoxelBits, n: usize) -> &'s [u64] {
        let (j, k) = self.place(n);
        set.row(j, k)
    }

    /// Returns the linear index of the line's first voxel.
    pub(super) fn base(&self, n: usize) -> usize {
        let (j, k) = self.place(n);
        self.dims[0] * (j + self.dims[1] * k)
    }

    pub(super) fn count(&self) -> usize {
        self.dims[self.axis]
    }
}

/// The part of a plane that contains requested voxels: lines, and x within them.
#[derive(Clone, Debug)]
pub(super) struct Window {
    pub(super) lines: Range<usize>,
    pub(super) xs: Range<usize>,
}

impl Window {
    pub(super) fn of(set: &VoxelSet, lines: &Lines) -> Option<Self> {
        let mut any: Option<(Range<usize>, Vec<u64>)> = None;
        for n in 0..lines.count() {
            let row = lines.row(set.bits(), n);
            if row.iter().all(|&w| w == 0) {
                continue;
            }
            let (range, all) = any.get_or_insert_with(|| (n..n + 1, vec![0; row.len()]));
            range.end = n + 1;
            all.iter_mut().zip(row).for_each(|(a, r)| *a |= r);
        }
        let (range, all) = any?;
        let first = all.iter().position(|&w| w != 0)?;
        let last = all.iter().rposition(|&w| w != 0)?;
        let xs =
            64 * first + all[first].trailing_zeros() as usize..64 * (last + 1) - all[last].leading_zeros() as usize;
        Some(Self { lines: range, xs })
    }

    pub(super) fn width(&self) -> usize {
        self.xs.len()
    }

    pub(super) fn len(&self) -> usize {
        self.lines.len() * self.width()
    }
}
