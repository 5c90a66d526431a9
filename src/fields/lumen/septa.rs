//! Septa: walls between two limbs of the colon that thick slices or noise have made darker than the wall's middle.
//!
//! Gas connects at [`CORE_HU`](super::CORE_HU) and grows from there to the wall's middle. Two things let it through a thin wall:
//!
//! 1. **The core leaks.** The average of a slice over tissue and gas, or noise, takes a septum below the core's limit. [`ridges`]
//!    finds the voxels of the core that are a ridge of HU between gas on both sides: the second difference along an axis of means
//!    across it, compared with the scan's own noise. The core is parted there.
//! 2. **The growth meets.** Every voxel remembers the part of the core that it grew from. Where voxels of two parts touch that are far
//!    apart in the core, the brighter of the two is a voxel of a septum. A fold does not part the gas, because the way round it is
//!    short, and a narrow place does not, because it is part of the only way.
//!
//! Tagged fluid meets gas at its level. Where it touches gas far from its own level, a septum lies between them, too.

use std::collections::VecDeque;

use rayon::prelude::*;

use super::choose::BUBBLE_ML;
use super::fluid::Fluid;
use super::graph::Graph;
use super::grow::grow;
use super::runs::{Rows, Run, near, touching};
use super::{GAS_HU, GROWTH};
use crate::error::Result;
use crate::progress::Progress;
use crate::volume::{Grid, Volume};

/// Two parts of the gas are far apart if the way between them through the core is longer than this, mm, counted along the axes …
const FAR_MM: f64 = 40.0;
/// … or than this in a scan that may hide septa. Beside a sharp bend the way round the septum's edge is short.
const FAR_IF_HIDDEN_MM: f64 = 24.0;
/// Voxels longer than this may hide a septum, mm …
const THICK_MM: f64 = 1.25;
/// … and so may noise of this standard deviation, HU.
const NOISY_HU: f64 = 25.0;
/// Least height of a ridge above the gas on both sides, HU …
const RIDGE_HU: f64 = 70.0;
/// … and in standard deviations of its own noise.
const RIDGE_SIGMAS: f64 = 3.5;
/// How far from a ridge gas is looked for, voxels: a septum may lie in two slices.
const SIDES: usize = 2;
/// The value of gas, HU.
const GAS_LEVEL_HU: i16 = -1000;
/// Tissue darker than this is dim, HU: a gap of the wall may be beside it.
const DIM_HU: i16 = -200;
/// Two pieces of gas that touch in an area of at least this are parted by a septum, mm²: as wide an opening would show gas in its
/// middle.
const SEPTUM_MM2: f64 = 20.0;

/// The gas grown from its core, by the parts of the core.
pub(super) struct Grown {
    /// The gas, labelled with the parts of the core, which are the nodes of its map.
    parts: Rows,
    /// The piece of the core that each part belongs to, and how many contacts it is away from its end.
    hops: Vec<Hop>,
    /// The label of each part.
    labels: Vec<u32>,
    far: u32,
}

/// Where a node is in its piece of gas. Two nodes of a piece are at least as many contacts apart as their numbers differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Hop {
    piece: u32,
    contacts: u32,
}

impl Grown {
    /// Grows the core, whose runs made `graph`, to the wall's middle. Parts are far apart if the way between them through the core is
    /// longer than `far_mm`, counted along the axes.
    pub(crate) fn of(volume: &Volume, core: &Rows, graph: &Graph, far_mm: f64, progress: &Progress) -> Result<Self> {
        // Where two labels meet, the smaller one wins, so parts are numbered by their labels.
        let mut nodes: Vec<u32> = (0..graph.nodes.len() as u32).collect();
        nodes.sort_by_key(|&n| graph.nodes[n as usize].label);
        let mut number = vec![0; nodes.len()];
        (0u32..).zip(&nodes).for_each(|(part, &node)| number[node as usize] = part);
        let parts = graph.labelled(volume.grid(), core, |node| number[node as usize], progress)?;
        let parts = grow(volume, parts, GAS_HU, GROWTH, progress)?;
        let of_node = hops(graph);
        let hops = nodes.iter().map(|&n| of_node[n as usize]).collect();
        let labels = nodes.iter().map(|&n| graph.nodes[n as usize].label).collect();
        Ok(Self { parts, hops, labels, far: graph.far_hops(volume.grid(), far_mm) })
    }

    /// Returns the gas, labelled as the core is.
    pub(crate) fn gas(&self) -> Rows {
        self.parts.select(|part| Some(self.labels[part as usize])).joined()
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
                if let Some((fluid, levels)) = &fluid {
                    self.beside_fluid(grid, fluid, levels, [j, k], &mut sure);
                }
            }
            Ok((sure, pieces))
        });
        let (sure, pieces): (Vec<_>, Vec<_>) = slices.collect::<Result<Vec<_>>>()?.into_iter().unzip();
        let (mut septa, mut pieces) = (sure.concat(), pieces.concat());
        pieces.sort_unstable();
        pieces.dedup();
        septa.extend(wide(grid, &pieces));
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
        let [a, b] = [a, b].map(|r| self.hops[r.label as usize]);
        match (a.piece == b.piece, a.contacts.abs_diff(b.contacts) >= self.far) {
            (false, _) => Between::Pieces,
            (true, true) => Between::Far,
            (true, false) => Between::Near,
        }
    }

    /// Returns where the level of each pool is, ascending.
    fn levels(&self, fluid: &Fluid) -> Vec<Vec<Hop>> {
        let hops = |level: &Vec<[i64; 3]>| {
            let nodes = level.iter().filter_map(|p| self.parts.find(p[0], p[1], p[2]));
            let mut hops: Vec<Hop> = nodes.map(|r| self.hops[r.label as usize]).collect();
            hops.sort_unstable();
            hops.dedup();
            hops
        };
        fluid.levels.iter().map(hops).collect()
    }

    /// Adds the voxels of gas in row (j, k) that touch fluid whose level is far away.
    fn beside_fluid(&self, grid: &Grid, fluid: &Fluid, levels: &[Vec<Hop>], [j, k]: [usize; 2], out: &mut Vec<usize>) {
        let [_, ny, nz] = self.parts.dims();
        if fluid.pools.dims() != self.parts.dims() {
            return;
        }
        let own = self.parts.row(j, k);
        let row = grid.index(0, j, k);
        let far = |gas: Run, pool: Run| {
            let (at, level) = (self.hops[gas.label as usize], &levels[pool.label as usize]);
            let next = level.partition_point(|l| *l < at);
            let near = |n: usize| {
                level.get(n).is_some_and(|l| l.piece == at.piece && l.contacts.abs_diff(at.contacts) < self.far)
            };
            !(near(next) || next > 0 && near(next - 1))
        };
        let pools = fluid.pools.row(j, k);
        for pool in pools {
            let at = own.partition_point(|r| r.end < pool.start);
            for gas in own[at..].iter().take_while(|r| r.start <= pool.end) {
                if far(*gas, *pool) {
                    out.extend((gas.end == pool.start).then(|| row + gas.end as usize - 1));
                    out.extend((pool.end == gas.start).then(|| row + gas.start as usize));
                }
            }
        }
        let beside = [
            (j > 0).then(|| (j - 1, k)),
            (j + 1 < ny).then(|| (j + 1, k)),
            (k > 0).then(|| (j, k - 1)),
            (k + 1 < nz).then(|| (j, k + 1)),
        ];
        for (j, k) in beside.into_iter().flatten() {
            let pools = fluid.pools.row(j, k);
            touching(pools, own, |a, b| {
                let (pool, gas) = (pools[a], own[b]);
                if far(gas, pool) {
                    let both = pool.start.max(gas.start)..pool.end.min(gas.end);
                    out.extend(both.map(|i| row + i as usize));
                }
            });
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

/// Returns the voxels (linear indices, ascending) that belong to a patch of at least [`SEPTUM_MM2`]. Voxels are of one patch if
/// their indices differ by at most two.
fn wide(grid: &Grid, voxels: &[usize]) -> Vec<usize> {
    let [nx, ny, _] = grid.dims();
    let spacing = grid.spacing();
    // A voxel's face as it is seen from the direction in which the patch is largest is not known: the mean of the three.
    let face = (spacing.x * spacing.y + spacing.y * spacing.z + spacing.z * spacing.x) / 3.0;
    let least = (SEPTUM_MM2 / face).ceil() as usize;
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

/// Returns the rows without some voxels (linear indices, ascending).
pub(super) fn without(rows: &Rows, voxels: &[usize]) -> Rows {
    if voxels.is_empty() || rows.dims().contains(&0) {
        return rows.clone();
    }
    let [nx, ny, _] = rows.dims();
    let mut at = 0;
    rows.split(|j, k, run, out| {
        let row = nx * (j + ny * k);
        let mut start = run.start;
        while voxels.get(at).is_some_and(|&v| v < row + run.start as usize) {
            at += 1;
        }
        while let Some(&v) = voxels.get(at).filter(|&&v| v < row + run.end as usize) {
            let i = (v - row) as u32;
            if i > start {
                out.push(Run { start, end: i, ..run });
            }
            start = i + 1;
            at += 1;
        }
        if start < run.end {
            out.push(Run { start, ..run });
        }
    })
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

/// What the septa of a scan may be hidden in.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hiding {
    /// Standard deviation of the noise in the gas, HU.
    noise_hu: f64,
    /// True if slices are so thick or noise is so strong that septa may be hidden.
    is_likely: bool,
}

impl Hiding {
    /// Measures it in the core.
    pub(crate) fn of(volume: &Volume, core: &Rows) -> Self {
        let noise_hu = noise_hu(volume, core);
        Self { noise_hu, is_likely: volume.grid().spacing().max_element() >= THICK_MM || noise_hu >= NOISY_HU }
    }

    /// Returns the length of a way between parts that are far apart, mm.
    pub(crate) fn far_mm(self) -> f64 {
        if self.is_likely { FAR_IF_HIDDEN_MM } else { FAR_MM }
    }
}

/// Returns the septa through which the core leaks, linear indices, ascending, if they may be hidden.
pub(super) fn leaks(volume: &Volume, core: &Rows, hiding: Hiding, progress: &Progress) -> Result<Vec<usize>> {
    if !hiding.is_likely {
        return Ok(Vec::new());
    }
    let (grid, noise) = (volume.grid(), hiding.noise_hu);
    let ridges = ridges(volume, core, noise, progress)?;
    if ridges.is_empty() {
        return Ok(ridges);
    }
    // Parted at all ridges, the core tells which of them have parts on either side that are far apart.
    let mut parted = without(core, &ridges);
    let pieces = parted.label_components(progress)?;
    let mut voxels = vec![0u64; pieces];
    parted.runs().iter().for_each(|r| voxels[r.label as usize] += u64::from(r.len()));
    // The growth takes bubbles back.
    let least = (BUBBLE_ML / grid.voxel_ml()) as u64;
    let parted = parted.select(|p| (voxels[p as usize] >= least).then_some(0));
    let graph = Graph::of(grid, &parted, progress)?;
    Grown::of(volume, &parted, &graph, hiding.far_mm(), progress)?.septa(volume, None, progress)
}

/// Returns the standard deviation of the noise in the gas, HU: from the median difference of neighbours along x.
fn noise_hu(volume: &Volume, core: &Rows) -> f64 {
    const MOST: usize = 512;
    let mut counts = [0u64; MOST + 1];
    for (j, k, r) in core.iter().filter(|(j, k, r)| (j + k) % 4 == 0 && r.len() > 12) {
        let row = &volume.data()[volume.grid().index(0, j, k)..][r.range()];
        // Away from the walls.
        for pair in row[4..row.len() - 4].windows(2).step_by(2) {
            counts[(i32::from(pair[0]) - i32::from(pair[1])).unsigned_abs().min(MOST as u32) as usize] += 1;
        }
    }
    let half = counts.iter().sum::<u64>() / 2;
    let mut sum = 0;
    let median = counts.iter().position(|&n| {
        sum += n;
        sum > half
    });
    // The median of |a − b| is 0.6745 · √2 standard deviations.
    median.map_or(0.0, |m| m as f64 / 0.954)
}

/// Returns the voxels of the core that are ridges, linear indices, ascending: those of the full height, and those of half of it that
/// touch one (Canny's hysteresis, 1986), so that no gap stays at the rim, where a mean takes in the wall beside.
fn ridges(volume: &Volume, core: &Rows, noise: f64, progress: &Progress) -> Result<Vec<usize>> {
    let filter = RidgeFilter::new(volume, noise);
    let [nx, ny, nz] = volume.grid().dims();
    let found = (0..nz).into_par_iter().map(|k| {
        progress.check()?;
        let (mut high, mut half) = (Vec::new(), Vec::new());
        let mut sums = [Vec::new(), Vec::new(), Vec::new()];
        for j in 0..ny {
            core.row(j, k).iter().for_each(|&r| filter.run(r, [j, k], &mut sums, &mut high, &mut half));
        }
        Ok((high, half))
    });
    let (high, half): (Vec<_>, Vec<_>) = found.collect::<Result<Vec<_>>>()?.into_iter().unzip();
    let (mut all, half) = (high.concat(), half.concat());
    let mut taken = vec![false; half.len()];
    for &ridge in &all {
        for row in [-1, 0, 1].into_iter().flat_map(|k| [-1, 0, 1].map(|j| nx as i64 * (j + ny as i64 * k))) {
            let middle = ridge as i64 + row;
            let first = half.partition_point(|&h| (h as i64) < middle - 1);
            let near = (first..half.len()).take_while(|&h| half[h] as i64 <= middle + 1);
            near.for_each(|h| taken[h] = true);
        }
    }
    all.extend(half.iter().zip(taken).filter(|h| h.1).map(|h| *h.0));
    all.sort_unstable();
    Ok(all)
}

/// The second difference of the HU along each axis, of means across it.
struct RidgeFilter<'a> {
    data: &'a [i16],
    dims: [usize; 3],
    stride: [usize; 3],
    /// True for the axes along which means are taken: neighbours there are near.
    is_near: [bool; 3],
    /// Least height of a ridge across each axis, times the number of voxels of a mean.
    least: [i32; 3],
    /// Least sum of a mean that may be a ridge's: gas is near −1000 HU.
    floor: [i32; 3],
}

impl<'a> RidgeFilter<'a> {
    fn new(volume: &'a Volume, noise: f64) -> Self {
        let grid = volume.grid();
        let dims @ [nx, ny, _] = grid.dims();
        let is_near = [0, 1, 2].map(|a| grid.spacing()[a] <= THICK_MM);
        let count = [0, 1, 2].map(|axis| (0..3).filter(|&a| a != axis && is_near[a]).map(|_| 3).product::<i32>());
        let least = count.map(|n| {
            // The difference of a mean and the mean of two has √1.5 of the mean's noise.
            let hu = RIDGE_HU.max(RIDGE_SIGMAS * noise * (1.5 / f64::from(n)).sqrt());
            (hu * f64::from(n)).ceil() as i32
        });
        let floor = [0, 1, 2].map(|a| least[a] / 2 + i32::from(GAS_LEVEL_HU) * count[a]);
        Self { data: volume.data(), dims, stride: [1, nx, nx * ny], is_near, least, floor }
    }

    /// Adds the ridges of a run in row (j, k), those of the full and those of half the height. Voxels beside the scan's faces are none.
    fn run(
        &self,
        run: Run,
        [j, k]: [usize; 2],
        sums: &mut [Vec<i32>; 3],
        high: &mut Vec<usize>,
        half: &mut Vec<usize>,
    ) {
        let edge = SIDES + 1;
        let is_inner = |at: usize, a: usize| at >= edge && at + edge < self.dims[a];
        let (first, last) = ((run.start as usize).max(edge), (run.end as usize).min(self.dims[0].saturating_sub(edge)));
        if first >= last || !is_inner(j, 1) || !is_inner(k, 2) {
            return;
        }
        let row = self.stride[1] * j + self.stride[2] * k;
        self.row_sums(row + first, last - first, sums);
        for (n, at) in (row + first..row + last).enumerate() {
            let mut is_half = false;
            let is_high = (0..3).any(|axis| {
                let here = sums[axis][n];
                if here < self.floor[axis] {
                    return false;
                }
                let height = self.height(at, axis, here);
                is_half |= 2 * height >= self.least[axis];
                height >= self.least[axis]
            });
            if is_high {
                high.push(at);
            } else if is_half {
                half.push(at);
            }
        }
    }

    /// Fills in the sums across each axis of `count` voxels from `first` on.
    fn row_sums(&self, first: usize, count: usize, sums: &mut [Vec<i32>; 3]) {
        for (axis, sums) in sums.iter_mut().enumerate() {
            sums.clear();
            sums.resize(count, 0);
            self.each_step(axis, |step| {
                let from = (first as isize + step) as usize;
                sums.iter_mut().zip(&self.data[from..from + count]).for_each(|(s, &v)| *s += i32::from(v));
            });
        }
    }

    /// Calls `f` with the steps from a voxel to those of its mean across an axis.
    #[inline(always)]
    fn each_step(&self, axis: usize, mut f: impl FnMut(isize)) {
        let [b, c] = [(axis + 1) % 3, (axis + 2) % 3];
        let steps = |a: usize| if self.is_near[a] { -1..=1isize } else { 0..=0 };
        for m in steps(b) {
            for n in steps(c) {
                f(m * self.stride[b] as isize + n * self.stride[c] as isize);
            }
        }
    }

    /// Returns how far the sum `here` at a voxel is above the lower one of the next two on either side.
    fn height(&self, at: usize, axis: usize, here: i32) -> i32 {
        let side = |sign: isize| {
            let sums = (1..=SIDES as isize).map(|n| {
                let beside = at as isize + sign * n * self.stride[axis] as isize;
                let mut sum = 0;
                self.each_step(axis, |step| sum += i32::from(self.data[(beside + step) as usize]));
                sum
            });
            here - sums.fold(i32::MAX, i32::min)
        };
        side(-1).min(side(1))
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::fields::lumen::{Lumen, gas_at};
    use crate::math::hash;

    const LEFT: DVec3 = DVec3::new(20.0, 30.0, 20.0);

    /// The mean over slices of `slice` mm of a body that is gas where `is_gas` says so, with noise of `noise` HU.
    fn scanned(slice: f64, noise: f64, is_gas: impl Fn(DVec3) -> bool) -> Volume {
        let dims = [180, 60, (90.0 / slice) as usize];
        let spacing = DVec3::new(1.0, 1.0, slice);
        let grid = Grid::new(dims, spacing, DVec3::new(0.0, 0.0, 0.5 * slice), DMat3::IDENTITY).unwrap();
        let fine = 24;
        let mut data = Vec::with_capacity(grid.len());
        for k in 0..dims[2] {
            for (j, i) in (0..dims[1]).flat_map(|j| (0..dims[0]).map(move |i| (j, i))) {
                let z = |n: i32| slice * (k as f64 + (f64::from(n) + 0.5) / f64::from(fine));
                let gas = (0..fine).filter(|&n| is_gas(DVec3::new(i as f64, j as f64, z(n)))).count() as f64;
                let mean = 40.0 - 1040.0 * gas / f64::from(fine);
                let seed = (data.len() as u64) * 3;
                // The sum of three uniform numbers has the variance 1/4.
                let sum: f64 = (0..3).map(|n| hash::uniform(1, seed + n) - 0.5).sum();
                data.push((mean + 2.0 * noise * sum) as i16);
            }
        }
        Volume::new(grid, data)
    }

    /// Two limbs along x, joined at their right ends, with a wall of `wall` mm between them from z = `at` on.
    fn limbs(at: f64, wall: f64) -> impl Fn(DVec3) -> bool {
        move |p: DVec3| {
            let is_across = (18.0..42.0).contains(&p.y) && (10.0..170.0).contains(&p.x);
            let is_wall = (at..at + wall).contains(&p.z) && p.x < 145.0;
            is_across && (at - 24.0..at + wall + 24.0).contains(&p.z) && !is_wall
        }
    }

    fn found(volume: &Volume) -> Lumen {
        gas_at(volume, LEFT, &Progress::new()).unwrap().unwrap()
    }

    #[test]
    fn limbs_that_share_a_thin_wall_stay_apart() {
        // Slices of 3 and 5 mm; the wall within one slice, and across two.
        for (slice, at, wall, noise) in [
            (3.0, 36.4, 0.7, 0.0),
            (3.0, 35.6, 0.8, 0.0),
            (3.0, 36.4, 0.7, 40.0),
            (5.0, 36.0, 0.7, 0.0),
            (5.0, 36.0, 1.0, 25.0),
            (2.0, 36.5, 0.4, 12.0),
        ] {
            let volume = scanned(slice, noise, limbs(at, wall));
            let lumen = found(&volume);
            let case = format!("{wall} mm in {slice} mm at {at}, noise {noise}");
            assert!(lumen.septa().len() > 1000, "{case}: {} voxels", lumen.septa().len());
            let length = lumen.segments[0].length_mm;
            assert!(length > 220.0, "{case}: {length} mm");
            // Nothing passes: with its septa closed, the lumen is the same and has none left to close.
            let mut closed = volume.clone();
            lumen.close_septa(&mut closed);
            let again = found(&closed);
            assert!((again.gas_ml() - lumen.gas_ml()).abs() < 0.01 * lumen.gas_ml(), "{case}");
            assert!((again.segments[0].length_mm - length).abs() < 0.05 * length, "{case}");
        }
    }

    #[test]
    fn folds_and_narrow_openings_stay_open() {
        // One straight tube with a fold of half its height in every 40 mm, 1 mm thick; and one with an opening of 3 mm radius.
        for slice in [1.0, 3.0, 5.0] {
            let tube =
                |p: DVec3| (18.0..42.0).contains(&p.y) && (15.0..45.0).contains(&p.z) && (10.0..170.0).contains(&p.x);
            let folds = scanned(slice, 20.0, |p| tube(p) && !(p.z < 30.0 && p.x % 40.0 < 1.0));
            let narrow =
                scanned(slice, 20.0, |p| tube(p) && ((p.x - 90.0).abs() > 2.0 || (p.y - 30.0).hypot(p.z - 32.0) < 3.0));
            // Two chambers above each other, joined by an opening of the same size.
            let stacked = scanned(slice, 20.0, |p| {
                let is_open = (p.x - 90.0).hypot(p.y - 30.0) < 3.0;
                (18.0..42.0).contains(&p.y)
                    && (20.0..160.0).contains(&p.x)
                    && ((15.0..30.0).contains(&p.z)
                        || (45.0..75.0).contains(&p.z)
                        || is_open && (25.0..50.0).contains(&p.z))
            });
            for (name, volume, ml) in [("folds", folds, 113.5), ("narrow", narrow, 112.5), ("stacked", stacked, 151.6)]
            {
                let lumen = found(&volume);
                assert!((lumen.gas_ml() - ml).abs() < 0.06 * ml, "{name}, {slice} mm: {} ml", lumen.gas_ml());
                assert!(lumen.septa().is_empty(), "{name}, {slice} mm: {} voxels of septa", lumen.septa().len());
            }
        }
    }

    #[test]
    fn noise_is_measured_in_the_gas() {
        for noise in [0.0, 12.0, 50.0] {
            let volume = scanned(3.0, noise, limbs(36.0, 3.0));
            let (rows, _) = super::super::runs::components_below(&volume, -800, &Progress::new()).unwrap();
            let measured = noise_hu(&volume, &rows);
            assert!((measured - noise).abs() <= 1.0 + 0.05 * noise, "{measured} for {noise}");
        }
    }

    #[test]
    fn patches_smaller_than_a_septum_are_openings() {
        let grid = Grid::new([40, 40, 40], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let square =
            |side: usize, at: usize| (0..side * side).map(move |n| (at + n % side) + 40 * (at + n / side + 40 * at));
        let mut voxels: Vec<usize> = square(4, 5).chain(square(5, 20)).collect();
        voxels.sort_unstable();
        let kept = wide(&grid, &voxels);
        assert!(kept.len() == 25 && kept.iter().all(|v| v % 40 >= 20));
        let nothing: [usize; 0] = [];
        assert_eq!(wide(&grid, &nothing), nothing);
    }
}
