//! Nodes of the gas's map by their cell: what is near what in space, and how far away it is in the gas.

use rayon::prelude::*;

use crate::fields::lumen::cells::Cells;
use crate::fields::lumen::graph::Graph;
use crate::volume::Grid;

/// The nodes of a map of the gas, by cell.
#[derive(Debug)]
pub(super) struct Places {
    pub cells: Cells,
    hops: Vec<Hop>,
}

/// Where a node is in its piece of gas. Two nodes of a piece are at least as many contacts apart as their numbers differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Hop {
    pub piece: u32,
    pub contacts: u32,
}

impl Hop {
    /// True if the path from one to the other through the core has at least `far` contacts, or if there is no path.
    pub(super) fn is_far(self, other: Self, far: u32) -> bool {
        self.piece != other.piece || self.contacts.abs_diff(other.contacts) >= far
    }
}

/// Where the nodes of some cells are.
#[derive(Clone, Copy, Debug)]
struct Span {
    /// The first and last number of their pieces.
    pieces: [u32; 2],
    /// The least and greatest number of contacts.
    contacts: [u32; 2],
}

impl Span {
    const NONE: Self = Self { pieces: [u32::MAX, 0], contacts: [u32::MAX, 0] };

    fn of(hop: Hop) -> Self {
        Self { pieces: [hop.piece; 2], contacts: [hop.contacts; 2] }
    }

    fn plus(self, other: Self) -> Self {
        let both = |a: [u32; 2], b: [u32; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        Self { pieces: both(self.pieces, other.pieces), contacts: both(self.contacts, other.contacts) }
    }

    /// True if anything in it is far away from `hop` (see [`Hop::is_far`]).
    fn is_far(self, hop: Hop, far: u32) -> bool {
        let ends = |n: usize| Hop { piece: self.pieces[n], contacts: self.contacts[n] };
        ends(0).is_far(hop, far) || ends(1).is_far(hop, far)
    }
}

impl Places {
    pub(super) fn of(grid: &Grid, graph: &Graph, hops: Vec<Hop>) -> Self {
        Self { cells: graph.cells(grid), hops }
    }

    pub(super) fn hop(&self, node: u32) -> Hop {
        self.hops[node as usize]
    }

    /// Returns for each node whether no node is within `voxels` of it along each axis that is `far` contacts away or more, or of
    /// another piece of gas.
    pub(super) fn alone(&self, voxels: usize, far: u32) -> Vec<bool> {
        let reach = self.cells.side.map(|side| voxels.div_ceil(side));
        let [xs, ys, zs] = self.cells.bounds();
        let [nx, ny] = [xs.len(), ys.len()];
        let nodes = |i: usize, j: usize, k: usize| self.cells.nodes([xs.start + i, ys.start + j, zs.start + k]);
        // Along x and y within each layer of cells; the layers are few, and looked at for each node.
        let layer = |k: usize| {
            let mut spans = vec![Span::NONE; nx * ny];
            for (j, row) in spans.chunks_exact_mut(nx).enumerate() {
                for (i, span) in row.iter_mut().enumerate() {
                    *span = nodes(i, j, k).fold(Span::NONE, |all, n| all.plus(Span::of(self.hop(n))));
                }
                widen(row, 1, reach[0]);
            }
            (0..nx).for_each(|i| widen(&mut spans[i..], nx, reach[1]));
            spans
        };
        let layers: Vec<Vec<Span>> = (0..zs.len()).into_par_iter().map(layer).collect();
        let mut alone = vec![false; self.hops.len()];
        for k in 0..zs.len() {
            let around = &layers[k.saturating_sub(reach[2])..(k + reach[2] + 1).min(zs.len())];
            for (j, i) in (0..ny).flat_map(|j| (0..nx).map(move |i| (j, i))) {
                for node in nodes(i, j, k) {
                    let all = around.iter().fold(Span::NONE, |all, layer| all.plus(layer[i + nx * j]));
                    alone[node as usize] = !all.is_far(self.hop(node), far);
                }
            }
        }
        alone
    }

    /// Returns where a node of the cell of a voxel is, or one of the cells around it.
    pub(super) fn near(&self, voxel: [usize; 3]) -> Option<Hop> {
        let cells = &self.cells;
        let at = [0, 1, 2].map(|a| voxel[a] / cells.side[a]);
        let first = |cell: [usize; 3]| cells.nodes(cell).map(|n| self.hop(n)).min();
        let range = |a: usize| at[a].saturating_sub(1)..(at[a] + 2).min(cells.dims[a]);
        let mut around = range(2).flat_map(|k| range(1).flat_map(move |j| range(0).map(move |i| [i, j, k])));
        first(at).or_else(|| around.find_map(first))
    }
}

/// Replaces each of the spans that are `step` apart by all of those within `reach` of it.
fn widen(spans: &mut [Span], step: usize, reach: usize) {
    let own: Vec<Span> = spans.iter().step_by(step).copied().collect();
    if own.iter().all(|s| s.pieces == Span::NONE.pieces) {
        return;
    }
    for (n, span) in spans.iter_mut().step_by(step).enumerate() {
        let near = &own[n.saturating_sub(reach)..(n + reach + 1).min(own.len())];
        *span = near.iter().fold(Span::NONE, |all, s| all.plus(*s));
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::fields::lumen::runs::{Rows, Run};
    use crate::math::hash;
    use crate::progress::Progress;

    #[test]
    fn alone_is_what_has_nothing_far_away_beside_it() {
        let dims = [70, 50, 30];
        let grid = Grid::new(dims, DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let all = |_| Ok((vec![1; dims[1]], vec![Run { start: 0, end: 70, label: 0 }; dims[1]]));
        let rows = Rows::gather(dims, all).unwrap();
        let graph = Graph::of(&grid, &rows, &Progress::new()).unwrap();
        // Contacts that change by one from cell to cell, but for some that are elsewhere.
        let cells = graph.cells(&grid);
        let mut hops = vec![Hop { piece: 0, contacts: 0 }; graph.nodes.len()];
        for cell in 0..cells.dims.iter().product() {
            let at = [cell % cells.dims[0], cell / cells.dims[0] % cells.dims[1], cell / cells.dims[0] / cells.dims[1]];
            let random = hash::uniform(3, cell as u64);
            for n in cells.nodes(at) {
                let far = if random > 0.98 { 30 } else { 0 };
                let piece = u32::from((0.97..0.98).contains(&random));
                hops[n as usize] = Hop { piece, contacts: at.iter().sum::<usize>() as u32 + far };
            }
        }
        let places = Places::of(&grid, &graph, hops);
        for (voxels, far) in [(7, 10), (3, 10), (4, 5), (1, 4)] {
            let alone = places.alone(voxels, far);
            let cell = |n: usize| [0, 1, 2].map(|a| (grid.voxel(graph.nodes[n].centre)[a] + 0.5) as usize / 4);
            let near = |a: [usize; 3], b: [usize; 3]| (0..3).all(|x| a[x].abs_diff(b[x]) <= voxels.div_ceil(4));
            for n in 0..alone.len() {
                let (own, hop) = (cell(n), places.hops[n]);
                let meets = (0..alone.len()).any(|m| near(own, cell(m)) && places.hops[m].is_far(hop, far));
                assert_eq!(alone[n], !meets, "{own:?}");
            }
            assert!(alone.iter().any(|&a| a) && alone.iter().any(|&a| !a), "{voxels}, {far}");
        }
    }
}
