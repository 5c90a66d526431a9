//! A coarse map of the gas: cells of at least 4 mm, split where a wall runs through them, and the contacts between
//! them.
//!
//! A plain coarse grid would join two loops whose common wall is thinner than a cell. Here a node is the part of *one*
//! connected piece of gas within a cell, and two nodes are neighbours only if their voxels touch.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::runs::{Rows, Run, Sets, touching};
use crate::error::Result;
use crate::fields::neighbours::{Neighbours, Ways};
use crate::progress::Progress;
use crate::volume::Grid;

/// Minimum side of a cell, mm.
const CELL_MM: f64 = 4.0;
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
    offsets: Vec<usize>,
}

impl Slice {
    fn row(&self, j: usize) -> &[Run] {
        &self.runs[self.offsets[j]..self.offsets[j + 1]]
    }

    /// Cuts the runs at every `side` voxels and labels them with their number, counted from `first`.
    fn cut(rows: &Rows, k: usize, side: u32, first: u32) -> Self {
        let mut out = Self { runs: Vec::new(), offsets: vec![0] };
        for j in 0..rows.dims()[1] {
            for r in rows.row(j, k) {
                let mut start = r.start;
                while start < r.end {
                    let end = ((start / side + 1) * side).min(r.end);
                    out.runs.push(Run { start, end, label: first + out.runs.len() as u32 });
                    start = end;
                }
            }
            out.offsets.push(out.runs.len());
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
        let pairs = links.iter().flat_map(|&(a, b)| [(a, b), (b, a)]).collect();
        drop(links);
        let mut graph = Self { nodes: Vec::new(), neighbours: Neighbours::new(sums.len(), pairs) };
        graph.measure(grid, side, sums);
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

    /// Returns the runs that the map was made of, labelled with what `label` makes of the number of their node.
    ///
    /// # Errors
    /// Returns an error if cancelled, or if there are too many runs.
    pub(crate) fn labelled(
        &self,
        grid: &Grid,
        rows: &Rows,
        label: impl Fn(u32) -> u32,
        progress: &Progress,
    ) -> Result<Rows> {
        let side = cell(grid);
        let dims @ [_, ny, nz] = rows.dims();
        let mut out = Rows::from_slices(dims, Vec::new())?;
        let mut base = 0;
        for some in (0..nz.div_ceil(side[2])).collect::<Vec<_>>().chunks(SLABS) {
            let slabs = some.par_iter().map(|s| {
                progress.check()?;
                Ok(slab_and_slices(rows, side, s * side[2]..((s + 1) * side[2]).min(nz)))
            });
            for (slab, slices) in slabs.collect::<Result<Vec<_>>>()? {
                for slice in slices {
                    let mut runs: Vec<Run> = Vec::with_capacity(slice.runs.len());
                    let mut lengths = Vec::with_capacity(ny);
                    for j in 0..ny {
                        let before = runs.len();
                        for r in slice.row(j) {
                            let label = label(base + r.label);
                            match runs[before..].last_mut() {
                                Some(last) if last.end == r.start && last.label == label => last.end = r.end,
                                _ => runs.push(Run { label, ..*r }),
                            }
                        }
                        lengths.push((runs.len() - before) as u32);
                    }
                    out.append((lengths, runs))?;
                }
                base += slab.sums.len() as u32;
            }
        }
        Ok(out)
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

/// Returns the voxels along each side of a cell.
pub(super) fn cell(grid: &Grid) -> [usize; 3] {
    std::array::from_fn(|a| ((CELL_MM / grid.spacing()[a]).ceil() as usize).max(1))
}

/// Returns the layer of cells that consists of the slices `ks`.
fn slab(rows: &Rows, side: [usize; 3], ks: Range<usize>) -> Slab {
    let (slab, _) = slab_and_slices(rows, side, ks);
    slab
}

/// Same as [`slab`], with all its slices, whose runs are labelled with the slab's nodes.
fn slab_and_slices(rows: &Rows, side: [usize; 3], ks: Range<usize>) -> (Slab, Vec<Slice>) {
    let ny = rows.dims()[1];
    let mut slices: Vec<Slice> = Vec::with_capacity(ks.len());
    let mut count = 0;
    for k in ks.clone() {
        slices.push(Slice::cut(rows, k, side[0] as u32, count));
        count += slices[slices.len() - 1].runs.len() as u32;
    }
    let mut sets = Sets::new(count as usize);
    let mut contacts: Vec<(u32, u32)> = Vec::new();
    for (n, slice) in slices.iter().enumerate() {
        for j in 0..ny {
            let here = slice.row(j);
            contacts.extend(here.windows(2).filter(|w| w[0].end == w[1].start).map(|w| (w[0].label, w[1].label)));
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
                    if same { sets.join(a, b) } else { contacts.push((a, b)) }
                });
            }
        }
    }
    let (node, nodes) = sets.numbered();
    let mut sums: Vec<Sum> = vec![(DVec3::ZERO, 0, 0); nodes];
    for (k, slice) in ks.zip(&mut slices) {
        for j in 0..ny {
            for n in slice.offsets[j]..slice.offsets[j + 1] {
                let run = &mut slice.runs[n];
                run.label = node[run.label as usize];
                let sum = &mut sums[run.label as usize];
                let middle = f64::from(run.start + run.end - 1) / 2.0;
                sum.0 += DVec3::new(middle, j as f64, k as f64) * f64::from(run.len());
                sum.1 += run.len();
                sum.2 = rows.find(i64::from(run.start), j as i64, k as i64).map_or(0, |r| r.label);
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
    let faces = [slices.first(), slices.last()].map(|s| s.cloned().unwrap_or_default());
    (Slab { sums, links, faces }, slices)
}
