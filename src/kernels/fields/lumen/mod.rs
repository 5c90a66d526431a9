//! The colon's interior: from HU to gas and tagged fluid, in segments from rectum to cecum.
//!
//! Gas is at or below the wall's middle ([`GAS_HU`]). Connected gas is found at [`CORE_HU`], where a thin wall between
//! two loops still separates them, and then grown to the wall's middle. Outside air, gas around the patient and lungs
//! are recognised by position and texture (see `choose`). Everything is stored as runs along the index x axis, so no
//! field of the volume's size is created.

mod cells;
mod choose;
mod ends;
mod fluid;
pub(in crate::fields) mod frame;
mod graph;
mod grow;
mod interior;
mod judgement;
mod kinds;
mod map;
mod names;
mod order;
mod others;
mod position;
pub(in crate::fields) mod residue;
pub(in crate::fields) mod runs;
mod septa;
mod stretches;
#[cfg(test)]
mod tests;

use std::ops::Range;
use std::sync::{Arc, OnceLock};

use glam::DVec3;
use rayon::prelude::*;

use super::cleanse::Cleansed;
use super::{Along, AsScanned};
use crate::error::Result;
use crate::progress::Progress;
use crate::volume::{Grid, Volume};
use frame::{AxisDirection, Frame};
use graph::Graph;
use order::{Body, Link};
use runs::Rows;

pub use interior::Interior;
pub use kinds::{Chain, Considered, Features, GasKind, Judged, Landmarks, RULES, Rule, judge};
pub use map::{GasBody, KindMap};
pub use names::{NAMES, Names, Part};
pub use others::{Other, Others, not_colon};
pub use position::Lying;
pub use residue::{Remnant, Residue, residue};
pub use stretches::CoarseAlong;

/// A voxel at or below this is gas, HU: the middle of the wall's opacity ramp.
pub const GAS_HU: i16 = -650;
/// Gas connects at or below this, HU: the foot of the opacity ramp. A one-voxel wall between two loops is blurred to a
/// value in between and must not let the camera through.
pub const CORE_HU: i16 = -800;
/// Tissue is brighter than this, HU: between fat (−120) and lung.
const TISSUE_HU: i16 = -300;
/// Value of a septum that was found again, HU: soft tissue.
const SEPTUM_HU: i16 = 40;
/// Maximum growth of the gas from its core to the wall's middle, voxels.
const GROWTH: usize = 3;
/// Maximum distance of the lumen from a given point, mm.
const SNAP_MM: f64 = 5.0;
/// Minimum length of a segment to fly through, mm, unless it belongs to a colon that is known from rectum to cecum …
const FLYABLE_MM: f64 = 250.0;
/// … and minimum volume of its gas, ml.
const FLYABLE_ML: f64 = 20.0;

/// A connected piece of the colon's gas, with the fluid in it.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// Volume of gas, ml.
    pub ml: f64,
    /// Volume of tagged fluid, ml. A pool shared by several segments counts towards the one with the longest interface.
    pub fluid_ml: f64,
    /// Minimum and maximum world coordinates of the gas voxels' centres, mm.
    pub bounds_mm: [DVec3; 2],
    /// The rectal end, then the cecal one: centres of good inscribed balls in the gas near the lumen's two ends, world, mm.
    pub ends: [DVec3; 2],
    /// Other segments joined to this one by tagged fluid.
    pub joined_to: Vec<usize>,
    /// Length from end to end along the lumen, mm; accurate to about a tenth.
    pub length_mm: f64,
    /// The coarse way from end to end, world, mm.
    pub way: Vec<DVec3>,
    /// Why it is, or may be, colon; `None` if the gas was not classified.
    pub judged: Option<Judged>,
}

/// The colon's interior.
#[derive(Clone, Debug)]
pub struct Lumen {
    /// Segments from rectum to cecum if [`Lumen::ordered`], else by volume, the largest first.
    pub segments: Vec<Segment>,
    /// True if the segments form a reliable chain from rectum to cecum.
    pub ordered: bool,
    /// Kinds of the larger pieces of other gas, the largest first.
    pub others: Vec<Other>,
    /// The bodies that the rules weighed.
    pub considered: Vec<Considered>,
    /// Landmarks of the patient, if the gas was classified.
    pub landmarks: Option<Landmarks>,
    /// How the patient lies, if levels of fluid or the table tell it.
    pub lying: Option<Lying>,
    grid: Grid,
    gas: Rows,
    fluid: Rows,
    /// Gas that looked like a colon's but was classified as other gas, labelled with the number of its kind.
    other: Rows,
    /// Voxels of septa, linear indices, ascending.
    septa: Vec<usize>,
    /// The measure along it, once something has asked for it.
    along: OnceLock<Arc<Along>>,
    /// The scan in which that is measured, if its tag has been taken out since.
    scanned: Option<AsScanned>,
}

/// A kind that the reader gave to the gas at a place (world, mm).
pub type Told = (DVec3, GasKind);

/// Finds the colon's gas, its segments, their ends and order. No seed point is needed. A scan without a colon has no
/// segments, which is not an error.
///
/// ```
/// # mod colvis {
/// # pub use colvis_kernels::*;
/// # pub use colvis_phantom as phantom;
/// # }
/// use colvis::fields::lumen;
/// use colvis::phantom::Phantom;
/// use colvis::progress::Progress;
///
/// let progress = Progress::new();
/// let volume = Phantom::embedded(&progress)?; // a small synthetic colon
/// let lumen = lumen::find(&volume, &progress)?;
/// assert!(lumen.is_flyable() && lumen.segments.len() == 1 && lumen.gas_ml() > 100.0);
/// # Ok::<(), colvis::error::Error>(())
/// ```
///
/// # Errors
/// Returns an error if cancelled, or if the volume cannot be addressed.
pub fn find(volume: &Volume, progress: &Progress) -> Result<Lumen> {
    find_told(volume, &[], progress)
}

/// Same as [`find`], where the gas at some places has the kind that the reader gave to it.
///
/// # Errors
/// As [`find`].
pub fn find_told(volume: &Volume, told: &[Told], progress: &Progress) -> Result<Lumen> {
    progress.stage("finding the colon", volume.grid().dims()[2] as u64);
    let frame = Frame::of(volume.grid());
    let (rows, components) = runs::components_below(volume, CORE_HU, progress)?;
    let looked = choose::look(volume, &rows, components, frame);
    let mut chosen = looked.colon();
    for (at, kind) in told {
        if let Some((label, _)) = ends::nearest(volume.grid(), &rows, *at, SNAP_MM, |_| true)
            && *kind == GasKind::Colon
            && !chosen.contains(&label)
        {
            chosen.push(label);
        }
    }
    let mut others = looked.others(volume.grid(), &rows, &chosen);
    let mut place = vec![None; components];
    for (n, &c) in chosen.iter().enumerate() {
        place[c as usize] = Some(n as u32);
    }
    let core = rows.select(|c| place[c as usize]);
    drop(rows);
    let core = parted(volume, core, chosen.len(), progress)?;
    let mut lumen = judgement::lumen(volume, core, told, frame, progress)?;
    lumen.others.append(&mut others);
    lumen.others.sort_by(|a, b| b.ml.total_cmp(&a.ml));
    Ok(lumen)
}

/// Finds the gas that contains `world` (mm) or is within 5 mm of it, whatever its size. Returns a lumen of one segment
/// with its ends, or `None` if there is no gas, or only the air outside the patient.
///
/// # Errors
/// Returns an error if cancelled, or if the volume cannot be addressed.
pub fn gas_at(volume: &Volume, world: DVec3, progress: &Progress) -> Result<Option<Lumen>> {
    progress.stage("finding the gas at the given point", volume.grid().dims()[2] as u64);
    let frame = Frame::of(volume.grid());
    let (rows, _) = runs::components_below(volume, CORE_HU, progress)?;
    let Some((label, _)) = ends::nearest(volume.grid(), &rows, world, SNAP_MM, |_| true) else { return Ok(None) };
    if choose::is_outside(&rows, label, frame) {
        return Ok(None);
    }
    let core = rows.select(|c| (c == label).then_some(0));
    drop(rows);
    let core = parted(volume, core, 1, progress)?;
    let Some((label, _)) = ends::nearest(volume.grid(), &core.rows, world, SNAP_MM, |_| true) else { return Ok(None) };
    let rows = core.rows.select(|c| (c == label).then_some(0));
    lumen(volume, Core { rows, count: 1, ..core }, frame, progress).map(Some)
}

/// The cores of bodies of gas.
#[derive(Debug)]
struct Core {
    /// Labelled from 0, the largest first.
    rows: Rows,
    count: usize,
    /// Voxels of septa that were taken out of them, linear indices, ascending.
    septa: Vec<usize>,
    hiding: septa::Hiding,
}

/// Takes the septa out through which the cores labelled 0 to `count` − 1 leak. What is parted from a core and smaller than a bubble is dropped.
fn parted(volume: &Volume, core: Rows, count: usize, progress: &Progress) -> Result<Core> {
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

/// Builds a lumen from its cores.
fn lumen(volume: &Volume, core: Core, frame: Frame, progress: &Progress) -> Result<Lumen> {
    let graph = Graph::of(volume.grid(), &core.rows, progress)?;
    let bodies = Bodies::of(volume, core, &graph, frame, progress)?;
    Ok(bodies.into_lumen(volume, frame, None))
}

/// Bodies of gas with their fluid, ends and sizes.
#[derive(Debug)]
struct Bodies {
    segments: Vec<Segment>,
    /// Clearances along the way through each, mm.
    clearances: Vec<Vec<f64>>,
    gas: Rows,
    fluid: Rows,
    /// Voxels of septa (see [`Lumen::septa`]).
    septa: Vec<usize>,
    /// The direction of gravity, if levels of fluid tell it.
    down: Option<AxisDirection>,
}

impl Bodies {
    /// Measures the bodies of the cores, which made `graph`.
    fn of(volume: &Volume, core: Core, graph: &Graph, frame: Frame, progress: &Progress) -> Result<Self> {
        let Core { rows: core, count, septa: leaks, hiding } = core;
        let grid = volume.grid();
        let grown = septa::Grown::of(volume, &core, graph, hiding, progress)?;
        drop(core);
        let gas = grown.gas();
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
    fn ends(
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

    fn put_ends(&mut self, found: Vec<(u32, Option<ends::Ends>)>) {
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
    fn lowest(&self) -> f64 {
        self.segments.iter().map(|s| s.bounds_mm[0].z).fold(f64::INFINITY, f64::min)
    }

    /// Returns what the ordering needs of each body, with its worth, mm.
    fn links(&self, grid: &Grid, worth_mm: impl Fn(usize) -> f64) -> Vec<Link> {
        let mut fluid = farthest(grid, &self.fluid, self.segments.len());
        let link = |(n, s): (usize, &Segment)| Link {
            fluid: std::mem::take(&mut fluid[n]),
            ends: s.ends,
            length_mm: s.length_mm,
            joined_to: s.joined_to.clone(),
            worth_mm: worth_mm(n),
        };
        self.segments.iter().enumerate().map(link).collect()
    }

    /// Orders the bodies from rectum to cecum.
    fn into_lumen(self, volume: &Volume, frame: Frame, landmarks: Option<Landmarks>) -> Lumen {
        let body = Body::of(volume, self.lowest(), landmarks.as_ref().map_or(1.0, Landmarks::scale));
        let order = order::order(&self.links(volume.grid(), |_| f64::INFINITY), &body);
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
        let [gas, fluid] = [self.gas, self.fluid].map(|rows| rows.select(|label| Some(place[label as usize])));
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
fn measured(grid: &Grid, gas: &Rows, count: usize) -> Vec<Segment> {
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

impl Lumen {
    /// Creates an empty lumen, for a flight that is only replayed.
    pub fn none(grid: &Grid) -> Self {
        let rows = Rows::default();
        Self::of_rows(grid, rows.clone(), rows)
    }

    /// Creates a lumen of gas and fluid without segments.
    fn of_rows(grid: &Grid, gas: Rows, fluid: Rows) -> Self {
        let (segments, others, other) = (Vec::new(), Vec::new(), Rows::default());
        Self {
            segments,
            ordered: false,
            others,
            considered: Vec::new(),
            landmarks: None,
            lying: None,
            grid: grid.clone(),
            gas,
            fluid,
            other,
            septa: Vec::new(),
            along: OnceLock::new(),
            scanned: None,
        }
    }

    /// Returns the measure along this lumen, found in `volume`. The first call computes it: in the scan as it was, if its tag has been
    /// taken out, so that both tell the same.
    ///
    /// # Errors
    /// As [`Along::new`].
    pub fn along(&self, volume: &Volume, progress: &Progress) -> Result<Arc<Along>> {
        if let Some(known) = self.along.get() {
            return Ok(Arc::clone(known));
        }
        let found = match &self.scanned {
            Some(scanned) => scanned.along(volume, progress)?.in_lumen(self),
            None => Along::new(volume, self, progress)?,
        };
        Ok(Arc::clone(self.along.get_or_init(|| Arc::new(found))))
    }

    /// Returns the measure along this lumen, if it has been computed.
    pub(in crate::fields) fn known_along(&self) -> Option<Arc<Along>> {
        self.along.get().cloned()
    }

    /// Takes the measure along the lumen of the scan as it was, so that both tell the same, if it has been computed.
    #[doc(hidden)]
    pub fn keep_along(&self, before: &Self) {
        if let Some(along) = before.along.get() {
            self.along.get_or_init(|| Arc::new(along.in_lumen(self)));
        }
    }

    /// Measures along the scan as it was before `cleansed` was taken out, once something asks for that. `told` are the kinds that the
    /// reader gave to gas, and `before` is the lumen of the scan as it was, if that is known.
    #[doc(hidden)]
    pub fn measure_as_scanned(&mut self, cleansed: &Arc<Cleansed>, told: &[Told], before: Option<Arc<Self>>) {
        if !cleansed.changes.is_empty() {
            let scanned = AsScanned { cleansed: Arc::clone(cleansed), told: told.to_vec(), lumen: before };
            (self.along, self.scanned) = (OnceLock::new(), Some(scanned));
        }
    }

    /// Returns the voxels (linear indices, ascending) of walls between two limbs of the colon that thick slices or noise have made as
    /// dark as gas. They are not part of the gas.
    pub fn septa(&self) -> &[usize] {
        &self.septa
    }

    /// Returns a note to the user on the septa; `None` if there are none.
    pub fn septa_note(&self) -> Option<String> {
        let (ml, voxels) = (self.septa.len() as f64 * self.grid.voxel_ml(), self.septa.len());
        let spacing = self.grid.spacing().max_element();
        (voxels > 0).then(|| {
            format!(
                "walls between limbs of the colon, as dark as gas in {spacing:.1} mm slices, were closed: {voxels} voxels, {ml:.1} ml"
            )
        })
    }

    /// Makes the septa of this lumen tissue in the scan that it was found in, so that nothing passes through them.
    pub fn close_septa(&self, volume: &mut Volume) {
        let data = volume.data_mut();
        self.septa.iter().for_each(|&v| data[v] = data[v].max(SEPTUM_HU));
    }

    /// Returns a lumen of the gas of some segments alone, without fluid.
    #[doc(hidden)]
    pub fn gas_of(&self, segments: &[usize]) -> Self {
        let gas = self.gas.select(|l| segments.contains(&(l as usize)).then_some(l));
        Self { segments: self.segments.clone(), ..Self::of_rows(&self.grid, gas, Rows::default()) }
    }

    /// Returns the segment whose gas contains a position (world, mm).
    pub fn segment_at(&self, world: DVec3) -> Option<usize> {
        let [i, j, k] = ends::to_index(self.grid.voxel(world));
        self.gas.find(i, j, k).map(|r| r.label as usize)
    }

    /// True if a position (world, mm) is in tagged fluid.
    pub fn is_fluid(&self, world: DVec3) -> bool {
        let [i, j, k] = ends::to_index(self.grid.voxel(world));
        self.fluid.find(i, j, k).is_some()
    }

    /// Returns the segment and centre (world, mm) of the gas voxel nearest to a position, if one is within `within_mm`.
    pub fn nearest_gas(&self, world: DVec3, within_mm: f64) -> Option<(usize, DVec3)> {
        ends::nearest(&self.grid, &self.gas, world, within_mm, |_| true).map(|(s, p)| (s as usize, p))
    }

    /// Returns one byte per voxel, x fastest: 0 outside, 1 gas, 2 tagged fluid.
    pub fn mask(&self) -> Vec<u8> {
        let mut out = vec![0; self.grid.len()];
        for (value, rows) in [(1, &self.gas), (2, &self.fluid)] {
            for (j, k, r) in rows.iter() {
                let row = self.grid.index(0, j, k);
                out[row + r.start as usize..row + r.end as usize].fill(value);
            }
        }
        out
    }

    /// Returns the first voxel and the size of a box around the lumen that reaches `beyond_mm` farther, within the grid; `None` without
    /// a lumen.
    pub fn around(&self, beyond_mm: f64) -> Option<([usize; 3], [usize; 3])> {
        let (mut low, mut high) = ([usize::MAX; 3], [0; 3]);
        for (j, k, r) in self.gas.iter().chain(self.fluid.iter()) {
            let (first, last) = ([r.start as usize, j, k], [r.end as usize - 1, j, k]);
            low = std::array::from_fn(|a| low[a].min(first[a]));
            high = std::array::from_fn(|a| high[a].max(last[a]));
        }
        let dims = self.grid.dims();
        let more = self.grid.spacing().to_array().map(|mm| (beyond_mm / mm).ceil() as usize);
        let first: [usize; 3] = std::array::from_fn(|a| low[a].saturating_sub(more[a]));
        let size = std::array::from_fn(|a| (high[a] + more[a] + 1).min(dims[a]) - first[a].min(dims[a]));
        (low[0] != usize::MAX).then_some((first, size))
    }

    /// Returns the lumen in a box of its scan: `dims` voxels from `first` on. Its segments keep their measures. Ask for [`Lumen::along`]
    /// first: the part cannot measure along the whole.
    ///
    /// # Panics
    /// Panics if the box is empty or reaches beyond the grid.
    #[must_use]
    pub fn into_part(self, first: [usize; 3], dims: [usize; 3]) -> Self {
        let [gas, fluid] = [&self.gas, &self.fluid].map(|rows| rows.part(first, dims));
        // What is cut out of a scan has its septa closed.
        let septa = Vec::new();
        let grid = self.grid.part(first, dims);
        Self { grid, gas, fluid, other: Rows::default(), septa, scanned: None, ..self }
    }

    /// Returns the grid of the scan in which the lumen was found.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Returns the runs of gas, labelled with their segment.
    pub(in crate::fields) fn gas(&self) -> &Rows {
        &self.gas
    }

    /// Returns the runs of tagged fluid, labelled with the segment that they count towards.
    pub(in crate::fields) fn fluid(&self) -> &Rows {
        &self.fluid
    }

    /// Returns the runs of gas that looked like a colon's but was classified as other gas, labelled with the number of its kind.
    pub(in crate::fields) fn other(&self) -> &Rows {
        &self.other
    }

    /// Returns the rectal end of the first and the cecal end of the last of some segments, world, mm. If the order is not known, they
    /// are the ends of the largest segment of all.
    ///
    /// # Panics
    /// Panics if there is no such segment.
    #[doc(hidden)]
    pub fn outermost(&self, which: Range<usize>) -> [DVec3; 2] {
        if self.ordered {
            return [self.segments[which.start].ends[0], self.segments[which.end - 1].ends[1]];
        }
        self.segments[self.largest().unwrap_or(which.start)].ends
    }

    /// Returns the segment with the most gas, if there is any.
    pub fn largest(&self) -> Option<usize> {
        (0..self.segments.len()).reduce(|a, b| if self.segments[b].ml > self.segments[a].ml { b } else { a })
    }

    /// Returns the largest segment if it is a colon to fly through: long, well filled with gas, and not in a scan of the chest.
    pub fn main_segment(&self) -> Option<usize> {
        let is_abdomen = self.landmarks.as_ref().is_none_or(|l| !l.is_chest());
        let is_long = |s: usize| self.ordered || is_abdomen && self.segments[s].length_mm >= FLYABLE_MM;
        self.largest().filter(|&s| is_long(s) && self.segments[s].ml >= FLYABLE_ML)
    }

    /// True if there is a colon to fly through without a start point.
    pub fn is_flyable(&self) -> bool {
        self.main_segment().is_some()
    }

    /// Returns the names of the colon's parts along its segments; empty if their order is not known.
    pub fn names(&self) -> Names {
        let way: Vec<DVec3> = self.segments.iter().flat_map(|s| &s.way).copied().collect();
        match &self.landmarks {
            Some(body) if self.ordered => Names::along(&way, body),
            _ => Names::default(),
        }
    }

    /// Describes the gas inside the patient if no colon is found: what it was classified as, and what may be colon. `None` if
    /// there is none.
    pub fn found(&self) -> Option<String> {
        let kinds = [GasKind::Lung, GasKind::Trachea, GasKind::Stomach, GasKind::SmallBowel, GasKind::Unknown];
        let ml = |kind| self.others.iter().filter(|o| o.kind == kind).map(|o| o.ml).sum::<f64>();
        let taken = kinds.into_iter().map(|k| (k, ml(k))).filter(|k| k.1 >= 1.0);
        let mut taken: Vec<String> = taken.map(|(k, ml)| format!("{} ({ml:.0} ml)", k.name())).collect();
        if let Some(last) = taken.pop() {
            let before = taken.join(", ");
            taken = vec![if before.is_empty() { last } else { format!("{before} and {last}") }];
        }
        let largest = self.largest().map(|s| &self.segments[s]);
        let colon =
            largest.map(|s| format!("the largest that may be colon is {:.0} ml and {:.0} mm long", s.ml, s.length_mm));
        match (taken.first(), colon) {
            (None, colon) => colon,
            (Some(taken), None) => Some(format!("the gas inside the patient was classified as {taken}")),
            (Some(taken), Some(colon)) => {
                Some(format!("the gas inside the patient was classified as {taken}, and {colon}"))
            }
        }
    }

    /// Returns the volume of all gas, ml.
    pub fn gas_ml(&self) -> f64 {
        self.segments.iter().map(|s| s.ml).sum()
    }

    /// Returns the volume of all tagged fluid, ml.
    pub fn fluid_ml(&self) -> f64 {
        self.segments.iter().map(|s| s.fluid_ml).sum()
    }

    /// Returns the size in memory, bytes.
    pub fn bytes(&self) -> usize {
        let rows = self.gas.bytes() + self.fluid.bytes() + self.other.bytes();
        let along = self.along.get().map_or(0, |a| a.bytes());
        rows + along + size_of_val(self.septa.as_slice()) + self.segments.capacity() * size_of::<Segment>()
    }
}
