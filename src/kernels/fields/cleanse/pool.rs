//! Pools: fluid under a level, which is a plane.
//!
//! What the lumen alone would show is known everywhere: `M = A + (F − A)·Φ(depth/σ)`, with gas `A` and the tag's local level `F`. A
//! voxel then shows `v = T p + M (1 − p)`, exact where the level meets the wall at a right angle (a corner of three materials)
//! and everywhere else near it. The tissue's share is estimated by least squares over a small Gaussian neighbourhood,
//!
//! ```text
//! p = Σ G (T − M)(v − M) / Σ G (T − M)²
//! ```
//!
//! so that it comes from below and above the thin layer where a mixture of gas and tag looks like tissue (`M ≈ T`), and noise
//! that the lower contrast to tag would amplify is averaged. The neighbourhood's own blur is then taken off: an edge of width
//! `√(σ² + s²)` gets the width σ by `Φ(√(1 + s²/σ²) Φ⁻¹(p))`, exact on planes. The cleansed value is `A + (T − A) p`.
//!
//! Where fluid stands above the plane, `M` would be gas and the fluid would be taken for tissue: its depth is that below its own surface
//! there ([`risen`](super::risen)).

use std::collections::BTreeMap;
use std::ops::Range;

use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;

use super::beside::{Beside, Brighter};
use super::block::{Block, Bricks, CellMeans, Mask, Phi};
use super::changes::Changes;
use super::model::{CleansedPool, Left};
use super::pools::Split;
use super::risen::Risen;
use super::slab::Slabs;
use super::{For, GAS, SOLID_HU, Scanner, TISSUE, WALL_HU, step};
use crate::error::Result;
use crate::fields::Lumen;
use crate::fields::lumen::frame::AxisDirection;
use crate::fields::voxels::each_bit;
use crate::math::normal;
use crate::progress::Progress;
use crate::volume::Volume;

/// Standard deviation of the neighbourhood, mm.
const NEIGHBOURHOOD_MM: f64 = 0.6;
/// The largest share of tissue that a wall's curvature may add or take: that of an edge of 1 mm radius.
const STRAIGHTENED: f32 = 0.15;
/// How far from fluid values are replaced along each axis, mm: less than 5 mm along a diagonal.
const REACH_MM: f64 = 2.85;
/// Minimum contrast of tag, HU.
const CONTRAST: f32 = 100.0;
/// Values of tissue beside tag, brightened by it or not, HU.
const TISSUES: std::ops::RangeInclusive<f32> = -20.0..=220.0;
/// Values of gas, HU.
const GASES: std::ops::RangeInclusive<f32> = -1100.0..=-820.0;
/// Maximum margin of a block, voxels, so that its rows fit into words.
const MARGIN: usize = (Mask::ROW - 32) / 2;
/// Noise and texture, HU: values that exceed tissue by no more than this may be tissue.
const TEXTURE: f32 = 80.0;
/// A wall between one part of the lumen and another that is thinner than this stays wall, mm: between fluid and gas it may have none of
/// its brightness left. So it is below this depth, σ; at a level, gas and fluid are the lumen's two sides everywhere.
const SLAB_MM: f64 = 3.0;
const DEEP: f32 = 3.5;
/// It is tag if it is darker than tag by less than this share of the contrast to tissue.
const TAG_SHARE: f32 = 0.3;
/// Deviation above which a column does not belong to a level, mm.
const LEVEL_MM: f64 = 0.7;
/// Minimum number of pure tag voxels for an estimate of its brightness.
const PURE: f64 = 60.0;
/// Fluid has risen above its level where it is this far above it, σ, and exceeds tissue by this share of the tag's contrast: gas
/// above a plane leaves less than tissue's value there.
const RISEN: f32 = 1.0;
const RISEN_SHARE: f32 = 0.3;
/// How strongly a level is drawn to the grid's axis: the spread (voxels²) at which half of its slope is trusted.
const HOLD: f64 = 4.0;

/// A run of voxels: j, k and the range of i.
pub(super) type Place = (usize, usize, Range<usize>);

/// A pool's runs, and the number of its level.
pub(super) struct Fluid {
    pub label: u32,
    pub runs: Vec<Place>,
}

/// Estimated properties of a pool.
#[derive(Clone)]
struct Pool {
    label: u32,
    down: AxisDirection,
    /// Depth below the level, voxels along `down`, as a plane over the voxel's indices.
    depth: DVec3,
    above: f64,
    /// Blur across the level, mm.
    blur_mm: f64,
    gas: CellMeans,
    tag: CellMeans,
    /// Number of pure tag voxels.
    pure: f64,
    tissue: CellMeans,
}

impl Pool {
    /// Returns the depth of a voxel below the level, voxels along `down`.
    fn depth_at(&self, voxel: [i64; 3]) -> f32 {
        (self.depth.dot(DVec3::from_array(voxel.map(|c| c as f64))) - self.above) as f32
    }
}

/// Reasons why a pool was not removed.
pub(super) const FAINT: &str = "hardly brighter than tissue";
pub(super) const NO_LEVEL: &str = "no level under gas";

/// The pools of a scan: those that were removed, the new values, and what remains.
#[derive(Default)]
pub(super) struct Pools {
    pub taken: Vec<CleansedPool>,
    pub changed: Vec<Changes>,
    pub left: Vec<Left>,
}

/// Removes all pools.
pub(super) fn cleanse(
    volume: &Volume,
    lumen: &Lumen,
    split: &Split,
    fluids: &[Fluid],
    scanner: &Scanner,
    purpose: For,
    progress: &Progress,
) -> Result<Pools> {
    let bricks = Bricks::of(volume.grid());
    let mut out = Pools { taken: Vec::new(), changed: Vec::new(), left: Vec::new() };
    let known = fluids.par_iter().map(|f| survey(volume, lumen, split, f, &bricks, scanner, progress));
    let mut found = Vec::new();
    for known in known.collect::<Result<Vec<_>>>()? {
        match known {
            Ok(known) => found.push(Some(known)),
            Err(left) => {
                out.left.push(left);
                found.push(None);
            }
        }
    }
    // A narrow pool has no pure tag voxel: assume the brightness of the others, as far as it is visible.
    let sure = || found.iter().flatten().filter(|(pool, _)| pool.pure >= PURE);
    let all = sure().map(|(_, found)| found.ml).sum::<f64>();
    let usual = sure().map(|(_, found)| found.ml * found.tag_hu).sum::<f64>() / all;
    if all > 0.0 {
        for (pool, found) in found.iter_mut().flatten().filter(|(pool, _)| pool.pure < PURE) {
            found.tag_hu = found.tag_hu.min(usual);
            pool.tag = CellMeans::new(&bricks, &[], found.tag_hu, 1.0);
        }
    }
    let mut work = Vec::new();
    let mut pools = Vec::new();
    let mut runs = Vec::new();
    for (fluid, found) in fluids.iter().zip(found) {
        let Some((pool, found)) = found else { continue };
        work.extend(bricks.around(&fluid.runs, reach(volume)).into_iter().map(|b| (b, pools.len())));
        pools.push(pool);
        runs.push(&fluid.runs);
        out.taken.push(found);
    }
    // Pools of one brick are together, so that where two overlap the darker value is taken, which is that without either.
    work.sort_unstable();
    let groups: Vec<&[(usize, usize)]> = work.chunk_by(|a, b| a.0 == b.0).collect();
    let sharpened = Sharpened::new(scanner.blur_mm, NEIGHBOURHOOD_MM);
    let slabs = Slabs::new(volume.grid().spacing(), SLAB_MM);
    let spacing = volume.grid().spacing().to_array();
    let shared =
        Shared { volume, lumen, split, bricks, phi: Phi::new(), sharpened, slabs, inner: inner(scanner, spacing) };
    let mut brighter = Vec::new();
    if purpose == For::Reading {
        let beside = Beside::new(scanner.blur_mm, spacing);
        for (pool, runs) in pools.iter().zip(runs) {
            brighter.push(shared.brighter(beside, pool, runs, progress)?);
        }
    }
    let together = |group: &[(usize, usize)]| {
        progress.check()?;
        if let [(brick, pool)] = group {
            return Ok(shared.within(&pools[*pool], brighter.get(*pool), *brick));
        }
        let mut values: BTreeMap<usize, i16> = BTreeMap::new();
        for (brick, pool) in group {
            for (n, hu) in shared.within(&pools[*pool], brighter.get(*pool), *brick).each() {
                values.entry(n).and_modify(|v| *v = hu.min(*v)).or_insert(hu);
            }
        }
        Ok(Changes::from_sorted(values.into_iter()))
    };
    out.changed = groups.par_iter().map(|group| together(group)).collect::<Result<_>>()?;
    Ok(out)
}

/// Returns what of `near` is fluid clearly above the plane, where only gas should be, and what is clearly fluid; `None` if nothing is
/// above. The depth below the plane is given at a voxel, and grows by `slope` along a row.
fn risen(
    pool: &Pool,
    block: &Block,
    hu: &[f32],
    near: &Mask,
    depth_at: impl Fn([i64; 3]) -> f32,
    slope: f32,
) -> Option<[Mask; 2]> {
    let nx = block.dims[0];
    let mut above = near.clone();
    let (mut row, mut depth) = (usize::MAX, 0.0);
    above.keep_rows(|at| {
        let first = depth_at(block.voxel(at * nx));
        first.min(first + slope * nx as f32) < -RISEN
    });
    above.keep(|n| {
        if n / nx != row {
            row = n / nx;
            depth = depth_at(block.voxel(row * nx));
        }
        depth + slope * ((n - row * nx) as f32) < -RISEN
    });
    let bright = |mask: &mut Mask| {
        let mut tag_hu = vec![0f32; nx];
        let mut row = usize::MAX;
        mask.keep(|n| {
            if n / nx != row {
                row = n / nx;
                pool.tag.row(block.voxel(row * nx), &mut tag_hu);
            }
            hu[n] > TISSUE + RISEN_SHARE * (tag_hu[n - row * nx] - TISSUE).max(CONTRAST)
        });
    };
    bright(&mut above);
    if above.is_empty() {
        return None;
    }
    let mut fluid = near.clone();
    bright(&mut fluid);
    Some([above, fluid])
}

/// How far from fluid values are replaced, voxels.
fn reach(volume: &Volume) -> [usize; 3] {
    (REACH_MM / volume.grid().spacing()).floor().to_array().map(|r| (r as usize).clamp(1, MARGIN))
}

/// Returns the standard deviation of the neighbourhood, voxels.
fn neighbourhood(spacing: DVec3) -> [f64; 3] {
    (NEIGHBOURHOOD_MM / spacing).to_array()
}

/// Returns how far around a voxel values matter for it and its neighbours, voxels.
fn margin(spacing: DVec3) -> [usize; 3] {
    neighbourhood(spacing).map(|s| ((3.0 * s).ceil() as usize + 1).min(MARGIN))
}

/// How far within fluid no other material is seen, voxels.
fn inner(scanner: &Scanner, spacing: [f64; 3]) -> [usize; 3] {
    spacing.map(|h| ((1.6 * scanner.blur_mm / h).ceil() as usize).clamp(1, 6))
}

/// The top of a column of fluid: its voxel, and the values along it from four voxels above to six below, HU.
type Column = ([i64; 3], [f32; 11]);

/// Sums over a brick.
#[derive(Default)]
struct Sums {
    /// By cell: sum and count of gas, of pure tag, and of tissue beside it.
    gas: BTreeMap<[usize; 3], [f64; 2]>,
    tag: BTreeMap<[usize; 3], [f64; 2]>,
    tissue: BTreeMap<[usize; 3], [f64; 2]>,
    brightest: f32,
    columns: Vec<Column>,
}

type Survey = std::result::Result<(Pool, CleansedPool), Left>;

/// Finds the level of a pool and how bright it is.
fn survey(
    volume: &Volume,
    lumen: &Lumen,
    split: &Split,
    fluid: &Fluid,
    bricks: &Bricks,
    scanner: &Scanner,
    progress: &Progress,
) -> Result<Survey> {
    let grid = volume.grid();
    let voxels: usize = fluid.runs.iter().map(|r| r.2.len()).sum();
    let ml = voxels as f64 * grid.voxel_ml();
    let down = split.down;
    let inner = inner(scanner, grid.spacing().to_array());
    let away = (2.2 * scanner.blur_mm / grid.spacing()).ceil().to_array().map(|n| (n as usize).clamp(1, 6));
    let reach = reach(volume);
    let sums: Vec<Sums> = bricks
        .around(&fluid.runs, reach)
        .par_iter()
        .map(|&brick| {
            progress.check()?;
            let wide = bricks.block(brick, reach.map(|r| r.max(6)));
            let mask = wide.mask(lumen.fluid(), |n| split.labels[n] == Some(fluid.label));
            Ok(survey_brick(volume, &wide, &mask, down, bricks, [inner, away, reach]))
        })
        .collect::<Result<_>>()?;
    let mut all = Sums { brightest: f32::NEG_INFINITY, ..Sums::default() };
    for s in sums {
        for (to, from) in [(&mut all.gas, s.gas), (&mut all.tag, s.tag), (&mut all.tissue, s.tissue)] {
            // A cell is in one brick.
            to.extend(from);
        }
        all.brightest = all.brightest.max(s.brightest);
        all.columns.extend(s.columns);
    }
    let total = |sums: &BTreeMap<[usize; 3], [f64; 2]>| sums.values().fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
    let [sum, count] = total(&all.tag);
    let count_pure = count;
    let mean = if count >= 8.0 { sum / count } else { f64::from(all.brightest) };
    if mean < f64::from(TISSUE + CONTRAST) {
        return Ok(Err(Left { ml, why: FAINT }));
    }
    let [sum, count] = total(&all.gas);
    // Beside dense fluid gas is brighter than elsewhere.
    let gas = (sum + f64::from(GAS)) / (count + 1.0);
    let Some(level) = level(&all.columns, down, [gas as f32, mean as f32], grid.spacing()) else {
        return Ok(Err(Left { ml, why: NO_LEVEL }));
    };
    let cells = |sums: &BTreeMap<[usize; 3], [f64; 2]>| -> Vec<([usize; 3], f64, f64)> {
        sums.iter().map(|(cell, [sum, count])| (*cell, *sum, *count)).collect()
    };
    let pool = Pool {
        label: fluid.label,
        down,
        depth: level.normal,
        above: level.offset,
        blur_mm: level.blur_mm.unwrap_or(scanner.blur_mm),
        gas: CellMeans::new(bricks, &cells(&all.gas), gas, 4.0),
        tag: CellMeans::new(bricks, &cells(&all.tag), mean, 1e-3),
        pure: count_pure,
        tissue: CellMeans::new(bricks, &cells(&all.tissue), f64::from(TISSUE), 4.0),
    };
    // A point of the level in the middle of the pool.
    let n = fluid.runs.len() as f64;
    let middle = fluid.runs.iter().fold(DVec3::ZERO, |sum, (j, k, r)| {
        sum + DVec3::new(0.5 * (r.start + r.end - 1) as f64, *j as f64, *k as f64) / n
    });
    let mut at = middle;
    at[down.axis] -= (pool.depth.dot(middle) - pool.above) / pool.depth[down.axis];
    // The gradient of the depth, in the world, points down.
    let gradient = grid.direction() * (pool.depth / grid.spacing());
    let found = CleansedPool { ml, tag_hu: mean, level: [grid.world(at), -gradient.normalize()] };
    Ok(Ok((pool, found)))
}

fn survey_brick(
    volume: &Volume,
    block: &Block,
    mask: &Mask,
    down: AxisDirection,
    bricks: &Bricks,
    [inner, away, reach]: [[usize; 3]; 3],
) -> Sums {
    let hu = block.load(volume);
    let mut out = Sums { brightest: f32::NEG_INFINITY, ..Sums::default() };
    let pure = mask.eroded(inner);
    let (beside, near) = (mask.dilated(away), mask.dilated(reach));
    let strides = block.strides();
    let step = strides[down.axis] as i64 * down.sign;
    // The values do not change by much to any side.
    let is_even = |n: usize| (0..3).all(|a| (hu[n - strides[a]] - hu[n + strides[a]]).abs() < 120.0);
    near.each_own(|n, v| {
        let add = |sums: fn(&mut Sums) -> &mut BTreeMap<[usize; 3], [f64; 2]>, out: &mut Sums| {
            let cell = [0, 1, 2].map(|a| v[a] as usize / bricks.cell[a]);
            let s = sums(out).entry(cell).or_default();
            *s = [s[0] + f64::from(hu[n]), s[1] + 1.0];
        };
        if mask.has(n) {
            out.brightest = out.brightest.max(hu[n]);
            if !mask.has((n as i64 - step) as usize) {
                out.columns.push((v, std::array::from_fn(|m| hu[(n as i64 + (m as i64 - 4) * step) as usize])));
            }
        }
        if pure.has(n) {
            add(|s| &mut s.tag, &mut out);
        } else if !beside.has(n) && is_even(n) {
            // Out of the reach of the tag's blur.
            if TISSUES.contains(&hu[n]) {
                add(|s| &mut s.tissue, &mut out);
            } else if GASES.contains(&hu[n]) {
                add(|s| &mut s.gas, &mut out);
            }
        }
    });
    out
}

/// A level.
struct Level {
    /// The depth below it is `normal · voxel − offset`, in voxels along `down`.
    normal: DVec3,
    offset: f64,
    /// Blur across it, mm, if it is steep enough to tell.
    blur_mm: Option<f64>,
}

/// Fits a plane by least squares to where columns pass half-way from gas to fluid, with gas above and fluid below; columns off the
/// plane are left out. The blur is the median over what two voxels beside the plane tell: `spacing / (Φ⁻¹(share) − Φ⁻¹(share))`.
fn level(columns: &[Column], down: AxisDirection, [gas, tag]: [f32; 2], spacing: DVec3) -> Option<Level> {
    let half = 0.5 * (gas + tag);
    let mut found: Vec<([f64; 2], f64)> = Vec::new();
    let mut blurs: Vec<f64> = Vec::new();
    let [b, c] = [(down.axis + 1) % 3, (down.axis + 2) % 3];
    for (voxel, hu) in columns {
        let Some(m) = (3..8).find(|&m| hu[m] < half && hu[m + 1] >= half) else { continue };
        if hu[m - 2] > gas + 150.0 || hu[m + 3] < 0.7 * tag {
            continue;
        }
        let [t, u] = [m, m + 1].map(|m| {
            let share = f64::from((hu[m] - hu[m - 3]) / (hu[m + 3] - hu[m - 3]));
            normal::quantile(share.clamp(1e-3, 1.0 - 1e-3))
        });
        if t > -2.0 && u < 2.0 {
            blurs.push(spacing[down.axis] / (u - t).max(1e-3));
        }
        // On the edge's own curve, not on a chord of it.
        let share = if u > t { (-t / (u - t)).clamp(0.0, 1.0) } else { 0.5 };
        let at = (voxel[down.axis] * down.sign) as f64 + m as f64 - 4.0 + share;
        found.push(([voxel[b] as f64, voxel[c] as f64], at));
    }
    if found.len() < 6 {
        return None;
    }
    let mut sorted: Vec<f64> = found.iter().map(|f| f.1).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let most = LEVEL_MM / spacing[down.axis];
    let middle = found.iter().fold([0.0; 2], |s, f| [s[0] + f.0[0], s[1] + f.0[1]]).map(|s| s / found.len() as f64);
    let (mut offset, mut slope) = (sorted[sorted.len() / 2], [0.0; 2]);
    for _ in 0..3 {
        let plane = |p: &[f64; 2]| offset + slope[0] * (p[0] - middle[0]) + slope[1] * (p[1] - middle[1]);
        // At first a slope is not known: the columns near the middle of a sloped level are within the bounds.
        let near: Vec<_> = found.iter().filter(|(p, at)| (at - plane(p)).abs() < most).collect();
        if near.len() < 6 {
            break;
        }
        let (mut a, mut right) = (DMat3::ZERO, DVec3::ZERO);
        for (p, at) in &near {
            let x = DVec3::new(1.0, p[0] - middle[0], p[1] - middle[1]);
            a += DMat3::from_cols(x * x.x, x * x.y, x * x.z);
            right += x * *at;
        }
        // A level a few voxels wide keeps to the axis.
        let hold = HOLD * near.len() as f64;
        a += DMat3::from_diagonal(DVec3::new(0.0, hold, hold));
        if a.determinant().abs() < 1e-9 {
            break;
        }
        let fit = a.inverse() * right;
        (offset, slope) = (fit.x, [fit.y, fit.z]);
    }
    let mut normal = DVec3::ZERO;
    normal[down.axis] = down.sign as f64;
    normal[b] = -slope[0];
    normal[c] = -slope[1];
    blurs.sort_unstable_by(f64::total_cmp);
    let blur_mm = (blurs.len() >= 20).then(|| blurs[blurs.len() / 2].clamp(0.3 * spacing[down.axis], 3.0));
    Some(Level { normal, offset: offset - slope[0] * middle[0] - slope[1] * middle[1], blur_mm })
}

/// The data that all bricks share.
struct Shared<'a> {
    volume: &'a Volume,
    lumen: &'a Lumen,
    split: &'a Split,
    bricks: Bricks,
    phi: Phi,
    sharpened: Sharpened,
    slabs: Slabs,
    /// How far within fluid no other material is seen, voxels.
    inner: [usize; 3],
}

impl Shared<'_> {
    /// Returns the new values of one brick around one pool.
    fn within(&self, pool: &Pool, brighter: Option<&Brighter>, brick: usize) -> Changes {
        let grid = self.volume.grid();
        let spacing = grid.spacing();
        let wide = self.bricks.block(brick, reach(self.volume).map(|r| (2 * r).min(MARGIN)));
        let mask = wide.mask(self.lumen.fluid(), |n| self.split.labels[n] == Some(pool.label));
        let s = neighbourhood(spacing);
        let around = margin(spacing);
        let block = self.bricks.block(brick, around);
        let per_sigma = (spacing[pool.down.axis] / pool.blur_mm) as f32;
        // The depth along a row is linear.
        let depth_at = |v: [i64; 3]| pool.depth_at(v) * per_sigma;
        let slope = pool.depth.x as f32 * per_sigma;
        let mut changed: Vec<(usize, i16)> = Vec::new();
        let index = |v: [i64; 3]| grid.index(v[0] as usize, v[1] as usize, v[2] as usize);
        // Nothing but fluid, without gas near.
        if mask.is_full() {
            let mut dark = vec![0f32; wide.dims[0]];
            let mut row = [i64::MIN; 2];
            wide.each_own(|n, v| {
                if row != [v[1], v[2]] {
                    pool.gas.row(wide.voxel(n - n % wide.dims[0]), &mut dark);
                    row = [v[1], v[2]];
                }
                changed.push((index(v), dark[n % wide.dims[0]].round() as i16));
            });
            return Changes::from_sorted(changed.into_iter());
        }
        let wide_hu = wide.load(self.volume);
        let near = self.downhill(&wide, &wide_hu, &mask);
        let asked = near.own();
        if asked.is_empty() {
            return Changes::default();
        }
        let block = block.part_around(&asked, around);
        let nx = block.dims[0];
        let hu = block.load(self.volume);
        let mut product = vec![0f32; block.len()];
        let mut square = vec![0f32; block.len()];
        let mut mixed = vec![0f32; block.len()];
        let mut own = vec![0f32; block.len()];
        let mut dark = vec![0f32; block.len()];
        let mut tag = vec![0f32; block.len()];
        let risen = risen(pool, &wide, &wide_hu, &near, depth_at, slope).map_or_else(Risen::none, |[risen, fluid]| {
            let gas = wide.mask(self.lumen.gas(), |_| true);
            let materials = |v: [i64; 3], [dark, tag]: [&mut [f32]; 2]| {
                pool.gas.row(v, dark);
                pool.tag.row(v, tag);
            };
            Risen::new([&risen, &fluid, &gas], &wide_hu, [&wide, &block], spacing / pool.blur_mm, materials)
        });
        let brighter = brighter.map(|b| b.around(&self.bricks, &block));
        // Rows whose neighbourhoods hold nothing that is asked for stay empty.
        let needed = block.rows_around(&near, around);
        for from in (0..block.len()).step_by(nx).filter(|from| needed[from / nx]) {
            let v = block.voxel(from);
            let row = from..from + nx;
            pool.gas.row(v, &mut dark[row.clone()]);
            pool.tissue.row(v, &mut own[row.clone()]);
            pool.tag.row(v, &mut tag[row.clone()]);
            let level = depth_at(v);
            for (x, n) in row.enumerate() {
                let more = brighter.as_ref().map_or(0.0, |b| b[n]);
                tag[n] = (tag[n] + more).max(TISSUE + CONTRAST);
                own[n] = own[n].clamp(TISSUE - 20.0, TISSUE + 150.0).min(tag[n] - 0.5 * CONTRAST);
                let depth = risen.get(n).unwrap_or(level + slope * x as f32);
                mixed[n] = dark[n] + (tag[n] - dark[n]) * self.phi.at(depth)[0];
                let contrast = own[n] - mixed[n];
                product[n] = contrast * (hu[n] - mixed[n]);
                square[n] = contrast * contrast;
            }
        }
        block.blur(&mut product, s);
        block.blur(&mut square, s);
        let mut share = product;
        share.iter_mut().zip(&square).for_each(|(p, square)| *p /= square.max(1.0));
        let mut open = wide.mask(self.lumen.fluid(), |_| true);
        open.add(&wide.mask(self.lumen.gas(), |_| true));
        near.each_own(|at, v| {
            // Above the blur of the level the scan is as it should be.
            let n = block.index(v);
            let depth = risen.get(n).unwrap_or_else(|| depth_at(v));
            let ours = step(-3.5, -2.0, depth);
            if ours == 0.0 {
                return;
            }
            // At a level an edge of gas and tag is curved as well.
            let below = if brighter.is_some() { step(2.0, DEEP, depth) } else { 0.0 };
            let curved = if below > 0.0 { below * straightened(&share, n, block.strides(), spacing) } else { 0.0 };
            let p = self.sharpened.at(share[n] + curved);
            let clean = dark[n] + (TISSUE - dark[n]) * p;
            // Tissue keeps its own texture. What is brighter is fluid that climbs the wall.
            let rest = (hu[n] - (own[n] * p + mixed[n] * (1.0 - p))).min(TEXTURE);
            let clean = clean + rest * step(0.9, 1.0, p);
            let clean = (hu[n] + (clean - hu[n]) * ours).round() as i16;
            let was_wall = depth > DEEP && hu[n] > f32::from(WALL_HU) && !open.has(at);
            // As bright as the tag here, it is no wall however dark.
            let is_tag = brighter.is_some() && tag[n] - hu[n] < TAG_SHARE * (tag[n] - own[n]);
            let is_thin = was_wall && clean < SOLID_HU && !is_tag && self.slabs.is_within(&wide, &open, at);
            changed.push((index(v), if is_thin { SOLID_HU } else { clean }));
        });
        Changes::from_sorted(changed.into_iter())
    }

    /// Returns by how much a pool's tag is brighter around each voxel than its mean.
    fn brighter(&self, beside: Beside, pool: &Pool, runs: &[Place], progress: &Progress) -> Result<Brighter> {
        let (margin, reach) = (margin(self.volume.grid().spacing()), reach(self.volume));
        let bricks = self.bricks.around(runs, [0, 1, 2].map(|a| margin[a] + reach[a]));
        let around = beside.reach().map(|r| r.min(MARGIN));
        Brighter::find(&self.bricks, &bricks, around, |wide| {
            progress.check()?;
            Ok(self.brighter_within(beside, pool, wide))
        })
    }

    /// Returns by how much a pool's tag is brighter around each voxel of a block than its mean, HU; exact where the block goes on around
    /// it.
    fn brighter_within(&self, beside: Beside, pool: &Pool, wide: &Block) -> Vec<f32> {
        let per_sigma = (self.volume.grid().spacing()[pool.down.axis] / pool.blur_mm) as f32;
        let of_pool = |block: &Block| block.mask(self.lumen.fluid(), |n| self.split.labels[n] == Some(pool.label));
        let fluid = of_pool(wide);
        let mut out = vec![0.0; wide.len()];
        if fluid.is_empty() {
            return out;
        }
        // Farther from the fluid nothing is found, and nothing there matters for what is found.
        let (added, seen) = (reach(self.volume), beside.reach());
        let block = &wide.part_around(&fluid, [0, 1, 2].map(|a| added[a] + 1 + seen[a].max(self.inner[a])));
        let mut fluid = of_pool(block);
        let nx = block.dims[0];
        let scan = block.load(self.volume);
        let hu = beside.smooth(block, scan.clone());
        // Some of the tag may be too faint for the lumen; what is so bright along an edge alone is not.
        let mut faint = fluid.dilated(reach(self.volume));
        let (mut own, mut row) = (vec![0f32; nx], usize::MAX);
        faint.keep(|n| {
            if fluid.has(n) || hu[n] < TISSUE + CONTRAST {
                return false;
            }
            if n / nx != row {
                row = n / nx;
                pool.tissue.row(block.voxel(row * nx), &mut own);
            }
            hu[n] > own[n % nx] + CONTRAST
        });
        faint = faint.eroded([1; 3]);
        if !faint.is_empty() {
            let near = self.downhill(block, &scan, &fluid);
            faint.keep_in(&near);
            fluid.add(&faint.dilated([1; 3]));
        }
        let mut usual = vec![0f32; block.len()];
        let needed = block.rows_around(&fluid, beside.reach());
        for row in (0..needed.len()).filter(|row| needed[*row]) {
            pool.tag.row(block.voxel(row * nx), &mut usual[row * nx..(row + 1) * nx]);
        }
        let mut deep = fluid.clone();
        deep.keep(|n| pool.depth_at(block.voxel(n)) * per_sigma > DEEP);
        let mut pure = fluid.eroded(self.inner);
        pure.keep_in(&deep);
        let found = beside.brighter(block, &hu, &usual, [&fluid, &deep, &pure]);
        for (n, row) in found.chunks_exact(nx).enumerate() {
            let at = wide.index(block.voxel(n * nx));
            out[at..at + nx].copy_from_slice(row);
        }
        out
    }

    /// Returns what lies around fluid: the voxels within reach to which values never rise on the way, but for texture. What rises
    /// again behind the wall is other bowel. No way is longer than the block's margin, so that it is the same in every brick.
    fn downhill(&self, block: &Block, hu: &[f32], mask: &Mask) -> Mask {
        let within = mask.dilated(reach(self.volume));
        let mut near = mask.clone();
        // By row and x.
        let mut open: Vec<(usize, usize)> = Vec::new();
        // Around the others there is nothing but fluid.
        let inner = mask.eroded([1; 3]);
        for (row, (all, inner)) in mask.rows.iter().zip(&inner.rows).enumerate() {
            each_bit(all & !inner, |x| open.push((row, x)));
        }
        let [nx, ny, nz] = block.dims;
        let longest = reach(self.volume).map(|r| (2 * r).min(MARGIN)).into_iter().min().unwrap_or(0);
        for _ in 0..longest {
            let mut next = Vec::new();
            for (row, x) in open {
                let most = (hu[row * nx + x] + 0.5 * TEXTURE).max(TISSUE + TEXTURE);
                let mut visit = |row: usize, x: usize| {
                    let is_new = (within.rows[row] & !near.rows[row]) >> x & 1 == 1;
                    if is_new && hu[row * nx + x] <= most {
                        near.rows[row] |= 1 << x;
                        next.push((row, x));
                    }
                };
                let y = row % ny;
                if x > 0 {
                    visit(row, x - 1);
                }
                if x + 1 < nx {
                    visit(row, x + 1);
                }
                if y > 0 {
                    visit(row - 1, x);
                }
                if y + 1 < ny {
                    visit(row + 1, x);
                }
                if row >= ny {
                    visit(row - ny, x);
                }
                if row + ny < ny * nz {
                    visit(row + ny, x);
                }
            }
            open = next;
        }
        // A voxel that noise brightens does not belong to another bowel: at least five of the six beside it are near.
        let beside =
            |row: usize, is_in: bool, off: isize| if is_in { near.rows[row.wrapping_add_signed(off)] } else { 0 };
        let alone = |row: usize| {
            let (own, y, plane) = (near.rows[row], row % ny, ny as isize);
            let around = [
                own << 1,
                own >> 1,
                beside(row, y > 0, -1),
                beside(row, y + 1 < ny, 1),
                beside(row, row >= ny, -plane),
                beside(row, row + ny < ny * nz, plane),
            ];
            let (mut one, mut more) = (0, 0);
            for there in around {
                more |= one & !there;
                one |= !there;
            }
            within.rows[row] & !own & !more
        };
        let alone: Vec<u64> = (0..ny * nz).map(alone).collect();
        near.rows.iter_mut().zip(alone).for_each(|(row, alone)| *row |= alone);
        near
    }
}

/// Returns what the blur of the neighbourhood has taken from the tissue's share `p` at the index `n` of a block because the wall is curved:
/// a Gaussian of variance s² adds `s²/2 ∇²p` to first order, of which `s²/2 (∇²p − ∂²p/∂n²)`, along the wall, moves an edge of curvature κ by
/// `s² κ / 2`, while the rest only widens it.
fn straightened(p: &[f32], n: usize, strides: [usize; 3], spacing: DVec3) -> f32 {
    if !(0.01..0.99).contains(&p[n]) {
        return 0.0;
    }
    // Derivatives along some axes, each with the weights 1, 2, 1 along the others, which takes most of the noise.
    const WEIGHTS: [[f32; 3]; 3] = [[0.25, 0.5, 0.25], [-0.5, 0.0, 0.5], [1.0, -2.0, 1.0]];
    let h = spacing.as_vec3();
    let orders = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [2, 0, 0], [0, 2, 0], [0, 0, 2]];
    let crossed = [[1, 1, 0], [0, 1, 1], [1, 0, 1]];
    let mut found = [0f32; 9];
    for (z, plane) in (0..3).map(|z| (z, n + z * strides[2] - strides[2])) {
        for (y, row) in (0..3).map(|y| (y, plane + y * strides[1] - strides[1])) {
            let line = &p[row - 1..row + 2];
            let along: [f32; 3] = WEIGHTS.map(|w| w[0] * line[0] + w[1] * line[1] + w[2] * line[2]);
            for (found, [i, j, k]) in found.iter_mut().zip(orders.into_iter().chain(crossed)) {
                *found += along[i] * WEIGHTS[j][y] * WEIGHTS[k][z];
            }
        }
    }
    let [x, y, z, xx, yy, zz, xy, yz, zx] = found;
    let slope = Vec3::new(x, y, z) / h;
    let second = Vec3::new(xx, yy, zz) / (h * h);
    let mixed = Vec3::new(xy / (h.x * h.y), yz / (h.y * h.z), zx / (h.z * h.x));
    let square = slope.length_squared();
    if square < 1e-4 {
        return 0.0;
    }
    let across = second.dot(slope * slope) + 2.0 * mixed.dot(slope * Vec3::new(slope.y, slope.z, slope.x));
    let along = second.element_sum() - across / square;
    (-0.5 * (NEIGHBOURHOOD_MM * NEIGHBOURHOOD_MM) as f32 * along).clamp(-STRAIGHTENED, STRAIGHTENED)
}

/// A table of `Φ(√(1 + s²/σ²) Φ⁻¹(p))`.
struct Sharpened(Vec<f32>);

impl Sharpened {
    const STEPS: usize = 1024;

    fn new(sigma: f64, neighbourhood: f64) -> Self {
        let factor = (1.0 + (neighbourhood / sigma).powi(2)).sqrt();
        let at = |n: usize| normal::cdf(factor * normal::quantile(n as f64 / Self::STEPS as f64)) as f32;
        Self((0..=Self::STEPS).map(at).collect())
    }

    fn at(&self, p: f32) -> f32 {
        let x = p.clamp(0.0, 1.0) * Self::STEPS as f32;
        let n = (x as usize).min(Self::STEPS - 1);
        let t = x - n as f32;
        self.0[n] + (self.0[n + 1] - self.0[n]) * t
    }
}
