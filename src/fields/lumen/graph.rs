//! A coarse map of the gas: cells of at least 4 mm, split where a wall runs through them, and who touches whom.
//!
//! A plain coarse grid would join two loops whose common wall is thinner than a cell. Here a node is what of *one*
//! connected piece of gas lies in a cell, and two nodes are neighbours only where their voxels touch.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec3;

use super::runs::{Rows, Run, Sets, touching};
use crate::volume::Grid;

/// Least side of a cell, mm.
const CELL_MM: f64 = 4.0;
/// Clearance at which narrowness begins to cost, mm: the cost of a way is its length times 1 + (this / clearance)².
const NARROW_MM: f64 = 8.0;

/// What of one piece of gas lies in one cell.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    /// Centre of its voxels, world, mm.
    pub centre: DVec3,
    /// Distance to the wall, mm: as coarse as the map.
    pub clearance: f64,
    /// Label of the gas.
    pub label: u32,
}

/// The coarse map.
#[derive(Debug)]
pub(super) struct Graph {
    pub nodes: Vec<Node>,
    /// Where each node's neighbours begin in `neighbours`; one entry more than there are nodes.
    first: Vec<u32>,
    neighbours: Vec<u32>,
}

/// The cheapest ways from one node.
#[derive(Debug)]
pub(super) struct Ways {
    /// Length of the way to every node, mm; infinite where there is none.
    pub length: Vec<f64>,
    /// The node before every node on its way; itself at the start and where there is none.
    pub before: Vec<u32>,
}

impl Graph {
    /// The map of labelled gas.
    pub fn of(grid: &Grid, rows: &Rows) -> Self {
        let side: [usize; 3] = std::array::from_fn(|a| ((CELL_MM / grid.spacing()[a]).ceil() as usize).max(1));
        let (cut, offsets) = cut(rows, side[0] as u32);
        let [_, ny, nz] = rows.dims();
        let row = |j: usize, k: usize| offsets[j + ny * k] as usize..offsets[j + ny * k + 1] as usize;
        let mut sets = Sets::new(cut.len());
        let mut contacts: Vec<(u32, u32)> = Vec::new();
        for k in 0..nz {
            for j in 0..ny {
                let here = row(j, k);
                for (a, pair) in cut[here.clone()].windows(2).enumerate() {
                    if pair[0].end == pair[1].start && pair[0].label == pair[1].label {
                        contacts.push(((here.start + a) as u32, (here.start + a + 1) as u32));
                    }
                }
                let beside = [
                    (j > 0).then(|| (row(j - 1, k), (j - 1) / side[1] == j / side[1])),
                    (k > 0).then(|| (row(j, k - 1), (k - 1) / side[2] == k / side[2])),
                ];
                for (other, same) in beside.into_iter().flatten() {
                    touching(&cut[other.clone()], &cut[here.clone()], |a, b| {
                        if cut[other.start + a].label != cut[here.start + b].label {
                            return;
                        }
                        // Pieces were cut at cell sides, so two that overlap in x lie in the same column of cells.
                        let (a, b) = ((other.start + a) as u32, (here.start + b) as u32);
                        if same {
                            sets.join(a, b);
                        } else {
                            contacts.push((a, b));
                        }
                    });
                }
            }
        }
        let (of_piece, count) = sets.numbered();
        let mut graph =
            Self::linked(count, contacts.iter().map(|&(a, b)| (of_piece[a as usize], of_piece[b as usize])));
        drop(contacts);
        graph.measure(grid, side, &of_piece, &cut, &offsets, ny);
        graph
    }

    fn linked(count: usize, contacts: impl Iterator<Item = (u32, u32)>) -> Self {
        let mut links: Vec<(u32, u32)> = contacts.flat_map(|(a, b)| [(a, b), (b, a)]).collect();
        links.sort_unstable();
        links.dedup();
        let mut first = vec![0; count + 1];
        for l in &links {
            first[l.0 as usize + 1] += 1;
        }
        for n in 0..count {
            first[n + 1] += first[n];
        }
        Self { nodes: Vec::new(), first, neighbours: links.into_iter().map(|l| l.1).collect() }
    }

    /// Fills in centres and clearances.
    fn measure(&mut self, grid: &Grid, side: [usize; 3], of_piece: &[u32], cut: &[Run], offsets: &[u32], ny: usize) {
        let count = self.first.len() - 1;
        let mut sums = vec![(DVec3::ZERO, 0u32, 0u32); count];
        for (r, w) in offsets.windows(2).enumerate() {
            let (j, k) = ((r % ny) as f64, (r / ny) as f64);
            for n in w[0]..w[1] {
                let (p, s) = (cut[n as usize], &mut sums[of_piece[n as usize] as usize]);
                let middle = f64::from(p.start + p.end - 1) / 2.0;
                s.0 += DVec3::new(middle, j, k) * f64::from(p.len());
                s.1 += p.len();
                s.2 = p.label;
            }
        }
        let full = side.iter().product::<usize>() as f64;
        let half = (0..3).map(|a| side[a] as f64 * grid.spacing()[a]).fold(f64::MAX, f64::min) / 2.0;
        // A node that does not fill its cell has the wall in it; how much of the cell it fills says how near.
        self.nodes = sums
            .into_iter()
            .map(|(sum, n, label)| {
                let fill = f64::from(n) / full;
                let clearance = if fill < 1.0 { half * fill } else { f64::INFINITY };
                Node { centre: grid.world(sum / f64::from(n)), clearance, label }
            })
            .collect();
        let walls: Vec<(u32, f64)> =
            (0..count as u32).map(|n| (n, self.nodes[n as usize].clearance)).filter(|w| w.1.is_finite()).collect();
        let distance = self.spread(&walls, |_, _| 1.0).0;
        for (node, d) in self.nodes.iter_mut().zip(distance) {
            node.clearance = if d.is_finite() { d } else { half };
        }
    }

    pub fn neighbours(&self, n: u32) -> &[u32] {
        &self.neighbours[self.first[n as usize] as usize..self.first[n as usize + 1] as usize]
    }

    /// The nodes of a label.
    pub fn of_label(&self, label: u32) -> impl Iterator<Item = u32> + '_ {
        (0..self.nodes.len() as u32).filter(move |&n| self.nodes[n as usize].label == label)
    }

    /// The ways from `start` that keep clear of walls.
    pub fn ways(&self, start: u32) -> Ways {
        let weight = |a: u32, b: u32| {
            let clear = (self.nodes[a as usize].clearance + self.nodes[b as usize].clearance) / 2.0;
            1.0 + (NARROW_MM / clear.max(0.5)).powi(2)
        };
        let (_, before, settled) = self.spread_ordered(&[(start, 0.0)], weight);
        let mut length = vec![f64::INFINITY; self.nodes.len()];
        for n in settled {
            let b = before[n as usize];
            let step = self.nodes[n as usize].centre.distance(self.nodes[b as usize].centre);
            length[n as usize] = if b == n { 0.0 } else { length[b as usize] + step };
        }
        Ways { length, before }
    }

    fn spread(&self, from: &[(u32, f64)], weight: impl Fn(u32, u32) -> f64) -> (Vec<f64>, Vec<u32>) {
        let (cost, before, _) = self.spread_ordered(from, weight);
        (cost, before)
    }

    /// Dijkstra's algorithm over neighbours and their neighbours, so that a way may run diagonally through cells:
    /// costs, the nodes before, and the nodes in the order they were reached. Ties go to the smaller node.
    fn spread_ordered(&self, from: &[(u32, f64)], weight: impl Fn(u32, u32) -> f64) -> (Vec<f64>, Vec<u32>, Vec<u32>) {
        let count = self.nodes.len();
        let mut cost = vec![f64::INFINITY; count];
        let mut before: Vec<u32> = (0..count as u32).collect();
        let mut done = vec![false; count];
        let mut settled = Vec::new();
        // Costs are not negative, so their bits order as they do.
        let mut open: BinaryHeap<Reverse<(u64, u32)>> = BinaryHeap::new();
        for &(n, c) in from {
            cost[n as usize] = c;
            open.push(Reverse((c.to_bits(), n)));
        }
        while let Some(Reverse((_, n))) = open.pop() {
            if std::mem::replace(&mut done[n as usize], true) {
                continue;
            }
            settled.push(n);
            let mut reach = |m: u32| {
                if done[m as usize] {
                    return;
                }
                let step = self.nodes[n as usize].centre.distance(self.nodes[m as usize].centre);
                let c = cost[n as usize] + step * weight(n, m);
                if c < cost[m as usize] {
                    cost[m as usize] = c;
                    before[m as usize] = n;
                    open.push(Reverse((c.to_bits(), m)));
                }
            };
            for &m in self.neighbours(n) {
                reach(m);
                for &far in self.neighbours(m) {
                    reach(far);
                }
            }
        }
        (cost, before, settled)
    }

    /// Size in memory.
    pub fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<Node>() + (self.first.capacity() + self.neighbours.capacity()) * 4
    }
}

/// Runs cut at every `side` voxels, and where each row begins.
fn cut(rows: &Rows, side: u32) -> (Vec<Run>, Vec<u32>) {
    let [_, ny, nz] = rows.dims();
    let mut out = Vec::new();
    let mut offsets = Vec::with_capacity(ny * nz + 1);
    offsets.push(0);
    for k in 0..nz {
        for j in 0..ny {
            for r in rows.row(j, k) {
                let mut start = r.start;
                while start < r.end {
                    let end = ((start / side + 1) * side).min(r.end);
                    out.push(Run { start, end, ..*r });
                    start = end;
                }
            }
            offsets.push(out.len() as u32);
        }
    }
    (out, offsets)
}
