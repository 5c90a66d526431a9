//! Nodes of the gas's map by their cell: what is near what in space, and how far away it is in the gas.

use std::ops::Range;

use rayon::prelude::*;

use super::grown::Hop;
use crate::fields::lumen::graph::{Graph, cell};
use crate::volume::Grid;

/// The nodes of a map of the gas, by cell.
#[derive(Debug)]
pub(super) struct Places {
    /// Voxels along each side of a cell.
    side: [usize; 3],
    /// Cells along each axis.
    dims: [usize; 3],
    hops: Vec<Hop>,
    /// The cell of each node, linear index.
    cells: Vec<u32>,
    /// (Cell, where it is), ascending, each once.
    by_cell: Vec<(u32, Hop)>,
}

impl Places {
    pub(super) fn of(grid: &Grid, graph: &Graph, hops: Vec<Hop>) -> Self {
        let side = cell(grid);
        let dims = std::array::from_fn(|a| grid.dims()[a].div_ceil(side[a]));
        let mut out = Self { side, dims, hops, cells: Vec::new(), by_cell: Vec::new() };
        // The mean of a node's voxels is inside its cell, by half a voxel at least.
        out.cells = graph
            .nodes
            .iter()
            .map(|n| {
                let voxel = (grid.voxel(n.centre) + 0.5).to_array();
                out.cell([0, 1, 2].map(|a| (voxel[a].max(0.0) as usize / side[a]).min(dims[a] - 1))) as u32
            })
            .collect();
        out.by_cell = out.cells.iter().copied().zip(out.hops.iter().copied()).collect();
        out.by_cell.par_sort_unstable();
        out.by_cell.dedup();
        out
    }

    fn cell(&self, [i, j, k]: [usize; 3]) -> usize {
        i + self.dims[0] * (j + self.dims[1] * k)
    }

    pub(super) fn hop(&self, node: u32) -> Hop {
        self.hops[node as usize]
    }

    /// Calls `f` with all that is within `reach` cells of a cell, until it returns true. Returns whether it did.
    fn any(&self, cell: usize, reach: [usize; 3], mut f: impl FnMut(Hop) -> bool) -> bool {
        let [nx, ny, _] = self.dims;
        let at = [cell % nx, cell / nx % ny, cell / (nx * ny)];
        let range = |a: usize| at[a].saturating_sub(reach[a])..(at[a] + reach[a] + 1).min(self.dims[a]);
        let xs = range(0);
        range(2).any(|k| {
            range(1).any(|j| {
                let [first, end] = [xs.start, xs.end].map(|i| self.cell([i, j, k]) as u32);
                let from = self.by_cell.partition_point(|c| c.0 < first);
                self.by_cell[from..].iter().take_while(|c| c.0 < end).any(|c| f(c.1))
            })
        })
    }

    /// Returns for each node whether no node is within `voxels` of it along each axis that is `far` contacts away or more, or of
    /// another piece of gas.
    pub(super) fn alone(&self, voxels: usize, far: u32) -> Vec<bool> {
        let reach = self.side.map(|side| voxels.div_ceil(side));
        let alone = |(&cell, &hop): (&u32, &Hop)| !self.any(cell as usize, reach, |other| hop.is_far(other, far));
        self.cells.par_iter().zip(&self.hops).map(alone).collect()
    }

    /// Returns where a node of the cell of a voxel is, or one of the cells around it.
    pub(super) fn near(&self, voxel: [usize; 3]) -> Option<Hop> {
        let cell = self.cell([0, 1, 2].map(|a| voxel[a] / self.side[a]));
        let mut found = None;
        [[0; 3], [1; 3]].into_iter().any(|reach| {
            self.any(cell, reach, |hop| {
                found = Some(hop);
                true
            })
        });
        found
    }

    /// Cuts a range of x at the sides of cells.
    pub(super) fn by_cells(&self, x: Range<u32>) -> impl Iterator<Item = Range<u32>> {
        let side = self.side[0] as u32;
        let mut start = x.start;
        std::iter::from_fn(move || {
            let from = start;
            start = ((from / side + 1) * side).min(x.end);
            (from < x.end).then_some(from..start)
        })
    }
}
