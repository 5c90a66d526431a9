//! The gas grown from its core, and where it meets gas that is far away in the core.

use std::collections::VecDeque;

use colvis_scan::memory;
use rayon::prelude::*;

use super::Hiding;
use super::places::{Hop, Places};
use crate::error::Result;
use crate::fields::lumen::fluid::Fluid;
use crate::fields::lumen::graph::Graph;
use crate::fields::lumen::grow::grow;
use crate::fields::lumen::runs::{Rows, Run, near, touching};
use crate::fields::lumen::{GAS_HU, GROWTH};
use crate::progress::Progress;
use crate::volume::{Grid, Volume};

/// Tissue darker than this is dim, HU: a gap of the wall may be beside it.
const DIM_HU: i16 = -200;
/// Two pieces of gas that touch in an area of at least this are parted by a septum, mm²: as wide an opening would show gas in its
/// middle.
const SEPTUM_MM2: f64 = 20.0;
/// Where no septum is hidden, parts that are far apart and touch in less than this meet at a pinhole that no camera passes, mm²: the
/// cross section of a body of 1.5 mm.
const PINHOLE_MM2: f64 = 7.0;

/// The gas grown from its core, by the parts of the core.
///
/// A part is a node of the core's map, or all nodes of a label from which no growth can meet gas that is far away: most of the gas is
/// such, and a run is not cut in it.
#[derive(Debug)]
pub(in crate::fields::lumen) struct Grown {
    /// The gas, labelled with the parts.
    pub(super) parts: Rows,
    /// Where each part is; `None` for what meets nothing.
    pub(super) hops: Vec<Option<Hop>>,
    /// The label of each part.
    labels: Vec<u32>,
    pub(super) places: Places,
    pub(super) far: u32,
    hiding: Hiding,
}

impl Grown {
    /// Grows the core, whose runs made `graph`, to the wall's middle. How far apart parts are that should not meet depends on what
    /// hides septa, if anything.
    pub(crate) fn of(volume: &Volume, core: Rows, graph: &Graph, hiding: Hiding, progress: &Progress) -> Result<Self> {
        let grid = volume.grid();
        let far = graph.far_hops(grid, hiding.far_mm());
        let places = Places::of(grid, graph, hops(graph));
        // Two parts grow by as much each, and meet across a corner at most.
        let alone = places.alone(2 * GROWTH + 1, far);
        // Where two labels meet, the smaller one wins, so parts are numbered by their labels.
        let mut nodes: Vec<u32> = (0..graph.nodes.len() as u32).collect();
        nodes.sort_by_key(|&n| (graph.nodes[n as usize].label, !alone[n as usize]));
        let mut number = vec![0; nodes.len()];
        let (mut hops, mut labels): (Vec<Option<Hop>>, Vec<u32>) = Default::default();
        for &node in &nodes {
            let label = graph.nodes[node as usize].label;
            let hop = (!alone[node as usize]).then(|| places.hop(node));
            if hop.is_some() || (hops.last(), labels.last()) != (Some(&None), Some(&label)) {
                hops.push(hop);
                labels.push(label);
            }
            number[node as usize] = hops.len() as u32 - 1;
        }
        drop((nodes, alone));
        memory::release();
        let parts = graph.labelled(&places.cells, &core, |node| number[node as usize], progress)?;
        // What is grown next is most of what this search has in memory.
        drop((core, number));
        memory::release();
        let parts = grow(volume, parts, GAS_HU, GROWTH, progress)?;
        Ok(Self { parts, hops, labels, places, far, hiding })
    }

    /// Returns the gas, labelled as the core is.
    pub(crate) fn gas(&self) -> Rows {
        self.parts.joined(|_, part| Some(self.labels[part.label as usize]))
    }

    /// Returns the voxels of septa, linear indices, ascending.
    pub(crate) fn septa(&self, volume: &Volume, fluid: Option<&Fluid>, progress: &Progress) -> Result<Vec<usize>> {
        let [_, ny, nz] = self.parts.dims();
        let grid = volume.grid();
        let data = volume.data();
        let fluid = fluid.map(|f| (f, self.levels(f)));
        let slices = (0..nz).into_par_iter().map(|k| {
            progress.check()?;
            let (mut sure, mut pieces) = (Vec::new(), Vec::new());
            for j in 0..ny {
                let own = self.parts.row(j, k);
                if let Some((fluid, levels)) = &fluid {
                    self.beside_fluid(grid, fluid, levels, [j, k], &mut sure);
                }
                if own.iter().all(|r| self.hops[r.label as usize].is_none()) {
                    continue;
                }
                let row = grid.index(0, j, k);
                let mut meet = |a: usize, b: usize, x: Run, y: Run| {
                    // Of equal values, the later voxel.
                    let brighter = if data[a] > data[b] { a } else { b };
                    match self.between(x, y) {
                        Between::Near => {}
                        Between::Far => sure.push(brighter),
                        Between::Pieces => pieces.push(brighter),
                    }
                };
                for w in own.windows(2).filter(|w| w[0].end == w[1].start) {
                    meet(row + w[0].end as usize - 1, row + w[1].start as usize, w[0], w[1]);
                }
                let beside = [(j > 0).then(|| (j - 1, k)), (k > 0).then(|| (j, k - 1))];
                for (j, k) in beside.into_iter().flatten() {
                    let (other, before) = (self.parts.row(j, k), grid.index(0, j, k));
                    touching(other, own, |a, b| {
                        let (x, y) = (other[a], own[b]);
                        if self.between(x, y) != Between::Near {
                            let both = x.start.max(y.start)..x.end.min(y.end);
                            both.for_each(|i| meet(before + i as usize, row + i as usize, x, y));
                        }
                    });
                }
                self.across_corners(volume, [j, k], &mut sure);
            }
            Ok((sure, pieces))
        });
        let (sure, pieces): (Vec<_>, Vec<_>) = slices.collect::<Result<Vec<_>>>()?.into_iter().unzip();
        let (mut septa, mut pieces) = (sure.concat(), pieces.concat());
        for found in [&mut septa, &mut pieces] {
            found.sort_unstable();
            found.dedup();
        }
        if !self.hiding.is_likely {
            septa = wide(grid, &septa, PINHOLE_MM2);
        }
        septa.extend(wide(grid, &pieces, SEPTUM_MM2));
        septa.sort_unstable();
        septa.dedup();
        Ok(septa)
    }

    /// Adds the dim voxels around the edges and corners where a voxel of row (j, k) meets one that is far away, of this row or of those
    /// before. Values between voxels are interpolated, and the wall would have a gap there.
    fn across_corners(&self, volume: &Volume, [j, k]: [usize; 2], out: &mut Vec<usize>) {
        let [nx, ny, _] = self.parts.dims();
        let grid = volume.grid();
        let own = self.parts.row(j, k);
        let rows = [(-1i64, 0i64), (0, -1), (-1, -1), (1, -1)];
        for (dj, dk) in rows {
            let (oj, ok) = (j as i64 + dj, k as i64 + dk);
            if oj < 0 || ok < 0 || oj >= ny as i64 {
                continue;
            }
            let (oj, ok) = (oj as usize, ok as usize);
            let other = self.parts.row(oj, ok);
            near(other, own, 1, |a, b| {
                let (x, y) = (other[a], own[b]);
                if self.between(x, y) != Between::Far {
                    return;
                }
                let around = y.start.saturating_sub(1).max(x.start)..(y.end + 1).min(x.end);
                for p in around {
                    for q in p.saturating_sub(1).max(y.start)..(p + 2).min(y.end) {
                        let xs = p.min(q) as usize..(p.max(q) as usize + 1).min(nx);
                        for (i, j, k) in
                            xs.flat_map(|i| [j, oj].into_iter().flat_map(move |j| [k, ok].map(move |k| (i, j, k))))
                        {
                            let v = grid.index(i, j, k);
                            if (GAS_HU + 1..DIM_HU).contains(&volume.data()[v]) {
                                out.push(v);
                            }
                        }
                    }
                }
            });
        }
    }

    fn between(&self, a: Run, b: Run) -> Between {
        if a.label == b.label {
            return Between::Near;
        }
        match [a, b].map(|r| self.hops[r.label as usize]) {
            [Some(a), Some(b)] if a.piece != b.piece => Between::Pieces,
            [Some(a), Some(b)] if a.is_far(b, self.far) => Between::Far,
            _ => Between::Near,
        }
    }
}

/// How two parts of the gas lie to each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Between {
    Near,
    /// The way between them through the core is long.
    Far,
    /// The core does not join them.
    Pieces,
}

/// Returns the voxels (linear indices, ascending) that belong to a patch of at least `mm2`. Voxels are of one patch if their
/// indices differ by at most two.
pub(super) fn wide(grid: &Grid, voxels: &[usize], mm2: f64) -> Vec<usize> {
    let [nx, ny, _] = grid.dims();
    let spacing = grid.spacing();
    // A voxel's face as it is seen from the direction in which the patch is largest is not known: the mean of the three.
    let face = (spacing.x * spacing.y + spacing.y * spacing.z + spacing.z * spacing.x) / 3.0;
    let least = (mm2 / face).ceil() as usize;
    let mut seen = vec![false; voxels.len()];
    let mut out = Vec::new();
    for n in 0..voxels.len() {
        if std::mem::replace(&mut seen[n], true) {
            continue;
        }
        let mut patch = vec![n];
        let mut at = 0;
        while at < patch.len() {
            let v = voxels[patch[at]] as i64;
            at += 1;
            for dk in -2..=2i64 {
                for dj in -2..=2i64 {
                    let middle = v + (nx as i64) * (dj + ny as i64 * dk);
                    let first = voxels.partition_point(|&o| (o as i64) < middle - 2);
                    let near = (first..voxels.len()).take_while(|&m| voxels[m] as i64 <= middle + 2);
                    near.for_each(|m| {
                        if !std::mem::replace(&mut seen[m], true) {
                            patch.push(m);
                        }
                    });
                }
            }
        }
        if patch.len() >= least {
            out.extend(patch.iter().map(|&m| voxels[m]));
        }
    }
    out
}

/// Returns where each node is in its piece of gas.
fn hops(graph: &Graph) -> Vec<Hop> {
    const NONE: Hop = Hop { piece: u32::MAX, contacts: 0 };
    let mut hops = vec![NONE; graph.nodes.len()];
    let mut nodes = Vec::new();
    let spread = |start: u32, piece: u32, hops: &mut [Hop], nodes: &mut Vec<u32>| {
        nodes.clear();
        hops[start as usize] = Hop { piece, contacts: 0 };
        let mut open = VecDeque::from([start]);
        while let Some(n) = open.pop_front() {
            nodes.push(n);
            let contacts = hops[n as usize].contacts + 1;
            for &m in graph.neighbours(n) {
                if hops[m as usize].piece == u32::MAX {
                    hops[m as usize] = Hop { piece, contacts };
                    open.push_back(m);
                }
            }
        }
    };
    let mut piece = 0;
    for n in 0..graph.nodes.len() as u32 {
        if hops[n as usize].piece == u32::MAX {
            // From the node that is farthest from any.
            spread(n, piece, &mut hops, &mut nodes);
            let end = nodes.last().copied().unwrap_or(n);
            nodes.iter().for_each(|&m| hops[m as usize] = NONE);
            spread(end, piece, &mut hops, &mut nodes);
            piece += 1;
        }
    }
    hops
}
