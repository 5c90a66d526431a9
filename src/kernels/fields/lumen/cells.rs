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
    /// Of each row of cells along x: most cells of a body hold no gas.
    rows: Vec<Row>,
    /// The first node of each cell of the rows, one row after the other, or [`Cells::NONE`].
    first: Vec<u32>,
    /// The next node of the same cell for each node, or [`Cells::NONE`].
    next: Vec<u32>,
}

/// The part of a row of cells that has nodes.
#[derive(Clone, Copy, Debug)]
struct Row {
    /// The first cell, and the number of cells.
    from: u32,
    len: u32,
    /// The place of the first cell in [`Cells::first`].
    at: u32,
}

impl Cells {
    /// No node.
    pub(super) const NONE: u32 = u32::MAX;

    /// Sorts the nodes of a map into cells, given the mean of each one's voxels (world, mm): it is inside the node's cell, by half a
    /// voxel at least.
    pub(super) fn of(grid: &Grid, centres: impl DoubleEndedIterator<Item = DVec3> + ExactSizeIterator + Clone) -> Self {
        let side = cell(grid);
        let dims: [usize; 3] = std::array::from_fn(|a| grid.dims()[a].div_ceil(side[a]));
        let cell_of = |centre: DVec3| {
            let voxel = (grid.voxel(centre) + 0.5).to_array();
            [0, 1, 2].map(|a| (voxel[a].max(0.0) as usize / side[a]).min(dims[a] - 1))
        };
        let mut rows = vec![Row { from: 0, len: 0, at: 0 }; dims[1] * dims[2]];
        for [i, j, k] in centres.clone().map(cell_of) {
            let (row, i) = (&mut rows[j + dims[1] * k], i as u32);
            let (from, end) = if row.len == 0 { (i, i) } else { (row.from.min(i), (row.from + row.len).max(i + 1)) };
            (row.from, row.len) = (from, end.max(i + 1) - from);
        }
        let mut count = 0;
        for row in &mut rows {
            row.at = count;
            count += row.len;
        }
        let mut out =
            Self { side, dims, rows, first: vec![Self::NONE; count as usize], next: vec![Self::NONE; centres.len()] };
        for (n, centre) in centres.enumerate().rev() {
            if let Some(at) = out.place(cell_of(centre)) {
                out.next[n] = std::mem::replace(&mut out.first[at], n as u32);
            }
        }
        out
    }

    /// Returns the place of a cell in [`Cells::first`]; `None` if its row has no nodes there.
    fn place(&self, [i, j, k]: [usize; 3]) -> Option<usize> {
        let Row { from, len, at } = self.rows[j + self.dims[1] * k];
        let n = (i as u32).wrapping_sub(from);
        (n < len).then_some((at + n) as usize)
    }

    /// Returns the first node of a cell, or [`Cells::NONE`].
    pub(super) fn first(&self, cell: [usize; 3]) -> u32 {
        self.place(cell).map_or(Self::NONE, |at| self.first[at])
    }

    /// Returns the nodes of a cell, ascending.
    pub(super) fn nodes(&self, cell: [usize; 3]) -> impl Iterator<Item = u32> + '_ {
        let follow = |n: u32| Some(n).filter(|&n| n != Self::NONE);
        std::iter::successors(follow(self.first(cell)), move |&n| follow(self.next[n as usize]))
    }

    /// Returns the node after `n` in its cell, or [`Cells::NONE`].
    pub(super) fn next(&self, n: u32) -> u32 {
        self.next[n as usize]
    }

    /// Returns the node of a cell that has only one.
    pub(super) fn only(&self, cell: [usize; 3]) -> Option<u32> {
        let n = self.first(cell);
        (n != Self::NONE && self.next[n as usize] == Self::NONE).then_some(n)
    }

    /// Returns the ranges of the cells that have nodes; empty ones if there are no nodes.
    pub(super) fn bounds(&self) -> [Range<usize>; 3] {
        let mut out = self.dims.map(|n| n..0);
        for (n, row) in self.rows.iter().enumerate().filter(|(_, row)| row.len > 0) {
            let x = row.from as usize..(row.from + row.len) as usize;
            let [y, z] = [n % self.dims[1], n / self.dims[1]].map(|c| c..c + 1);
            for (all, own) in out.iter_mut().zip([x, y, z]) {
                *all = all.start.min(own.start)..all.end.max(own.end);
            }
        }
        out
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
