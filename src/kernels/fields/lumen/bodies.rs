//! Bodies of gas: their cores, parted where these leak into each other, and their fluid, ends and order.

use glam::DVec3;
use rayon::prelude::*;

use super::frame::{AxisDirection, Frame};
use super::graph::Graph;
use super::kinds::Landmarks;
use super::model::Lumen;
use super::order::{self, Body, Link};
use super::runs::Rows;
use super::segment::Segment;
use super::{choose, ends, fluid, position, septa};
use crate::error::Result;
use crate::progress::Progress;
use crate::volume::{Grid, Volume};
use colvis_scan::memory;

/// The cores of bodies of gas.
#[derive(Debug)]
pub(super) struct Core {
    /// Labelled from 0, the largest first.
    pub rows: Rows,
    pub count: usize,
    /// Voxels of septa that were taken out of them, linear indices, ascending.
    pub septa: Vec<usize>,
    pub hiding: septa::Hiding,
}

/// Takes the septa out through which the cores labelled 0 to `count` − 1 leak. What is parted from a core and smaller than a bubble is dropped.
pub(super) fn parted(volume: &Volume, core: Rows, count: usize, progress: &Progress) -> Result<Core> {
    let hiding = septa::Hiding::of(volume, &core);
    let septa = septa::leaks(volume, &core, hiding, progress)?;
    if septa.is_empty() {
        return Ok(Core { rows: core, count, septa, hiding });
    }
    let mut rows = septa::without(&core, &septa);
    drop(core);
    let pieces = rows.label_components(progress)?;
    let mut voxels = vec![0u64; pieces];
    rows.runs().iter().for_each(|r| voxels[r.label as usize] += u64::from(r.len()));
    let least = (choose::BUBBLE_ML / volume.grid().voxel_ml()) as u64;
    let mut kept: Vec<u32> = (0..pieces as u32).filter(|&p| voxels[p as usize] >= least).collect();
    kept.sort_by_key(|&p| (std::cmp::Reverse(voxels[p as usize]), p));
    let mut place = vec![None; pieces];
    kept.iter().enumerate().for_each(|(n, &p)| place[p as usize] = Some(n as u32));
    Ok(Core { rows: rows.select(|p| place[p as usize]), count: kept.len(), septa, hiding })
}

/// Bodies of gas with their fluid, ends and sizes.
#[derive(Debug)]
pub(super) struct Bodies {
    pub segments: Vec<Segment>,
    /// Clearances along the way through each, mm.
    pub clearances: Vec<Vec<f64>>,
    pub gas: Rows,
    pub fluid: Rows,
    /// Voxels of septa (see [`Lumen::septa`]).
    pub septa: Vec<usize>,
    /// The direction of gravity, if levels of fluid show it.
    pub down: Option<AxisDirection>,
}

impl Bodies {
    /// Measures the bodies of the cores, which made `graph`.
    pub(super) fn of(volume: &Volume, core: Core, graph: &Graph, frame: Frame, progress: &Progress) -> Result<Self> {
        let Core { rows: core, count, septa: leaks, hiding } = core;
        let grid = volume.grid();
        let grown = septa::Grown::of(volume, core, graph, hiding, progress)?;
        let gas = grown.gas();
        memory::release();
        let (found, fluid) = rayon::join(
            || Self::ends(grid, &gas, graph, 0..count as u32, progress),
            || fluid::find(volume, &gas, count, frame, progress),
        );
        let (found, fluid) = (found?, fluid?);
        let mut septa = grown.septa(volume, Some(&fluid), progress)?;
        septa.extend(leaks);
        septa.sort_unstable();
        septa.dedup();
        drop(grown);
        let gas = septa::without(&gas, &septa);
        let (segments, clearances) = (measured(grid, &gas, count), vec![Vec::new(); count]);
        let mut bodies = Self { segments, clearances, gas, fluid: fluid.rows, septa, down: fluid.down };
        for r in bodies.fluid.runs() {
            bodies.segments[r.label as usize].fluid_ml += f64::from(r.len()) * grid.voxel_ml();
        }
        for (s, joined) in bodies.segments.iter_mut().zip(fluid.joined) {
            s.joined_to = joined;
        }
        bodies.put_ends(found);
        Ok(bodies)
    }

    /// Finds the ends of some labels.
    pub(super) fn ends(
        grid: &Grid,
        gas: &Rows,
        graph: &Graph,
        labels: impl IntoParallelIterator<Item = u32>,
        progress: &Progress,
    ) -> Result<Vec<(u32, Option<ends::Ends>)>> {
        let mut found = labels
            .into_par_iter()
            .map(|label| {
                progress.check()?;
                Ok((label, ends::ends(grid, gas, graph, label)))
            })
            .collect::<Result<Vec<_>>>()?;
        found.sort_by_key(|f| f.0);
        Ok(found)
    }

    pub(super) fn put_ends(&mut self, found: Vec<(u32, Option<ends::Ends>)>) {
        for (label, e) in found {
            // Every component has voxels, hence nodes, hence ends.
            if let Some(e) = e {
                let s = &mut self.segments[label as usize];
                (s.ends, s.length_mm, s.way) = (e.at, e.length_mm, e.way);
                self.clearances[label as usize] = e.clearances;
            }
        }
    }

    /// Returns z of the lowest gas, mm.
    pub(super) fn lowest(&self) -> f64 {
        self.segments.iter().map(|s| s.bounds_mm[0].z).fold(f64::INFINITY, f64::min)
    }

    /// Returns the input of the ordering for each body of a patient of the given size. Its worth, mm, is that of its number and of the
    /// length by which its fluid is longer than its gas, mm.
    pub(super) fn links(&self, grid: &Grid, scale: f64, worth_mm: impl Fn(usize, f64) -> f64) -> Vec<Link> {
        let mut fluid = farthest(grid, &self.fluid, self.segments.len());
        let link = |(n, s): (usize, &Segment)| {
            let fluid = std::mem::take(&mut fluid[n]);
            let worth_mm = worth_mm(n, order::beyond(s.ends, &fluid, scale));
            Link { fluid, ends: s.ends, length_mm: s.length_mm, joined_to: s.joined_to.clone(), worth_mm }
        };
        self.segments.iter().enumerate().map(link).collect()
    }

    /// Orders the bodies from rectum to cecum.
    pub(super) fn into_lumen(self, volume: &Volume, frame: Frame, landmarks: Option<Landmarks>) -> Lumen {
        let scale = landmarks.as_ref().map_or(1.0, Landmarks::scale);
        let body = Body::of(volume, self.lowest(), scale);
        let order = order::order(&self.links(volume.grid(), scale, |_, _| f64::INFINITY), &body);
        let mut place = vec![0u32; self.segments.len()];
        for (n, &(s, _)) in order.chain.iter().enumerate() {
            place[s] = n as u32;
        }
        let segments = order
            .chain
            .iter()
            .map(|&(s, swapped)| {
                let mut segment = self.segments[s].clone();
                if swapped {
                    segment.ends.swap(0, 1);
                    segment.way.reverse();
                }
                segment.joined_to = segment.joined_to.iter().map(|&o| place[o] as usize).collect();
                segment.joined_to.sort_unstable();
                segment
            })
            .collect();
        let [gas, fluid] = [self.gas, self.fluid].map(|rows| rows.relabelled(|label| place[label as usize]));
        let lying = position::lying(frame, self.down, landmarks.as_ref(), volume.header_position());
        let ordered = order.trusted && landmarks.as_ref().is_none_or(|l| !l.is_chest());
        let septa = self.septa;
        Lumen { segments, ordered, landmarks, lying, septa, ..Lumen::of_rows(volume.grid(), gas, fluid) }
    }
}

/// Returns the voxels of each label that are farthest along each axis, world, mm.
fn farthest(grid: &Grid, rows: &Rows, count: usize) -> Vec<Vec<DVec3>> {
    const WAYS: [DVec3; 6] = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z];
    let mut best: Vec<[(f64, DVec3); 6]> = vec![[(f64::NEG_INFINITY, DVec3::ZERO); 6]; count];
    for (j, k, r) in rows.iter() {
        for i in [r.start, r.end - 1] {
            let p = grid.world(DVec3::new(f64::from(i), j as f64, k as f64));
            for (best, way) in best[r.label as usize].iter_mut().zip(WAYS) {
                if p.dot(way) > best.0 {
                    *best = (p.dot(way), p);
                }
            }
        }
    }
    let found = |b: [(f64, DVec3); 6]| b.into_iter().filter(|b| b.0 > f64::NEG_INFINITY).map(|b| b.1).collect();
    best.into_iter().map(found).collect()
}

/// Returns volume and bounds of each label.
pub(super) fn measured(grid: &Grid, gas: &Rows, count: usize) -> Vec<Segment> {
    let none = Segment {
        ml: 0.0,
        fluid_ml: 0.0,
        bounds_mm: [DVec3::INFINITY, DVec3::NEG_INFINITY],
        ends: [DVec3::ZERO; 2],
        joined_to: Vec::new(),
        length_mm: 0.0,
        way: Vec::new(),
        judged: None,
    };
    let mut segments = vec![none; count];
    let mut voxels = vec![0u64; count];
    for (j, k, r) in gas.iter() {
        let s = &mut segments[r.label as usize];
        voxels[r.label as usize] += u64::from(r.len());
        for i in [r.start, r.end - 1] {
            let p = grid.world(DVec3::new(f64::from(i), j as f64, k as f64));
            s.bounds_mm = [s.bounds_mm[0].min(p), s.bounds_mm[1].max(p)];
        }
    }
    for (s, n) in segments.iter_mut().zip(voxels) {
        s.ml = n as f64 * grid.voxel_ml();
    }
    segments
}
