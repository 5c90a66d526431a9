//! Tagged fluid: bright voxels below a level surface of the gas.
//!
//! Gravity pulls towards the patient's back, front or side, whichever the level surfaces are on. Neighbouring columns at
//! the same level form a pool, and a pool's own brightness gives the threshold between it and the wall. From there the
//! fluid is flooded, never above its level, through voxels that are bright *and* have bright neighbours. It therefore
//! runs neither through a blurred wall into the tagged small bowel nor into bone.

use std::collections::VecDeque;

use colvis_scan::memory;
use glam::DVec3;
use rayon::prelude::*;

use super::GAS_HU;
use super::frame::{AxisDirection, Frame};
use super::paged::PagedBits;
use super::runs::{Rows, Run, touching};
use crate::error::Result;
use crate::math::sets::Sets;
use crate::progress::Progress;
use crate::volume::{Grid, Volume};

/// Voxels brighter than this may be tagged, HU: above muscle, organs and most vessels.
const BRIGHT_HU: i16 = 180;
/// Brightness of the wall itself, HU. Fluid ends half-way between this and its own brightness.
const WALL_HU: i32 = 60;
/// Maximum thickness of the partial-volume layer between gas and fluid, mm (at least three voxels).
const BLUR_MM: f64 = 3.0;
/// Minimum width of a piece of level surface, across the patient, mm.
const LEVEL_MM: f64 = 6.0;
/// Minimum area of a pool's surface, mm².
const SURFACE_MM2: f64 = 60.0;
/// Required ratio of level surface between the two sides to determine which way is down.
const SURE: usize = 3;
/// Minimum area of level surface that shows which way is down, mm².
const TELLING_MM2: f64 = 300.0;
/// With this area of level surface on the back or the belly, the sides are not looked at, mm².
const AMPLE_MM2: f64 = 1500.0;
/// Depth of fluid below its surface where it is too thin to flood, mm.
const FILM_MM: f64 = 5.0;
/// Maximum distance of fluid from its surface, mm.
const FAR_MM: f64 = 160.0;
/// Passages narrower than about twice this are not flooded, mm.
const PASSAGE_MM: f64 = 1.2;
/// Maximum volume of a pool in the colon, ml. Beyond it the flood has leaked, and only fluid directly under the surface counts.
const POOL_ML: f64 = 400.0;

/// Tagged fluid and the segments that it joins.
#[derive(Debug)]
pub(super) struct Fluid {
    /// Runs, labelled with the segment that they count towards.
    pub rows: Rows,
    /// For each segment, the others that share a pool with it.
    pub joined: Vec<Vec<usize>>,
    /// The direction of gravity, if level surfaces show it.
    pub down: Option<AxisDirection>,
    /// The same runs, labelled with their pool.
    pub pools: Rows,
    /// The voxels of gas above the level surface of each pool.
    pub levels: Vec<Vec<[i64; 3]>>,
}

/// A voxel below the gas, with fluid a few voxels further down.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Column {
    /// Voxel indices: along the patient's axis, across, and the level.
    slice: u32,
    across: u32,
    level: u32,
    label: u32,
    /// Number of voxels from here down to the first bright one.
    depth: u32,
    hu: i16,
}

/// Finds the fluid below the gas of `count` labels.
pub(super) fn find(volume: &Volume, gas: &Rows, count: usize, frame: Frame, progress: &Progress) -> Result<Fluid> {
    // Most patients lie on the back or the belly; their sides are only looked at where neither has much.
    let mut found = Vec::with_capacity(4);
    for sides in [[frame.posterior, frame.posterior.back()], [frame.left, frame.left.back()]] {
        for down in sides {
            let mut columns = columns(volume, gas, frame, down, progress)?;
            let across = across(frame, down);
            let least = (LEVEL_MM / volume.grid().spacing()[across.axis]).ceil().max(3.0) as usize;
            keep_level(&mut columns, least);
            found.push((down, columns));
        }
        found.sort_by_key(|f| std::cmp::Reverse(f.1.len()));
        let area = found[0].1.len() as f64 * cell_mm2(volume.grid(), frame, found[0].0);
        if area >= AMPLE_MM2 && found[0].1.len() > found[1].1.len() * SURE {
            break;
        }
    }
    let sure = found[0].1.len() >= SURE * found[1].1.len();
    let (down, columns) = found.swap_remove(0);
    drop(found);
    memory::release();
    let pools = if sure { pools(volume.grid(), frame, down, columns) } else { Vec::new() };
    let surface: usize = pools.iter().map(|p| p.columns.len()).sum();
    let told = surface as f64 * cell_mm2(volume.grid(), frame, down) >= TELLING_MM2;
    let mut flood = Flood::new(volume, gas, frame, down, pools.len());
    for (n, pool) in pools.iter().enumerate() {
        progress.check()?;
        flood.pool(n as u32, pool);
    }
    let fluid = flood.finish(&pools, count)?;
    Ok(Fluid { down: told.then_some(down), ..fluid })
}

/// Returns the direction across the body that is level if `down` is down.
fn across(frame: Frame, down: AxisDirection) -> AxisDirection {
    if down.axis == frame.left.axis { frame.posterior } else { frame.left }
}

/// Returns the area of a column's end, mm².
fn cell_mm2(grid: &Grid, frame: Frame, down: AxisDirection) -> f64 {
    grid.spacing()[across(frame, down).axis] * grid.spacing()[frame.superior.axis]
}

/// Returns the columns of fluid under gas.
fn columns(volume: &Volume, gas: &Rows, frame: Frame, down: AxisDirection, progress: &Progress) -> Result<Vec<Column>> {
    let [_, ny, nz] = gas.dims();
    let step = down.step();
    let spacing = volume.grid().spacing()[down.axis];
    let blur = (BLUR_MM / spacing).ceil().max(3.0) as i64;
    let look = (BLUR_MM / spacing).ceil().max(1.0) as i64;
    let slices: Vec<Vec<Column>> = (0..nz)
        .into_par_iter()
        .map(|k| {
            progress.check()?;
            let mut out = Vec::new();
            let mut visit = |at: [i64; 3], label: u32| {
                let hu = |n: i64| volume.get(at[0] + step[0] * n, at[1] + step[1] * n, at[2] + step[2] * n);
                let Some(depth) = (0..blur).find(|&n| hu(n) > BRIGHT_HU) else { return };
                let hu = (depth..=depth + look).map(hu).max().unwrap_or(BRIGHT_HU);
                let along = |w: AxisDirection| at[w.axis] as u32;
                out.push(Column {
                    slice: along(frame.superior),
                    across: along(across(frame, down)),
                    level: along(down),
                    label,
                    depth: depth as u32,
                    hu,
                });
            };
            for j in 0..ny {
                for r in gas.row(j, k) {
                    gas.beyond(*r, j, k, down, |at| visit(at, r.label));
                }
            }
            Ok(out)
        })
        .collect::<Result<_>>()?;
    Ok(slices.concat())
}

/// Keeps the columns whose level is shared by at least `least` others of their label and slice; sorts them.
fn keep_level(columns: &mut Vec<Column>, least: usize) {
    let key = |c: &Column| (c.label, c.slice, c.level);
    columns.sort_unstable_by_key(|c| (key(c), c.across));
    let mut kept = Vec::new();
    for group in columns.chunk_by(|a, b| key(a) == key(b)) {
        if group.len() >= least {
            kept.extend_from_slice(group);
        }
    }
    kept.sort_unstable();
    *columns = kept;
}

/// Adjacent columns at the same level.
#[derive(Debug)]
struct Pool {
    columns: Vec<Column>,
    /// Brightness of the fluid, HU.
    hu: i32,
    label: u32,
}

fn pools(grid: &Grid, frame: Frame, down: AxisDirection, columns: Vec<Column>) -> Vec<Pool> {
    let mut sets = Sets::new(columns.len());
    for (n, c) in columns.iter().enumerate() {
        // A neighbour may be missing where a bubble floats on the fluid, so look two voxels far.
        for (ds, da) in [(0, 1), (0, 2), (1, -1), (1, 0), (1, 1), (2, 0)] {
            let (slice, across) = (c.slice + ds, i64::from(c.across) + da);
            let from = columns.partition_point(|o| (o.slice, i64::from(o.across)) < (slice, across));
            for (m, o) in columns.iter().enumerate().skip(from) {
                if (o.slice, i64::from(o.across)) != (slice, across) {
                    break;
                }
                if o.label == c.label && o.level.abs_diff(c.level) <= 2 {
                    sets.join(n as u32, m as u32);
                }
            }
        }
    }
    let (of, count) = sets.numbered();
    let mut grouped = vec![Vec::new(); count];
    for (c, set) in columns.into_iter().zip(of) {
        grouped[set as usize].push(c);
    }
    let cell = cell_mm2(grid, frame, down);
    let mut pools: Vec<Pool> = grouped
        .into_iter()
        .filter(|g| g.len() as f64 * cell >= SURFACE_MM2)
        .map(|columns| {
            let mut hu: Vec<i16> = columns.iter().map(|c| c.hu).collect();
            hu.sort_unstable();
            Pool { hu: i32::from(hu[hu.len() / 2]), label: columns[0].label, columns }
        })
        .collect();
    pools.sort_by_key(|p| (std::cmp::Reverse(p.columns.len()), p.columns[0]));
    pools
}

/// A voxel whose neighbours are still to be flooded.
#[derive(Clone, Copy, Debug)]
struct Open {
    at: [u32; 3],
    /// How many voxels beyond the core may still be taken from here.
    left: u32,
    /// Distance from the surface along the axes, mm.
    far: f64,
}

/// State of the flood over all pools.
struct Flood<'a> {
    volume: &'a Volume,
    gas: &'a Rows,
    frame: Frame,
    down: AxisDirection,
    /// Distance within which neighbours must be bright, voxels along each index axis.
    reach: [i64; 3],
    /// The voxels taken by any pool, and by the pool being flooded.
    taken: PagedBits,
    own: PagedBits,
    /// Runs of the previous pools, labelled with their pool, and their rows.
    runs: Vec<(u64, Run)>,
    /// Voxels that a pool reached below its own surface but another had taken: the two pools are one.
    met: Vec<([i64; 3], u32)>,
}

impl<'a> Flood<'a> {
    fn new(volume: &'a Volume, gas: &'a Rows, frame: Frame, down: AxisDirection, pools: usize) -> Self {
        let reach = volume.grid().spacing().to_array().map(|s| (PASSAGE_MM / s).round().min(3.0) as i64);
        let voxels = if pools == 0 { 0 } else { volume.grid().len() };
        Self {
            volume,
            gas,
            frame,
            down,
            reach,
            taken: PagedBits::new(voxels),
            own: PagedBits::new(voxels),
            runs: Vec::new(),
            met: Vec::new(),
        }
    }

    fn pool(&mut self, id: u32, pool: &Pool) {
        let threshold = ((WALL_HU + pool.hu) / 2).max(i32::from(BRIGHT_HU)) as i16;
        let grid = self.volume.grid();
        let step = self.down.step();
        // Measure depth from the patient's uppermost point in the world, so that a tilted grid also has level surfaces.
        let world = usize::from(self.down.axis != self.frame.left.axis);
        let pull =
            if (grid.to_world().matrix3.col(self.down.axis) * self.down.sign as f64)[world] < 0.0 { -1.0 } else { 1.0 };
        let depth = |p: [i64; 3]| pull * grid.world(place(p))[world];
        let surface =
            pool.columns.iter().map(|c| depth(index(self.frame, self.down, c))).fold(f64::INFINITY, f64::min) - 1e-6;
        let rim = 1 + self.reach[0].max(self.reach[1]).max(self.reach[2]) as u32;
        // A taken voxel is in the grid.
        let open_at = |p: [i64; 3], left: u32, far: f64| Open { at: p.map(|x| x as u32), left, far };
        let mut open = VecDeque::new();
        for c in &pool.columns {
            let at = index(self.frame, self.down, c);
            let film = i64::from(c.depth) + (FILM_MM / grid.spacing()[self.down.axis]) as i64;
            for n in 0..=film {
                let p: [i64; 3] = std::array::from_fn(|a| at[a] + step[a] * n);
                if n > i64::from(c.depth) && self.hu(p) <= threshold {
                    break;
                }
                if !self.take(p) {
                    self.met.push((p, id));
                    break;
                }
                if self.is_core(p, threshold) {
                    open.push_back(open_at(p, rim, 0.0));
                }
            }
        }
        let mut under_surface = Vec::with_capacity(self.own.count());
        self.own.each(|v| under_surface.push(v));
        let limit = (POOL_ML / grid.voxel_ml()) as usize;
        let spacing = grid.spacing();
        while let Some(Open { at, left, far }) = open.pop_front() {
            let p = at.map(i64::from);
            for axis in 0..3 {
                for sign in [-1, 1] {
                    let mut q = p;
                    q[axis] += sign;
                    let far = far + spacing[axis];
                    if self.hu(q) <= threshold || self.is_taken(q) || far > FAR_MM || depth(q) < surface {
                        continue;
                    }
                    // Outside the core only its rim is taken, as wide as the core's distance from voxels that are not bright.
                    let left = if self.is_core(q, threshold) { rim } else { left - 1 };
                    if self.take(q) && left > 0 {
                        open.push_back(open_at(q, left, far));
                    }
                }
            }
            if self.own.count() > limit {
                let leaked = self.take_own();
                self.taken.remove(&leaked);
                under_surface.into_iter().for_each(|v| self.add(v));
                break;
            }
        }
        self.compress(id);
    }

    /// Adds a voxel to the pool being flooded.
    fn add(&mut self, voxel: usize) {
        self.taken.add(voxel);
        self.own.add(voxel);
    }

    /// Returns the voxels of the pool being flooded, which then has none.
    fn take_own(&mut self) -> PagedBits {
        std::mem::replace(&mut self.own, PagedBits::new(self.volume.grid().len()))
    }

    /// Converts the voxels of a pool to runs.
    fn compress(&mut self, id: u32) {
        let nx = self.gas.dims()[0];
        let first = self.runs.len();
        self.take_own().each(|voxel| {
            let (row, x) = ((voxel / nx) as u64, (voxel % nx) as u32);
            match self.runs[first..].last_mut().filter(|(r, run)| *r == row && run.end == x) {
                Some((_, run)) => run.end += 1,
                None => self.runs.push((row, Run { start: x, end: x + 1, label: id })),
            }
        });
    }

    fn hu(&self, p: [i64; 3]) -> i16 {
        self.volume.get(p[0], p[1], p[2])
    }

    /// True if a voxel and its neighbours are brighter than `threshold`.
    fn is_core(&self, p: [i64; 3], threshold: i16) -> bool {
        self.hu(p) > threshold
            && (0..3).all(|axis| {
                (1..=self.reach[axis]).all(|n| {
                    [n, -n].iter().all(|d| {
                        let mut q = p;
                        q[axis] += d;
                        self.hu(q) > threshold
                    })
                })
            })
    }

    /// Takes a voxel for a pool; returns false if it is gas, outside, or already taken.
    fn take(&mut self, p: [i64; 3]) -> bool {
        let Some(v) = self.linear(p) else { return false };
        // Only dark voxels can be gas, so the search is rarely needed.
        let is_gas = || self.hu(p) <= GAS_HU && self.gas.find(p[0], p[1], p[2]).is_some();
        if self.is_taken(p) || is_gas() {
            return false;
        }
        self.add(v);
        true
    }

    fn is_taken(&self, p: [i64; 3]) -> bool {
        self.linear(p).is_some_and(|v| self.taken.has(v))
    }

    fn linear(&self, p: [i64; 3]) -> Option<usize> {
        let dims = self.gas.dims();
        let inside = (0..3).all(|a| p[a] >= 0 && p[a] < dims[a] as i64);
        inside.then(|| self.volume.grid().index(p[0] as usize, p[1] as usize, p[2] as usize))
    }
}

impl Flood<'_> {
    /// Joins the pools that touch.
    fn finish(mut self, pools: &[Pool], count: usize) -> Result<Fluid> {
        drop((self.taken, self.own));
        self.runs.sort_unstable_by_key(|(row, run)| (*row, run.start));
        let dims @ [_, ny, nz] = self.gas.dims();
        let mut slices: Vec<(Vec<u32>, Vec<Run>)> = vec![(vec![0; ny], Vec::new()); nz];
        for (row, run) in self.runs {
            let (lengths, runs) = &mut slices[row as usize / ny];
            lengths[row as usize % ny] += 1;
            runs.push(run);
        }
        let rows = Rows::from_slices(dims, slices)?;
        let mut sets = Sets::new(pools.len());
        for (p, id) in self.met {
            if let Some(r) = rows.find(p[0], p[1], p[2]) {
                sets.join(r.label, id);
            }
        }
        for k in 0..nz {
            for j in 0..ny {
                let row = rows.row(j, k);
                for w in row.windows(2).filter(|w| w[0].end == w[1].start) {
                    sets.join(w[0].label, w[1].label);
                }
                let beside = [(j > 0).then(|| rows.row(j - 1, k)), (k > 0).then(|| rows.row(j, k - 1))];
                for other in beside.into_iter().flatten() {
                    touching(other, row, |a, b| sets.join(other[a].label, row[b].label));
                }
            }
        }
        // Pools are numbered by the size of their surface, so the first of a set has the largest.
        let roots: Vec<usize> = (0..pools.len() as u32).map(|p| sets.find(p) as usize).collect();
        let mut joined = vec![Vec::new(); count];
        for (p, &root) in roots.iter().enumerate() {
            for (q, _) in roots.iter().enumerate().filter(|o| *o.1 == root) {
                let (a, b) = (pools[p].label as usize, pools[q].label as usize);
                if a != b && !joined[a].contains(&b) {
                    joined[a].push(b);
                }
            }
        }
        let above = self.down.back().step();
        let mut levels = vec![Vec::new(); pools.len()];
        for (pool, &root) in pools.iter().zip(&roots) {
            levels[root].extend(pool.columns.iter().map(|c| {
                let at = index(self.frame, self.down, c);
                [0, 1, 2].map(|a| at[a] + above[a])
            }));
        }
        let of_roots = rows.relabelled(|pool| roots[pool as usize] as u32);
        let labelled = of_roots.clone().relabelled(|root| pools[root as usize].label);
        Ok(Fluid { rows: labelled, joined, down: None, pools: of_roots, levels })
    }
}

/// Returns the voxel just below the gas of a column.
fn index(frame: Frame, down: AxisDirection, c: &Column) -> [i64; 3] {
    let mut at = [0; 3];
    at[frame.superior.axis] = i64::from(c.slice);
    at[across(frame, down).axis] = i64::from(c.across);
    at[down.axis] = i64::from(c.level);
    at
}

fn place(p: [i64; 3]) -> DVec3 {
    DVec3::new(p[0] as f64, p[1] as f64, p[2] as f64)
}
