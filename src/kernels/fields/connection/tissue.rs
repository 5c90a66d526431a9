//! The costs of a path between two pieces of gas, on a coarse grid around them.
//!
//! What a block of voxels costs for each millimetre follows from what is in it: lumen least, soft tissue more, fat much
//! more, and gas of other gut, bone and the air outside most. Lumen and tissue cost less in the middle than at the edge, so
//! that a path keeps to the middle of a pool and of a collapsed colon.

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::Facing;
use crate::error::Result;
use crate::fields::Values;
use crate::fields::lumen::Lumen;
use crate::fields::lumen::runs::Rows;
use crate::progress::Progress;
use crate::volume::Grid;

/// Side of a block, mm, at least; small against a collapsed colon, which is 10 to 20 mm thick.
const BLOCK_MM: f64 = 2.0;
/// Maximum number of blocks. At up to 40 bytes each, a search needs at most 80 MB.
const BLOCKS: f64 = 2e6;
/// Distance from the ends up to which a path may leave the straight line: this share of the line's length, …
const ASIDE: f64 = 0.5;
/// … within these limits, mm.
const ASIDE_MM: [f64; 2] = [40.0, 80.0];
/// Length at the end of a segment, mm, in which a path may leave its gas. A path must not turn back through the gas to where
/// another loop is near.
const TIP_MM: f64 = 15.0;
/// Share of a block's voxels that make it lumen. Where a lumen closes, its tip is narrower than a block.
const LUMEN_SHARE: f64 = 0.2;
/// Share of a block's voxels that make it other gas.
const OTHER_SHARE: f64 = 0.25;
/// Largest pocket of gas in a collapsed lumen, mm³. Larger ones are other gut.
const POCKET_MM3: f64 = 2000.0;
/// Largest pool of tagged fluid between two collapsed stretches, mm³. No gas touches it, so that it is not known as fluid. What is
/// larger and as bright is bone.
const POOL_MM3: f64 = 60_000.0;
/// Values of soft tissue, HU: between the two in the middle. It costs as much as fat below the first, and as much as bone
/// above the last.
const SOFT_HU: [f64; 4] = [-90.0, -30.0, 180.0, 300.0];
/// Mean value of a block that is gas, or the edge of gas, HU.
const AIRY_HU: f64 = -200.0;

/// Cost of lumen for each mm, in the middle; 1 + (8 mm / clearance)², as for a centerline, at most …
const LUMEN_MM: f64 = 8.0;
/// … and where soft tissue begins.
const TISSUE: f64 = 5.0;
/// Cost of soft tissue: 5 · (1 + (4 mm / distance from its edge)²), at most …
const CORD_MM: f64 = 4.0;
const EDGE: f64 = 20.0;
const FAT: f64 = 40.0;
const CLOSED: f64 = 200.0;
/// Costs are stored in this fraction of one.
const UNIT: f64 = 16.0;

/// What a block holds.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Block {
    /// Gas of the two segments near their ends, or tagged fluid.
    Lumen,
    /// Other gas of the colon, and gas that is not colon.
    Closed,
    /// Anything else, with the mean value, HU, of what is not lumen.
    Tissue(f32),
}

/// The costs around two facing ends.
#[derive(Clone, Debug)]
pub(super) struct Costs {
    /// Number of blocks along each axis.
    pub dims: [usize; 3],
    /// Cost of each block, per mm, in sixteenths; x fastest.
    pub cost: Vec<u16>,
    /// Vectors from a block to the next along each axis, world, mm.
    pub steps: [DVec3; 3],
    /// Centre of the first block, world, mm.
    first: DVec3,
    /// From world vectors to blocks: the inverse of `steps`.
    to_block: DMat3,
    /// The 26 neighbours of a block: steps along the axes, steps in the list of blocks, and distance, mm.
    beside: Vec<([i64; 3], i64, f64)>,
}

/// The part of the scan that is searched: its first voxel, its size, and the size of blocks, in voxels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Part {
    low: [usize; 3],
    size: [usize; 3],
    block: [usize; 3],
}

impl Part {
    /// Returns the box around both ends; `None` if one is outside the scan or no position.
    fn around(grid: &Grid, ends: [DVec3; 2]) -> Option<Self> {
        if !ends.iter().all(|&e| grid.contains(e)) {
            return None;
        }
        let aside = (ASIDE * ends[0].distance(ends[1])).clamp(ASIDE_MM[0], ASIDE_MM[1]);
        let (spacing, last) = (grid.spacing(), DVec3::from_array(grid.dims().map(|n| (n - 1) as f64)));
        let [a, b] = ends.map(|e| grid.voxel(e));
        let low = (a.min(b) - aside / spacing).floor().clamp(DVec3::ZERO, last);
        let high = (a.max(b) + aside / spacing).ceil().clamp(DVec3::ZERO, last);
        let side = ((high - low + 1.0) * spacing).element_product() / BLOCKS;
        let block = (BLOCK_MM.max(side.cbrt()) / spacing).round().max(DVec3::ONE);
        let whole = |v: DVec3| v.to_array().map(|x| x as usize);
        Some(Self { low: whole(low), size: whole(high - low + 1.0), block: whole(block) })
    }

    fn dims(self) -> [usize; 3] {
        std::array::from_fn(|a| self.size[a].div_ceil(self.block[a]))
    }

    /// Returns the part of a row's range of voxels that is within the box.
    fn clip(self, start: u32, end: u32) -> std::ops::Range<usize> {
        let (low, high) = (self.low[0], self.low[0] + self.size[0]);
        (start as usize).clamp(low, high)..(end as usize).clamp(low, high)
    }
}

/// What is counted of a block's voxels.
#[derive(Clone, Copy, Debug, Default)]
struct Count {
    voxels: u32,
    gas: [u32; 2],
    fluid: u32,
    other: u32,
    /// Number and sum of the values, HU, of all other voxels.
    rest: u32,
    hu: i64,
}

impl Costs {
    /// Measures what is around the ends of two segments. `None` if an end is outside the scan.
    ///
    /// If tagged fluid joins the two, no tissue is between them, and all of it is closed: a way must not cut through a fold in the
    /// pool.
    pub(super) fn between(
        values: &Values<'_>,
        lumen: &Lumen,
        ends: [Facing<'_>; 2],
        progress: &Progress,
    ) -> Result<Option<Self>> {
        let grid = values.grid();
        let Some(part) = Part::around(grid, ends.map(|e| e.at)) else { return Ok(None) };
        let dims = part.dims();
        let middle = |a: usize| part.low[a] as f64 + 0.5 * (part.block[a] as f64 - 1.0);
        let first = grid.world(DVec3::new(middle(0), middle(1), middle(2)));
        let steps = [0, 1, 2].map(|a| grid.to_world().matrix3.col(a) * part.block[a] as f64);
        let to_block = DMat3::from_cols(steps[0], steps[1], steps[2]).inverse();
        let mut costs = Self { dims, cost: Vec::new(), steps, first, to_block, beside: beside(dims, steps) };
        let layer = |layer: usize| {
            progress.check()?;
            let counts = counted(values, lumen, ends, part, layer);
            let from = layer * counts.len();
            Ok(counts.iter().enumerate().map(|(n, c)| costs.block(from + n, c, ends)).collect())
        };
        let layers: Vec<Vec<Block>> = (0..dims[2]).into_par_iter().map(layer).collect::<Result<_>>()?;
        let blocks = layers.concat();
        progress.check()?;
        costs.cost = costs.weighed(&blocks);
        if super::is_joined(lumen, ends.map(|e| e.segment)) {
            let tissue = blocks.iter().map(|&b| b != Block::Lumen);
            let closed = (CLOSED * UNIT) as u16;
            costs.cost.iter_mut().zip(tissue).filter(|(_, is_tissue)| *is_tissue).for_each(|(c, _)| *c = closed);
        }
        Ok(Some(costs))
    }

    /// Returns the place of a block, world, mm.
    pub(super) fn place(&self, n: usize) -> DVec3 {
        let [i, j, k] = self.at(n);
        self.first + self.steps[0] * i as f64 + self.steps[1] * j as f64 + self.steps[2] * k as f64
    }

    /// Returns the block of a position (world, mm), the nearest one if it is beside them.
    pub(super) fn nearest(&self, place: DVec3) -> usize {
        let at = (self.to_block * (place - self.first)).round().to_array();
        let [i, j, k] = std::array::from_fn(|a| at[a].clamp(0.0, (self.dims[a] - 1) as f64) as usize);
        i + self.dims[0] * (j + self.dims[1] * k)
    }

    /// Returns a block's place in the grid.
    pub(super) fn at(&self, n: usize) -> [usize; 3] {
        [n % self.dims[0], n / self.dims[0] % self.dims[1], n / self.dims[0] / self.dims[1]]
    }

    /// Decides what a block holds.
    fn block(&self, n: usize, c: &Count, ends: [Facing<'_>; 2]) -> Block {
        let share = |count: u32| f64::from(count) / f64::from(c.voxels.max(1));
        let place = self.place(n);
        let mut lumen = c.fluid;
        let mut other = c.other;
        for (gas, end) in c.gas.into_iter().zip(ends) {
            if gas > 0 && end.is_before(place, TIP_MM) {
                lumen += gas;
            } else {
                other += gas;
            }
        }
        if share(other) >= OTHER_SHARE {
            Block::Closed
        } else if share(lumen) >= LUMEN_SHARE {
            Block::Lumen
        } else {
            Block::Tissue(c.hu as f32 / c.rest.max(1) as f32)
        }
    }

    /// Returns the cost of each block.
    fn weighed(&self, blocks: &[Block]) -> Vec<u16> {
        let kinds = self.by_what(blocks);
        let in_lumen = self.depths(|n| blocks[n] == Block::Lumen);
        let in_soft = self.depths(|n| kinds[n] < 0.5 * (TISSUE + FAT) && blocks[n] != Block::Closed);
        let round = |c: f64| (c * UNIT).round() as u16;
        let bulge = |middle_mm: f64, depth: f32| 1.0 + (middle_mm / f64::from(depth).max(0.1)).powi(2);
        let cost = |n: usize| match blocks[n] {
            Block::Lumen => round(bulge(LUMEN_MM, in_lumen[n]).min(TISSUE)),
            Block::Closed => round(CLOSED),
            Block::Tissue(_) if kinds[n] > EDGE => round(kinds[n]),
            Block::Tissue(_) => round((kinds[n] * bulge(CORD_MM, in_soft[n])).min(EDGE)),
        };
        (0..blocks.len()).into_par_iter().map(cost).collect()
    }

    /// Returns the cost of each block by its value alone. Pockets of gas and of tagged fluid cost as much as soft tissue: a collapsed
    /// lumen often holds some. The edge of the lumen is not fat, although its values are those of fat.
    fn by_what(&self, blocks: &[Block]) -> Vec<f64> {
        let mut costs: Vec<f64> = blocks
            .iter()
            .map(|b| match b {
                Block::Lumen => TISSUE,
                Block::Closed => CLOSED,
                Block::Tissue(hu) => by_value(f64::from(*hu)),
            })
            .collect();
        let value = |n: usize| if let Block::Tissue(hu) = blocks[n] { Some(f64::from(hu)) } else { None };
        let is_closed = |n: usize| blocks[n] == Block::Closed;
        let is_airy = |n: usize| is_closed(n) || value(n).is_some_and(|hu| hu < AIRY_HU);
        self.pieces(is_airy, |piece, is_whole| {
            let is_pocket = is_whole && self.mm3(piece) <= POCKET_MM3 && !piece.iter().any(|&n| is_closed(n));
            piece.iter().for_each(|&n| costs[n] = if is_pocket { TISSUE } else { CLOSED });
        });
        self.pieces(
            |n| value(n).is_some_and(|hu| hu > SOFT_HU[2]),
            |piece, is_whole| {
                if is_whole && self.mm3(piece) <= POOL_MM3 {
                    piece.iter().for_each(|&n| costs[n] = TISSUE);
                }
            },
        );
        for n in (0..blocks.len()).filter(|&n| blocks[n] == Block::Lumen) {
            self.around(n, |m, _| {
                if matches!(blocks[m], Block::Tissue(hu) if f64::from(hu) < SOFT_HU[1]) {
                    costs[m] = TISSUE;
                }
            });
        }
        costs
    }

    /// Calls `visit` with each connected piece of a set, and whether all of it is inside the search.
    fn pieces(&self, is_in: impl Fn(usize) -> bool, mut visit: impl FnMut(&[usize], bool)) {
        let mut seen = vec![false; self.dims.iter().product()];
        let mut piece = Vec::new();
        for n in 0..seen.len() {
            if seen[n] || !is_in(n) {
                continue;
            }
            piece.clear();
            piece.push(n);
            seen[n] = true;
            let (mut next, mut is_whole) = (0, true);
            while let Some(&at) = piece.get(next) {
                next += 1;
                let place = self.at(at);
                is_whole &= (0..3).all(|a| place[a] > 0 && place[a] + 1 < self.dims[a]);
                self.around(at, |m, _| {
                    if !seen[m] && is_in(m) {
                        seen[m] = true;
                        piece.push(m);
                    }
                });
            }
            visit(&piece, is_whole);
        }
    }

    /// Returns the volume of blocks, mm³.
    fn mm3(&self, blocks: &[usize]) -> f64 {
        blocks.len() as f64 * self.steps[0].cross(self.steps[1]).dot(self.steps[2]).abs()
    }

    /// Returns how deep each block is inside a set, mm, up to its edge: a chamfer distance in two passes (Borgefors 1986) to
    /// the nearest block outside, less half a block. The edge of the search is no edge of the set.
    fn depths(&self, is_in: impl Fn(usize) -> bool) -> Vec<f32> {
        let half = self.steps.iter().map(|s| s.length()).fold(f64::INFINITY, f64::min) as f32 * 0.5;
        let mut depth: Vec<f32> = (0..self.dims.iter().product()).map(|n| if is_in(n) { 1e6 } else { 0.0 }).collect();
        for n in (0..depth.len()).chain((0..depth.len()).rev()) {
            if depth[n] > 0.0 {
                let mut least = depth[n];
                self.around(n, |m, mm| least = least.min(depth[m] + mm as f32));
                depth[n] = least;
            }
        }
        depth.iter().map(|d| (d - half).max(0.0)).collect()
    }

    /// Calls `visit` with each of the 26 neighbours of a block and its distance, mm, in a fixed order.
    pub(super) fn around(&self, n: usize, mut visit: impl FnMut(usize, f64)) {
        let at = self.at(n);
        for (step, ahead, mm) in &self.beside {
            if (0..3).all(|a| (0..self.dims[a] as i64).contains(&(at[a] as i64 + step[a]))) {
                visit((n as i64 + ahead) as usize, *mm);
            }
        }
    }
}

/// Returns the 26 neighbours of a block of a grid.
fn beside(dims: [usize; 3], steps: [DVec3; 3]) -> Vec<([i64; 3], i64, f64)> {
    let [nx, ny, _] = dims.map(|n| n as i64);
    let neighbour = |n: i64| {
        let step = [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1];
        let way: DVec3 = (0..3).map(|a| steps[a] * step[a] as f64).sum();
        (step, step[0] + nx * (step[1] + ny * step[2]), way.length())
    };
    (0..27).filter(|&n| n != 13).map(neighbour).collect()
}

/// Returns the cost of a value, HU, for each mm.
fn by_value(hu: f64) -> f64 {
    let [fat, soft, bright, bone] = SOFT_HU;
    let between =
        |from: f64, to: f64, low: f64, high: f64| from + (to - from) * ((hu - low) / (high - low)).clamp(0.0, 1.0);
    if hu < soft { between(FAT, TISSUE, fat, soft) } else { between(TISSUE, CLOSED, bright, bone) }
}

/// Counts the voxels of the blocks of a layer.
fn counted(values: &Values<'_>, lumen: &Lumen, ends: [Facing<'_>; 2], part: Part, layer: usize) -> Vec<Count> {
    let grid = values.grid();
    let [nx, ny, _] = part.dims();
    let mut counts = vec![Count::default(); nx * ny];
    let slices = layer * part.block[2]..((layer + 1) * part.block[2]).min(part.size[2]);
    // What each voxel of a row is: 0 anything, 1 gas of the first segment, 2 of the second, 3 fluid, 4 other gas.
    let mut row = vec![0u8; part.size[0]];
    for k in slices.map(|k| part.low[2] + k) {
        for j in 0..part.size[1] {
            let y = part.low[1] + j;
            row.fill(0);
            let mut fill = |rows: &Rows, of: &dyn Fn(u32) -> u8| {
                if rows.dims() != grid.dims() {
                    return;
                }
                for r in rows.row(y, k) {
                    let range = part.clip(r.start, r.end);
                    row[range.start - part.low[0]..range.end - part.low[0]].fill(of(r.label));
                }
            };
            let own = |label: u32| ends.iter().position(|e| e.segment == label as usize);
            fill(lumen.other(), &|_| 4);
            fill(lumen.gas(), &|label| own(label).map_or(4, |n| n as u8 + 1));
            fill(lumen.fluid(), &|_| 3);
            let from = grid.index(part.low[0], y, k);
            let hu = values.row(from, part.size[0]);
            let start = nx * (j / part.block[1]);
            for (i, (&what, &hu)) in row.iter().zip(&*hu).enumerate() {
                let c = &mut counts[start + i / part.block[0]];
                c.voxels += 1;
                match what {
                    1 | 2 => c.gas[usize::from(what) - 1] += 1,
                    3 => c.fluid += 1,
                    4 => c.other += 1,
                    _ => {
                        c.rest += 1;
                        c.hu += i64::from(hu);
                    }
                }
            }
        }
    }
    counts
}
