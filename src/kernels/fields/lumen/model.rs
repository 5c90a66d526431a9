//! The colon's interior, and what can be asked of it.

use std::ops::Range;
use std::sync::{Arc, OnceLock};

use glam::DVec3;

use super::ends;
use super::kinds::{Considered, GasKind, Landmarks};
use super::names::Names;
use super::others::Other;
use super::position::Lying;
use super::runs::Rows;
use super::segment::Segment;
use crate::fields::Along;
use crate::fields::cleanse::Cleansed;
use crate::volume::{Grid, Volume};

/// Value of a restored septum, HU: soft tissue.
const SEPTUM_HU: i16 = 40;
/// Minimum length of a segment to fly through, mm, unless it belongs to a colon that is known from rectum to cecum …
const FLYABLE_MM: f64 = 250.0;
/// … and minimum volume of its gas, ml.
const FLYABLE_ML: f64 = 20.0;

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
    /// How the patient lies, if levels of fluid or the table show it.
    pub lying: Option<Lying>,
    pub(super) grid: Grid,
    pub(super) gas: Rows,
    pub(super) fluid: Rows,
    /// Gas that looked like a colon's but was classified as other gas, labelled with the number of its kind.
    pub(super) other: Rows,
    /// Voxels of septa, linear indices, ascending.
    pub(super) septa: Vec<usize>,
    /// The measure along it, once something has asked for it.
    pub(in crate::fields) along: OnceLock<Arc<Along>>,
    /// The scan in which that is measured, if it was cleansed since.
    pub(in crate::fields) scanned: Option<AsScanned>,
}

/// A kind that the reader gave to the gas at a place (world, mm).
pub type Told = (DVec3, GasKind);

/// A scan before cleansing: distances are measured along the scan as it is in its file, whatever is shown.
#[derive(Clone, Debug)]
pub(in crate::fields) struct AsScanned {
    /// What was cleansed. Its changes hold the values that the scan had.
    pub cleansed: Arc<Cleansed>,
    /// The kinds that the reader gave to gas.
    pub told: Vec<Told>,
    /// The lumen in it, if that is known.
    pub lumen: Option<Arc<Lumen>>,
}

impl Lumen {
    /// Creates an empty lumen, for a flight that is only replayed.
    pub fn none(grid: &Grid) -> Self {
        let rows = Rows::default();
        Self::of_rows(grid, rows.clone(), rows)
    }

    /// Creates a lumen of gas and fluid without segments.
    pub(super) fn of_rows(grid: &Grid, gas: Rows, fluid: Rows) -> Self {
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

    /// Measures along the scan as it was before `cleansed` was removed, once something asks for that. `told` are the kinds that the
    /// reader gave to gas, and `before` is the lumen of the scan as scanned, if that is known.
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
