//! A coarse map of the gas: cells of at least 4 mm, split where a wall runs through them, and the contacts between them.
//!
//! A plain coarse grid would join two loops whose common wall is thinner than a cell. Here a node is the part of *one*
//! connected piece of gas within a cell, and two nodes are neighbours only if their voxels touch.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::cells::{CELL_MM, Cells, by_cells, cell};
use super::runs::{Rows, Run, touching};
use crate::error::Result;
use crate::fields::neighbours::{Neighbours, Ways};
use crate::math::sets::Sets;
use crate::progress::Progress;
use crate::volume::Grid;

/// Number of cell layers made at a time: their cut runs are many times as large as the result.
const SLABS: usize = 8;
/// Clearance at which narrowness begins to add cost, mm: a path costs its length times 1 + (this / clearance)².
const NARROW_MM: f64 = 8.0;

/// The part of one piece of gas within one cell.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    /// Mean position of its voxels, world, mm.
    pub centre: DVec3,
    /// Distance to the wall, mm, as coarse as the map.
    pub clearance: f64,
    /// Label of the gas.
    pub label: u32,
    /// Number of its voxels.
    pub voxels: u32,
}

/// The coarse map.
#[derive(Debug)]
pub(super) struct Graph {
    pub nodes: Vec<Node>,
    neighbours: Neighbours,
}

/// The sum of a node's voxel indices, the number of its voxels, and their label.
type Sum = (DVec3, u32, u32);

/// One layer of cells.
#[derive(Debug, Default)]
struct Slab {
    sums: Vec<Sum>,
    /// Pairs of the slab's own nodes that touch, each once.
    links: Vec<(u32, u32)>,
    /// The first and the last slice, whose runs are labelled with the slab's nodes.
    faces: [Slice; 2],
}

/// The cut runs of a slice, and the start of each row.
#[derive(Clone, Debug, Default)]
struct Slice {
    runs: Vec<Run>,
    offsets: Vec<u32>,
}

impl Slice {
    fn row(&self, j: usize) -> &[Run] {
        &self.runs[self.offsets[j] as usize..self.offsets[j + 1] as usize]
    }

    /// Cuts the runs at the sides of cells and labels them with their number, counted from `first`. Only what lies in a cell for which
    /// `takes` (x and y of the cell) is true is taken.
    fn cut(rows: &Rows, k: usize, side: [usize; 3], first: u32, takes: impl Fn(usize, usize) -> bool) -> Self {
        let mut out = Self { runs: Vec::new(), offsets: vec![0] };
        for j in 0..rows.dims()[1] {
            for r in rows.row(j, k) {
                for x in by_cells(r.start..r.end, side[0]) {
                    if takes(x.start as usize / side[0], j / side[1]) {
                        out.runs.push(Run { start: x.start, end: x.end, label: first + out.runs.len() as u32 });
                    }
                }
            }
            out.offsets.push(out.runs.len() as u32);
        }
        out
    }
}

impl Graph {
    /// Creates the map of labelled gas, in which runs of different labels never touch.
    pub(crate) fn of(grid: &Grid, rows: &Rows, progress: &Progress) -> Result<Self> {
        let side = cell(grid);
        let [_, ny, nz] = rows.dims();
        let count = nz.div_ceil(side[2]);
        let (mut sums, mut links): (Vec<Sum>, Vec<(u32, u32)>) = Default::default();
        let mut below: Option<(u32, Slice)> = None;
        for some in (0..count).step_by(SLABS) {
            let slabs = (some..(some + SLABS).min(count)).into_par_iter().map(|s| {
                progress.check()?;
                Ok(slab(rows, side, s * side[2]..((s + 1) * side[2]).min(nz)))
            });
            for slab in slabs.collect::<Result<Vec<_>>>()? {
                let base = sums.len() as u32;
                links.extend(slab.links.iter().map(|&(a, b)| (base + a, base + b)));
                let [first, last] = slab.faces;
                if let Some((base_below, below)) = &below {
                    for j in 0..ny {
                        touching(below.row(j), first.row(j), |a, b| {
                            links.push((base_below + below.row(j)[a].label, base + first.row(j)[b].label));
                        });
                    }
                }
                below = Some((base, last));
                sums.extend(slab.sums);
            }
        }
        let mut graph = Self { nodes: Vec::new(), neighbours: Neighbours::new(sums.len(), &links) };
        drop(links);
        graph.measure(grid, side, sums);
        colvis_scan::memory::release();
        Ok(graph)
    }

    /// Fills in centres and clearances.
    fn measure(&mut self, grid: &Grid, side: [usize; 3], sums: Vec<Sum>) {
        let full = side.iter().product::<usize>() as f64;
        let half = (0..3).map(|a| side[a] as f64 * grid.spacing()[a]).fold(f64::MAX, f64::min) / 2.0;
        // A node that does not fill its cell contains the wall; the filled fraction indicates how near it is.
        self.nodes = sums
            .into_iter()
            .map(|(sum, n, label)| {
                let fill = f64::from(n) / full;
                let clearance = if fill < 1.0 { half * fill } else { f64::INFINITY };
                Node { centre: grid.world(sum / f64::from(n)), clearance, label, voxels: n }
            })
            .collect();
        let walls: Vec<(u32, f64)> =
            (0u32..).zip(&self.nodes).map(|(n, node)| (n, node.clearance)).filter(|w| w.1.is_finite()).collect();
        let distance = self.neighbours.costs(&walls, |a, b| self.step(a, b));
        for (node, d) in self.nodes.iter_mut().zip(distance) {
            node.clearance = if d.is_finite() { d } else { half };
        }
    }

    /// Returns the number of contacts that a way of `mm` along the axes has at least.
    pub(crate) fn far_hops(&self, grid: &Grid, mm: f64) -> u32 {
        let side = cell(grid);
        let longest = (0..3).map(|a| side[a] as f64 * grid.spacing()[a]).fold(CELL_MM, f64::max);
        (mm / longest).ceil() as u32
    }

    /// Returns the nodes in each cell.
    pub(crate) fn cells(&self, grid: &Grid) -> Cells {
        Cells::of(grid, self.nodes.iter().map(|n| n.centre))
    }

    /// Returns the runs that the map was made of, with `label` applied to the number of each one's node. Fails if cancelled, or if
    /// there are too many runs.
    pub(crate) fn labelled(
        &self,
        cells: &Cells,
        rows: &Rows,
        label: impl Fn(u32) -> u32 + Sync,
        progress: &Progress,
    ) -> Result<Rows> {
        let (side, dims) = (cells.side, rows.dims());
        let slice = |k: usize, shared: &Slice| {
            let (mut runs, mut lengths): (Vec<Run>, _) = (Vec::new(), Vec::with_capacity(dims[1]));
            for j in 0..dims[1] {
                let before = runs.len();
                let mut shared = shared.row(j).iter();
                let cell = |i: usize| [i, j / side[1], k / side[2]];
                for x in rows.row(j, k).iter().flat_map(|r| by_cells(r.start..r.end, side[0])) {
                    let only = cells.only(cell(x.start as usize / side[0]));
                    let Some(node) = only.or_else(|| shared.next().map(|r| r.label)) else { continue };
                    let label = label(node);
                    match runs[before..].last_mut() {
                        Some(last) if last.end == x.start && last.label == label => last.end = x.end,
                        _ => runs.push(Run { start: x.start, end: x.end, label }),
                    }
                }
                lengths.push((runs.len() - before) as u32);
            }
            (lengths, runs)
        };
        // Room that is not used is no memory.
        Rows::gather_layers(dims, side[2], 4 * rows.runs().len(), |layer| {
            progress.check()?;
            let shared = shared_cells(rows, cells, layer);
            Ok((layer * side[2]..).zip(&shared).map(|(k, shared)| slice(k, shared)).collect())
        })
    }

    pub(crate) fn neighbours(&self, n: u32) -> &[u32] {
        self.neighbours.of(n)
    }

    /// Returns the distance between two nodes' centres, mm.
    fn step(&self, a: u32, b: u32) -> f64 {
        self.nodes[a as usize].centre.distance(self.nodes[b as usize].centre)
    }

    /// Returns the nodes of a label.
    pub(crate) fn of_label(&self, label: u32) -> impl Iterator<Item = u32> + '_ {
        (0..self.nodes.len() as u32).filter(move |&n| self.nodes[n as usize].label == label)
    }

    /// Returns the paths from `start` that keep away from walls and within its label.
    pub(crate) fn ways(&self, start: u32) -> Ways {
        let weight = |a: u32, b: u32| {
            let (a, b) = (&self.nodes[a as usize], &self.nodes[b as usize]);
            if a.label != b.label {
                return f64::INFINITY;
            }
            let clear = (a.clearance + b.clearance) / 2.0;
            1.0 + (NARROW_MM / clear.max(0.5)).powi(2)
        };
        self.neighbours.ways(start, None, |a, b| self.step(a, b), weight)
    }
}

/// Returns the layer of cells that consists of the slices `ks`.
fn slab(rows: &Rows, side: [usize; 3], ks: Range<usize>) -> Slab {
    let ny = rows.dims()[1];
    let mut slices = cut_all(rows, side, ks.clone(), |_, _| true);
    let mut contacts: Vec<(u32, u32)> = Vec::new();
    for slice in &slices {
        for j in 0..ny {
            let touch = slice.row(j).windows(2).filter(|w| w[0].end == w[1].start);
            contacts.extend(touch.map(|w| (w[0].label, w[1].label)));
        }
    }
    let (node, nodes) = connected(&slices, side, |a, b| contacts.push((a, b)));
    let mut sums: Vec<Sum> = vec![(DVec3::ZERO, 0, 0); nodes];
    for (k, slice) in ks.zip(&mut slices) {
        for j in 0..ny {
            let mut whole = rows.row(j, k).iter();
            let mut of = whole.next();
            for n in slice.offsets[j]..slice.offsets[j + 1] {
                let run = &mut slice.runs[n as usize];
                while of.is_some_and(|r| r.end <= run.start) {
                    of = whole.next();
                }
                run.label = node[run.label as usize];
                let sum = &mut sums[run.label as usize];
                let middle = f64::from(run.start + run.end - 1) / 2.0;
                sum.0 += DVec3::new(middle, j as f64, k as f64) * f64::from(run.len());
                sum.1 += run.len();
                sum.2 = of.map_or(0, |r| r.label);
            }
        }
    }
    let mut links: Vec<(u32, u32)> = contacts
        .iter()
        .map(|&(a, b)| (node[a as usize], node[b as usize]))
        .map(|(a, b)| (a.min(b), a.max(b)))
        .collect();
    links.sort_unstable();
    links.dedup();
    let last = if slices.len() > 1 { slices.pop() } else { slices.first().cloned() };
    let faces = [slices.into_iter().next(), last].map(Option::unwrap_or_default);
    Slab { sums, links, faces }
}

/// Returns the cut runs of the slices `ks`, numbered through (see [`Slice::cut`]).
fn cut_all(rows: &Rows, side: [usize; 3], ks: Range<usize>, takes: impl Fn(usize, usize) -> bool) -> Vec<Slice> {
    let mut count = 0;
    ks.map(|k| {
        let slice = Slice::cut(rows, k, side, count, &takes);
        count += slice.runs.len() as u32;
        slice
    })
    .collect()
}

/// Returns the piece of gas within its cell that each cut run of a layer of cells belongs to, in the order of their first runs, and
/// their number. Calls `contact` with each two runs of neighbouring cells in a slice that touch along y.
fn connected(slices: &[Slice], side: [usize; 3], mut contact: impl FnMut(u32, u32)) -> (Vec<u32>, usize) {
    let mut sets = Sets::new(slices.iter().map(|s| s.runs.len()).sum());
    for (n, slice) in slices.iter().enumerate() {
        for j in 0..slice.offsets.len() - 1 {
            let here = slice.row(j);
            // Runs were cut at cell sides, so two that share an x are in the same column of cells.
            if n > 0 {
                let other = slices[n - 1].row(j);
                touching(other, here, |a, b| sets.join(other[a].label, here[b].label));
            }
            if j > 0 {
                let other = slice.row(j - 1);
                let same = (j - 1) / side[1] == j / side[1];
                touching(other, here, |a, b| {
                    let (a, b) = (other[a].label, here[b].label);
                    if same { sets.join(a, b) } else { contact(a, b) }
                });
            }
        }
    }
    sets.numbered()
}

/// Returns the runs of a layer of cells that lie in cells of several nodes, labelled with their nodes.
fn shared_cells(rows: &Rows, cells: &Cells, layer: usize) -> Vec<Slice> {
    let (side, [_, ny, nz]) = (cells.side, rows.dims());
    let ks = layer * side[2]..((layer + 1) * side[2]).min(nz);
    let mut slices = cut_all(rows, side, ks, |i, j| cells.only([i, j, layer]).is_none());
    let (piece, count) = connected(&slices, side, |_, _| {});
    // Pieces and nodes of a cell are both in the order of their first runs.
    let mut node = vec![Cells::NONE; count];
    let [nx, ny_cells, _] = cells.dims;
    let mut open: Vec<u32> = (0..nx * ny_cells).map(|n| cells.first([n % nx, n / nx, layer])).collect();
    for slice in &mut slices {
        for j in 0..ny {
            for n in slice.offsets[j]..slice.offsets[j + 1] {
                let run = &mut slice.runs[n as usize];
                let own = &mut node[piece[run.label as usize] as usize];
                if *own == Cells::NONE {
                    let next = &mut open[run.start as usize / side[0] + nx * (j / side[1])];
                    *own = *next;
                    *next = cells.next(*next);
                }
                run.label = *own;
            }
        }
    }
    slices
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::math::hash;

    /// Gas with walls through many cells, and single voxels.
    fn speckled() -> (Grid, Rows) {
        let grid = Grid::new([61, 40, 33], DVec3::new(0.8, 0.9, 1.3), DVec3::ONE, DMat3::IDENTITY).unwrap();
        let rows = Rows::gather([61, 40, 33], |k| {
            let (mut runs, mut lengths): (Vec<Run>, Vec<u32>) = Default::default();
            for j in 0..40 {
                let before = runs.len();
                for i in 0..61 {
                    let random = hash::uniform(7, grid.index(i, j, k) as u64);
                    let is_gas = (i % 9 != 3 && j % 11 != 5 && k % 13 != 6 && random > 0.05) || random > 0.9;
                    match runs[before..].last_mut() {
                        Some(last) if is_gas && last.end == i as u32 => last.end += 1,
                        _ if is_gas => runs.push(Run { start: i as u32, end: i as u32 + 1, label: 0 }),
                        _ => {}
                    }
                }
                lengths.push((runs.len() - before) as u32);
            }
            Ok((lengths, runs))
        });
        (grid, rows.unwrap())
    }

    #[test]
    fn every_voxel_is_labelled_with_its_own_node() {
        let progress = Progress::new();
        let (grid, rows) = speckled();
        let graph = Graph::of(&grid, &rows, &progress).unwrap();
        let cells = graph.cells(&grid);
        let [nx, ny, nz] = cells.dims;
        let shared = (0..nx * ny * nz).filter(|n| cells.nodes([n % nx, n / nx % ny, n / nx / ny]).count() > 1);
        assert!(shared.count() > 100);
        let labelled = graph.labelled(&cells, &rows, |n| n, &progress).unwrap();
        let mut sums = vec![(DVec3::ZERO, 0); graph.nodes.len()];
        for (j, k, r) in labelled.iter() {
            for i in r.range() {
                let sum = &mut sums[r.label as usize];
                *sum = (sum.0 + grid.world(DVec3::new(i as f64, j as f64, k as f64)), sum.1 + 1);
            }
        }
        for (node, (sum, voxels)) in graph.nodes.iter().zip(sums) {
            assert_eq!(node.voxels, voxels);
            assert!(node.centre.distance(sum / f64::from(voxels)) < 1e-9);
        }
        // With one label the runs are those that the map was made of.
        assert_eq!(graph.labelled(&cells, &rows, |_| 0, &progress).unwrap(), rows);
    }
}
