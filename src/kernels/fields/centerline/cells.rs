//! Cell decomposition of the lumen: cells of up to 64 voxels, split where a wall runs through them, and the contacts
//! between the pieces. It is exact, and each piece is one machine word.
//!
//! A plain coarse grid would join two loops whose common wall is thinner than a cell. Here a node is one 6-connected
//! piece of the lumen within a cell, and two nodes are neighbours only if their voxels share a face.

use glam::DVec3;
use rayon::prelude::*;

use crate::error::Result;
use crate::fields::WallDistance;
use crate::fields::neighbours::{Neighbours, Ways};
use crate::fields::voxels::each_bit;
use crate::progress::Progress;
use crate::volume::Grid;

/// A piece of the lumen in one cell.
#[derive(Clone, Copy, Debug)]
pub(in crate::fields) struct Node {
    /// The cell's voxels that belong to the piece, x fastest.
    mask: u64,
    /// The first voxel of the cell.
    corner: [i32; 3],
    /// The bit of the piece's voxel farthest from the wall.
    widest: u8,
    /// The wall distance there, mm.
    clearance: f32,
}

impl Node {
    /// Returns the wall distance of the piece's widest voxel, mm.
    pub(crate) fn clearance(&self) -> f64 {
        f64::from(self.clearance)
    }

    /// Returns the first voxel of the cell, and those of its voxels that belong to the piece, x fastest.
    pub(super) fn voxels(&self) -> ([i32; 3], u64) {
        (self.corner, self.mask)
    }
}

/// The shape of a cell: its sides, in voxels, are powers of two whose product is at most 64.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::fields) struct Shape {
    pub side: [usize; 3],
    /// For each axis, the cell's voxels on its first and on its last face.
    first: [u64; 3],
    last: [u64; 3],
}

impl Shape {
    /// Returns the shape nearest to a cube.
    fn of(spacing: DVec3) -> Self {
        let mut side = [1usize; 3];
        for _ in 0..6 {
            let extent = |a: usize| side[a] as f64 * spacing[a];
            let least = if extent(0) <= extent(1) && extent(0) <= extent(2) {
                0
            } else {
                1 + usize::from(extent(2) < extent(1))
            };
            side[least] *= 2;
        }
        Self::with_sides(side)
    }

    /// Returns the shape with these sides: powers of two whose product is at most 64.
    pub(in crate::fields) fn with_sides(side: [usize; 3]) -> Self {
        let face = |a: usize, at: usize| {
            (0..64usize)
                .filter(|b| [b % side[0], b / side[0] % side[1], b / side[0] / side[1]][a] == at)
                .fold(0, |m, b| m | 1 << b)
        };
        Self { side, first: [0, 1, 2].map(|a| face(a, 0)), last: [0, 1, 2].map(|a| face(a, side[a] - 1)) }
    }

    fn stride(&self, a: usize) -> usize {
        self.side[..a].iter().product()
    }

    pub(in crate::fields) fn offset(&self, bit: usize) -> [i64; 3] {
        [bit % self.side[0], bit / self.side[0] % self.side[1], bit / self.side[0] / self.side[1]].map(|x| x as i64)
    }

    /// Returns the voxel of a node that is farthest from the wall.
    fn widest(&self, node: &Node) -> [i64; 3] {
        let offset = self.offset(usize::from(node.widest));
        [0, 1, 2].map(|a| i64::from(node.corner[a]) + offset[a])
    }

    /// Grows a set of voxels by those of the cell that share a face with it.
    fn grown(&self, m: u64) -> u64 {
        (0..3).fold(m, |g, a| {
            let s = self.stride(a) as u32;
            // A cell that is one voxel wide along an axis has no neighbours inside itself along it.
            if self.side[a] == 1 { g } else { g | (m & !self.last[a]) << s | (m & !self.first[a]) >> s }
        })
    }

    /// Returns the 6-connected piece of `all` that contains `seed`.
    pub(in crate::fields) fn piece(&self, all: u64, seed: u64) -> u64 {
        let mut piece = seed;
        loop {
            let next = self.grown(piece) & all;
            if next == piece {
                return piece;
            }
            piece = next;
        }
    }

    /// True if a piece of one cell touches a piece of the next cell along an axis.
    fn touches(&self, a: usize, here: u64, next: u64) -> bool {
        self.contact(a, here, next) != 0
    }

    /// Returns the voxels of the next cell along an axis whose face is shared by a piece here and a piece there.
    pub(in crate::fields) fn contact(&self, a: usize, here: u64, next: u64) -> u64 {
        ((here & self.last[a]) >> ((self.side[a] - 1) * self.stride(a))) & next
    }
}

/// Cells of which one has the index of its first node.
const GROUP: usize = 8;

/// The cell decomposition.
#[derive(Debug)]
pub(in crate::fields) struct Cells {
    shape: Shape,
    pub nodes: Vec<Node>,
    grid: Grid,
    /// Number of nodes in each cell, x fastest.
    counts: Vec<u8>,
    /// Index of the first node in each [`GROUP`] of cells. Most cells have none, and an index for each would take as much as the nodes.
    first: Vec<u32>,
    dims: [usize; 3],
    neighbours: Neighbours,
    /// What the links were made for: see [`Cells::link`].
    linked_mm: f64,
}

impl Cells {
    /// Decomposes the lumen of `walls`, and links the nodes as [`Cells::link`] does.
    pub(crate) fn of(walls: &WallDistance, least_mm: f64, progress: &Progress) -> Result<Self> {
        let grid = walls.grid();
        let shape = Shape::of(grid.spacing());
        let dims: [usize; 3] = std::array::from_fn(|a| grid.dims()[a].div_ceil(shape.side[a]));
        let layers: Vec<(Vec<u8>, Vec<Node>)> = (0..dims[2])
            .into_par_iter()
            .map(|layer| {
                progress.check()?;
                Ok(nodes_of(walls, &shape, dims, layer))
            })
            .collect::<Result<_>>()?;
        let mut counts = Vec::with_capacity(dims.iter().product());
        let mut nodes = Vec::with_capacity(layers.iter().map(|l| l.1.len()).sum());
        for (own_counts, own) in layers {
            counts.extend(own_counts);
            nodes.extend(own);
        }
        let before = |sum: &mut u32, group: &[u8]| {
            let before = *sum;
            *sum += group.iter().map(|&n| u32::from(n)).sum::<u32>();
            Some(before)
        };
        let first = counts.chunks(GROUP).scan(0, before).collect();
        let neighbours = Neighbours::default();
        let (grid, linked_mm) = (grid.clone(), f64::NAN);
        let mut cells = Self { shape, grid, nodes, counts, first, dims, neighbours, linked_mm };
        cells.link(walls, least_mm);
        Ok(cells)
    }

    fn cell_of(&self, corner: [i32; 3]) -> usize {
        let c: [usize; 3] = std::array::from_fn(|a| corner[a] as usize / self.shape.side[a]);
        c[0] + self.dims[0] * (c[1] + self.dims[1] * c[2])
    }

    fn in_cell(&self, cell: usize) -> std::ops::Range<u32> {
        let group = cell / GROUP;
        let before = self.counts[group * GROUP..cell].iter().map(|&n| u32::from(n)).sum::<u32>();
        let first = self.first[group] + before;
        first..first + u32::from(self.counts[cell])
    }

    /// Returns a node's voxel farthest from the wall.
    pub(crate) fn widest(&self, n: u32) -> [i64; 3] {
        self.shape.widest(&self.nodes[n as usize])
    }

    /// Links the nodes in place of the links before, unless these are the same. Two nodes are neighbours only if the opening between them lets a body pass that
    /// needs `least_mm` on each side, by half a voxel: the middle of an opening lies between voxels.
    pub(super) fn link(&mut self, walls: &WallDistance, least_mm: f64) {
        if self.linked_mm == least_mm {
            return;
        }
        self.linked_mm = least_mm;
        let least_mm = least_mm - 0.5 * walls.grid().min_spacing();
        self.neighbours = Neighbours::default();
        let this = &*self;
        let links: Vec<(u32, u32)> = (0..this.nodes.len() as u32)
            .into_par_iter()
            .flat_map_iter(|n| {
                let node = &this.nodes[n as usize];
                let cell = this.cell_of(node.corner);
                let strides = [1, this.dims[0], this.dims[0] * this.dims[1]];
                (0..3).flat_map(move |a| {
                    let place = node.corner[a] as usize / this.shape.side[a];
                    let next = if place + 1 < this.dims[a] { this.in_cell(cell + strides[a]) } else { 0..0 };
                    next.filter(move |&m| this.is_open(walls, a, n, m, least_mm)).map(move |m| (n, m))
                })
            })
            .collect();
        self.neighbours = Neighbours::new(self.nodes.len(), &links);
    }

    /// True if two nodes touch along an axis where both have at least `least_mm` to the wall.
    fn is_open(&self, walls: &WallDistance, a: usize, here: u32, next: u32, least_mm: f64) -> bool {
        let (node, beyond) = (&self.nodes[here as usize], self.nodes[next as usize].mask);
        if !self.shape.touches(a, node.mask, beyond) {
            return false;
        }
        let back = (self.shape.side[a] - 1) * self.shape.stride(a);
        let is_free = |v: [i64; 3]| walls.at(v).is_some_and(|d| f64::from(d) >= least_mm);
        if least_mm <= 0.0 {
            return true;
        }
        let mut shared = node.mask & self.shape.last[a] & beyond << back;
        while shared != 0 {
            let offset = self.shape.offset(shared.trailing_zeros() as usize);
            let v: [i64; 3] = std::array::from_fn(|a| i64::from(node.corner[a]) + offset[a]);
            let mut w = v;
            w[a] += 1;
            if is_free(v) && is_free(w) {
                return true;
            }
            shared &= shared - 1;
        }
        false
    }

    /// Returns the shape of a cell, and the number of cells along each axis.
    pub(super) fn shape(&self) -> (Shape, [usize; 3]) {
        (self.shape, self.dims)
    }

    /// Returns for each node the start from which the way is shortest, if there is one. `starts` are nodes with what is added to
    /// their ways, mm.
    pub(super) fn roots(&self, starts: &[(u32, f64)]) -> Vec<Option<u32>> {
        self.neighbours.roots(starts, |a, b| self.place(a).distance(self.place(b)))
    }

    /// Returns the nodes that share a face with node `n`.
    pub(crate) fn neighbours(&self, n: u32) -> &[u32] {
        self.neighbours.of(n)
    }

    /// Returns the position of a node's widest voxel, world, mm.
    pub(crate) fn place(&self, n: u32) -> DVec3 {
        let [i, j, k] = self.widest(n).map(|v| v as f64);
        self.grid.world(DVec3::new(i, j, k))
    }

    /// Returns the node that contains a voxel of the lumen.
    pub(crate) fn node_at(&self, voxel: [i64; 3]) -> Option<u32> {
        let corner: [i32; 3] =
            std::array::from_fn(|a| voxel[a] as i32 / self.shape.side[a] as i32 * self.shape.side[a] as i32);
        if (0..3).any(|a| voxel[a] < 0 || corner[a] as usize / self.shape.side[a] >= self.dims[a]) {
            return None;
        }
        self.in_cell(self.cell_of(corner)).find(|&n| self.holds(n, voxel))
    }

    fn holds(&self, n: u32, voxel: [i64; 3]) -> bool {
        self.bit(n, voxel).is_some_and(|b| self.nodes[n as usize].mask >> b & 1 == 1)
    }

    /// Returns the bit of a voxel in a node's cell.
    fn bit(&self, n: u32, voxel: [i64; 3]) -> Option<usize> {
        let mut bit = 0;
        for (a, (v, corner)) in voxel.into_iter().zip(self.nodes[n as usize].corner).enumerate() {
            let at = v - i64::from(corner);
            if at < 0 || at >= self.shape.side[a] as i64 {
                return None;
            }
            bit += at as usize * self.shape.stride(a);
        }
        Some(bit)
    }

    /// Returns the least-cost paths from `start` to all nodes, or as far as `to`. A path costs its length times
    /// `weight` of the two nodes' mean clearance (mm).
    pub(crate) fn ways(&self, start: u32, to: Option<u32>, weight: impl Fn(f64) -> f64) -> Ways {
        let step = |a: u32, b: u32| self.place(a).distance(self.place(b));
        let mean = |a: u32, b: u32| 0.5 * (self.nodes[a as usize].clearance() + self.nodes[b as usize].clearance());
        self.neighbours.ways(start, to, step, |a, b| weight(mean(a, b)))
    }

    /// Returns the nodes on the path from the start of `ways` to `to`, each touching the previous one, or the start
    /// alone if there is no path.
    pub(crate) fn way(&self, ways: &Ways, to: u32) -> Vec<u32> {
        let mut out = vec![to];
        let mut n = to;
        while ways.before[n as usize] != n {
            let b = ways.before[n as usize];
            // Between two nodes that do not touch, insert the widest common neighbour.
            if !self.neighbours(n).contains(&b) {
                let between = self.neighbours(n).iter().copied().filter(|m| self.neighbours(*m).contains(&b));
                let widest = |m: &u32| self.nodes[*m as usize].clearance();
                out.extend(between.reduce(|m, o| if widest(&o) > widest(&m) { o } else { m }));
            }
            out.push(b);
            n = b;
        }
        out.reverse();
        out
    }

    /// Returns a 6-connected path of voxels from `from` to `to` that stays inside the given sequence of touching nodes.
    pub(crate) fn voxels(&self, way: &[u32], from: [i64; 3], to: [i64; 3]) -> Vec<[i64; 3]> {
        let mut out = vec![from];
        let mut at = from;
        for (n, pair) in way.windows(2).enumerate() {
            let goal = if n + 2 == way.len() { to } else { self.widest(pair[1]) };
            out.extend(self.hop(pair, at, goal));
            at = goal;
        }
        if let &[only] = way {
            out.extend(self.hop(&[only, only], from, to));
        }
        out
    }

    /// Returns the shortest path from `from` to `to` through the voxels of two nodes, without its first voxel.
    fn hop(&self, pair: &[u32], from: [i64; 3], to: [i64; 3]) -> Vec<[i64; 3]> {
        let mut reached: Vec<([i64; 3], usize)> = vec![(from, 0)];
        let mut seen = [0u64; 2];
        let mark = |seen: &mut [u64; 2], v: [i64; 3]| {
            (0..2).any(|p| match self.bit(pair[p], v) {
                Some(b) if self.nodes[pair[p] as usize].mask >> b & 1 == 1 && seen[p] >> b & 1 == 0 => {
                    seen[p] |= 1 << b;
                    true
                }
                _ => false,
            })
        };
        mark(&mut seen, from);
        let mut next = 0;
        while next < reached.len() {
            let at = reached[next].0;
            if at == to {
                let mut way = Vec::new();
                let mut n = next;
                while n != 0 {
                    way.push(reached[n].0);
                    n = reached[n].1;
                }
                way.reverse();
                return way;
            }
            for s in 0..6 {
                let mut v = at;
                v[s / 2] += if s % 2 == 0 { 1 } else { -1 };
                if mark(&mut seen, v) {
                    reached.push((v, next));
                }
            }
            next += 1;
        }
        Vec::new()
    }
}

/// Returns the number of nodes in each cell of a layer, and the nodes.
fn nodes_of(walls: &WallDistance, shape: &Shape, dims: [usize; 3], layer: usize) -> (Vec<u8>, Vec<Node>) {
    let [_, ny, nz] = walls.grid().dims();
    let set = walls.set();
    let mut masks = vec![0u64; dims[0] * dims[1]];
    for k in layer * shape.side[2]..((layer + 1) * shape.side[2]).min(nz) {
        for j in 0..ny {
            let row = dims[0] * (j / shape.side[1]);
            let bit = (j % shape.side[1]) * shape.stride(1) + (k % shape.side[2]) * shape.stride(2);
            let mut number = set.row_start(j, k);
            for (w, &word) in set.row(j, k).iter().enumerate() {
                each_bit(word, |b| {
                    let x = 64 * w + b;
                    if walls.value(number) >= 0.0 {
                        masks[row + x / shape.side[0]] |= 1 << (bit + x % shape.side[0]);
                    }
                    number += 1;
                });
            }
        }
    }
    let mut counts = Vec::with_capacity(masks.len());
    let mut nodes = Vec::new();
    for (cell, &all) in masks.iter().enumerate() {
        let corner = [cell % dims[0] * shape.side[0], cell / dims[0] * shape.side[1], layer * shape.side[2]];
        let before = nodes.len();
        let mut rest = all;
        while rest != 0 {
            let mask = shape.piece(all, rest & rest.wrapping_neg());
            rest &= !mask;
            let mut best: Option<(f32, u8)> = None;
            each_bit(mask, |b| {
                let o = shape.offset(b);
                let v = [0, 1, 2].map(|a| corner[a] as i64 + o[a]);
                let d = walls.at(v).unwrap_or(0.0);
                if best.is_none_or(|b| d > b.0) {
                    best = Some((d, b as u8));
                }
            });
            let (clearance, widest) = best.unwrap_or_default();
            nodes.push(Node { mask, corner: corner.map(|x| x as i32), widest, clearance });
        }
        counts.push((nodes.len() - before) as u8);
    }
    (counts, nodes)
}

impl Cells {
    /// Returns the nodes of a node's connected piece, ascending.
    fn connected(&self, start: u32, seen: &mut [bool]) -> Vec<u32> {
        let mut piece = vec![start];
        seen[start as usize] = true;
        let mut next = 0;
        while next < piece.len() {
            for &m in self.neighbours(piece[next]) {
                if !std::mem::replace(&mut seen[m as usize], true) {
                    piece.push(m);
                }
            }
            next += 1;
        }
        piece.sort_unstable();
        piece
    }

    /// Returns the smallest node of a node's connected piece, which identifies the piece.
    pub(crate) fn piece(&self, n: u32) -> u32 {
        self.connected(n, &mut vec![false; self.nodes.len()])[0]
    }

    /// Returns the nodes of the connected piece with the most voxels, the first one if several are equal. Empty if
    /// there is no lumen.
    pub(crate) fn largest_piece(&self) -> Vec<u32> {
        let mut seen = vec![false; self.nodes.len()];
        let mut best = (0, Vec::new());
        for n in 0..self.nodes.len() as u32 {
            if !seen[n as usize] {
                let piece = self.connected(n, &mut seen);
                let voxels: u64 = piece.iter().map(|&m| u64::from(self.nodes[m as usize].mask.count_ones())).sum();
                if voxels > best.0 {
                    best = (voxels, piece);
                }
            }
        }
        best.1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::uniform;

    #[test]
    fn a_cell_has_64_voxels_and_is_nearly_a_cube() {
        for (spacing, side) in [
            (DVec3::ONE, [4, 4, 4]),
            (DVec3::new(0.5, 1.0, 2.0), [8, 4, 2]),
            (DVec3::new(2.0, 0.5, 1.0), [2, 8, 4]),
            (DVec3::new(1.0, 2.0, 0.5), [4, 2, 8]),
            (DVec3::new(0.7, 0.7, 1.0), [4, 4, 4]),
            (DVec3::new(0.7, 0.7, 3.0), [8, 8, 1]),
        ] {
            assert_eq!(Shape::of(spacing).side, side, "{spacing}");
        }
    }

    /// A set of a cell's voxels grows by those that share a face with one of them, and keeps all it has.
    #[test]
    fn a_set_grows_by_the_voxels_beside_it() {
        for spacing in [DVec3::ONE, DVec3::new(0.5, 1.0, 2.0), DVec3::new(0.7, 0.7, 3.0)] {
            let shape = Shape::of(spacing);
            let apart = |a: usize, b: usize| {
                let (a, b) = (shape.offset(a), shape.offset(b));
                (0..3).map(|x| (a[x] - b[x]).abs()).sum::<i64>()
            };
            for seed in 0..50 {
                let members: Vec<usize> = (0..64usize).filter(|&b| uniform(seed, b as u64) < 0.2).collect();
                let set = members.iter().fold(0u64, |m, &b| m | 1 << b);
                let beside = (0..64usize).filter(|&b| members.iter().any(|&m| apart(m, b) <= 1));
                let expected = beside.fold(0u64, |m, b| m | 1 << b);
                assert_eq!(shape.grown(set), expected, "{spacing}: {set:#x}");
            }
        }
    }
}
