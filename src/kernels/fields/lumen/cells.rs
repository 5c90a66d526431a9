//! The cells of the coarse map of the gas, and the nodes in each.

use std::ops::Range;

use glam::DVec3;

use crate::volume::Grid;

/// Minimum side of a cell, mm.
pub(super) const CELL_MM: f64 = 4.0;

/// The nodes in each cell.
#[derive(Debug)]
pub(super) struct Cells {
    /// Voxels along each side of a cell.
    pub side: [usize; 3],
    /// Cells along each axis.
    pub dims: [usize; 3],
    /// The first node of each cell, x fastest, or [`Cells::NONE`].
    first: Vec<u32>,
    /// The next node of the same cell for each node, or [`Cells::NONE`].
    next: Vec<u32>,
}

impl Cells {
    /// No node.
    pub(super) const NONE: u32 = u32::MAX;

    /// Sorts the nodes of a map into cells, given the mean of each one's voxels (world, mm): it is inside the node's cell, by half a
    /// voxel at least.
    pub(super) fn of(grid: &Grid, centres: impl DoubleEndedIterator<Item = DVec3> + ExactSizeIterator) -> Self {
        let side = cell(grid);
        let dims: [usize; 3] = std::array::from_fn(|a| grid.dims()[a].div_ceil(side[a]));
        let first = vec![Self::NONE; dims.iter().product()];
        let mut out = Self { side, dims, first, next: vec![Self::NONE; centres.len()] };
        for (n, centre) in centres.enumerate().rev() {
            let voxel = (grid.voxel(centre) + 0.5).to_array();
            let cell = out.index([0, 1, 2].map(|a| (voxel[a].max(0.0) as usize / side[a]).min(dims[a] - 1)));
            out.next[n] = std::mem::replace(&mut out.first[cell], n as u32);
        }
        out
    }

    /// Returns the linear index of a cell.
    pub(crate) fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        i + self.dims[0] * (j + self.dims[1] * k)
    }

    /// Returns the nodes of a cell (linear index), ascending.
    pub(crate) fn nodes(&self, cell: usize) -> impl Iterator<Item = u32> + '_ {
        let follow = |n: u32| Some(n).filter(|&n| n != Self::NONE);
        std::iter::successors(follow(self.first[cell]), move |&n| follow(self.next[n as usize]))
    }

    /// Returns the first node of each cell of a layer, x fastest, or [`Cells::NONE`].
    pub(super) fn first_of_layer(&self, k: usize) -> &[u32] {
        let count = self.dims[0] * self.dims[1];
        &self.first[count * k..count * (k + 1)]
    }

    /// Returns the node after `n` in its cell, or [`Cells::NONE`].
    pub(super) fn next(&self, n: u32) -> u32 {
        self.next[n as usize]
    }

    /// Returns the node of a cell (linear index) that has only one.
    pub(super) fn only(&self, cell: usize) -> Option<u32> {
        let n = self.first[cell];
        (n != Self::NONE && self.next[n as usize] == Self::NONE).then_some(n)
    }
}

/// Cuts a range of x at the sides of cells of `side` voxels.
pub(super) fn by_cells(x: Range<u32>, side: usize) -> impl Iterator<Item = Range<u32>> {
    let side = side as u32;
    let mut start = x.start;
    std::iter::from_fn(move || {
        let from = start;
        start = ((from / side + 1) * side).min(x.end);
        (from < x.end).then_some(from..start)
    })
}

/// Returns the voxels along each side of a cell.
pub(super) fn cell(grid: &Grid) -> [usize; 3] {
    std::array::from_fn(|a| ((CELL_MM / grid.spacing()[a]).ceil() as usize).max(1))
}
