//! Films and stool: tag that clings to the wall above any level.
//!
//! Residue is bright, begins right at the colon's gas without tissue between, and does not continue into bone or other bowel.
//! Around it, each voxel is examined along the normal of the gas, and [`layer`](super::layer) finds where gas ends and tissue
//! begins there.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::f64::consts::TAU;
use std::ops::Range;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::block::{Block, Bricks, CellMeans, Mask};
use super::changes::Changes;
use super::layer::{self, Fitter, Materials, SAMPLES};
use super::model::Left;
use super::slab::Slabs;
use super::{Scanner, TISSUE, step};
use crate::error::Result;
use crate::fields::Lumen;
use crate::fields::lumen::frame::AxisDirection;
use crate::fields::lumen::runs::{Rows, Run};
use crate::math::normal;
use crate::progress::Progress;
use crate::volume::Volume;

/// Minimum value of tag, HU: above muscle, organs and most vessels.
const BRIGHT: i16 = 180;
/// Maximum distance of tag from gas, σ: farther away, a wall would lie between them.
const EDGE: f64 = 3.4;
/// Maximum extent of residue from there, mm.
const FAR_MM: f64 = 18.0;
/// Maximum share of the voxels of a piece at that distance: with more, it is something else that touches the colon.
const FAR_SHARE: f64 = 0.1;
/// Volume of the largest piece, ml, and of the smallest, mm³: anything less is noise.
const MOST_ML: f64 = 20.0;
const LEAST_MM3: f64 = 4.0;
/// Minimum mean value of the brightest fifth of a piece, HU: walls with contrast agent, and noise, stay below.
const SURE_HU: f64 = 250.0;
/// A fainter piece above this value is tag, too, if this share of its voxels is inside: noise is never as solid.
const LIKELY_HU: f64 = 222.0;
const SOLID_SHARE: f64 = 0.02;
/// Distance from residue up to which values are examined along each axis, mm (less than 5 mm along a diagonal), and up to which
/// they are replaced: an edge of tag is never wider.
const REACH_MM: f64 = 2.85;
const CLOSE_MM: f64 = 1.35;
/// Standard deviation of the blur of the field whose gradient is the normal, mm.
const NORMAL_MM: f64 = 0.7;
/// Thickness below which a layer is left, and above which it is removed, σ.
const THIN: [f32; 2] = [0.12, 0.4];
/// Root mean square residual of a layer's fit beyond which the fit is unsure: a share of the tag's contrast, and HU.
const UNSURE: f32 = 0.12;
const UNSURE_HU: f32 = 60.0;
/// A voxel that exceeds tissue by less than the first may be tissue; by more than the second, it is tag, however unsure the fit,
/// HU.
const BRIGHTER: [f32; 2] = [100.0, 300.0];
/// Where nothing is as bright as this share of the tag in pools, it is wall with contrast agent, or brightened by tag beside it; and in a
/// scan without pools, HU.
const LIKE_POOLS: f64 = 0.6;
const LIKE_TAG: f64 = 280.0;
/// But what is as bright at this distance to nearly all sides is a lump of tag, mm; of fourteen sides so many may have bubbles.
const THICK_MM: f64 = 2.4;
const THICK_HU: f64 = 200.0;
const BUBBLES: usize = 3;
/// Values of gas, HU.
const GAS_LEAST: f32 = -1010.0;
const GAS_MOST: f32 = -820.0;
/// Tag is clearly brighter than tissue by this share of its contrast, and HU.
const CLEAR: f32 = 0.3;
const CLEAR_HU: f32 = 110.0;
/// Minimum value of tissue, HU: anything darker is an edge of gas.
const DARK: f32 = -150.0;
/// Thickness between gas and gas below which something may be a wall with a film on it, mm.
const SLAB_MM: f64 = 7.0;
/// There it is tag alone if all its edges are at least this steep, relative to one from gas to tag: a wall of 2σ between gas and tag
/// leaves 0.6. They are looked at where they exceed tissue by this share of the tag's contrast, so that a wall within tag shows as well.
const STEEP: f64 = 0.7;
const EDGE_SHARE: f32 = 0.3;
/// A fold thinner than the blur under two coats shows no dip, and its edges are as steep: tag is sure only if it is thicker than this, mm,
/// and nothing within the next distance of it, mm, is a wall. What lies around such tag, up to the last, mm, is the rim of the same lump.
const LUMP_MM: f64 = 3.5;
const APART_MM: f64 = 0.8;
const RIM_MM: f64 = 2.5;
/// Maximum distance to tag on both sides at which something is a bubble in tag, or the skin of one, mm.
const GAP_MM: f64 = 1.5;
/// Reason why residue was left.
const FAINT: &str = "hardly brighter than a wall with contrast agent";
/// Maximum margin of a block, voxels, so that its rows fit into words.
const MARGIN: usize = (Mask::ROW - 32) / 2;

/// A bit for each voxel of a grid.
#[derive(Clone, Debug)]
pub(super) struct Bits(Vec<u64>);

impl Bits {
    pub(super) fn new(count: usize) -> Self {
        Self(vec![0; count.div_ceil(64)])
    }

    pub(super) fn has(&self, n: usize) -> bool {
        self.0[n / 64] >> (n % 64) & 1 == 1
    }

    /// Adds a voxel; returns false if it was there.
    pub(super) fn add(&mut self, n: usize) -> bool {
        let (word, bit) = (&mut self.0[n / 64], 1 << (n % 64));
        let is_new = *word & bit == 0;
        *word |= bit;
        is_new
    }

    pub(super) fn clear(&mut self) {
        self.0.fill(0);
    }

    pub(super) fn fill(&mut self, voxels: Range<usize>) {
        let mut from = voxels.start;
        while from < voxels.end {
            // A word at a time.
            let end = voxels.end.min(from / 64 * 64 + 64);
            self.0[from / 64] |= u64::MAX >> (64 - (end - from)) << (from % 64);
            from = end;
        }
    }
}

/// The films and the stool of a scan.
#[derive(Default)]
pub(super) struct Residue {
    /// Their volume, ml.
    pub ml: f64,
    /// New values, brick by brick, and the values of what was looked at and left.
    pub changed: Vec<Changes>,
    pub looked_at: Vec<Changes>,
    pub left: Vec<Left>,
}

/// Removes films and stool. Voxels of `taken` belong to pools, whose tag is as bright as `usual`, HU; infinite if there are none.
pub(super) fn cleanse(
    volume: &Volume,
    lumen: &Lumen,
    taken: &Bits,
    usual: f64,
    scanner: &Scanner,
    progress: &Progress,
) -> Result<Residue> {
    let mut out = Residue::default();
    let seeds = seeds(volume, lumen, taken, scanner, progress)?;
    if seeds.is_empty() {
        return Ok(out);
    }
    let grid = volume.grid();
    let mut voxels = pieces(volume, taken, &seeds, &mut out.left, progress)?;
    let bricks = Bricks::of(grid);
    let tag = brightness(volume, &voxels, &bricks);
    let least = if usual.is_finite() { LIKE_POOLS * usual } else { LIKE_TAG };
    let [nx, ny, _] = grid.dims();
    let all = voxels.len();
    let thick = thick(volume, &voxels, &bricks);
    voxels.retain(|n| {
        let at = [n % nx, n / nx % ny, n / nx / ny];
        let mut here = [0.0];
        tag.row(at.map(|c| c as i64), &mut here);
        f64::from(here[0]) > least || thick.contains(&[0, 1, 2].map(|a| at[a] / bricks.cell[a]))
    });
    if voxels.len() < all {
        out.left.push(Left { ml: (all - voxels.len()) as f64 * grid.voxel_ml(), why: FAINT });
    }
    if voxels.is_empty() {
        return Ok(out);
    }
    out.ml = voxels.len() as f64 * grid.voxel_ml();
    let rows = rows(grid.dims(), &voxels)?;
    let runs: Vec<_> = rows.iter().map(|(j, k, r)| (j, k, r.range())).collect();
    let reach = (REACH_MM / grid.spacing()).floor().to_array().map(|r| (r as usize).clamp(1, MARGIN));
    let work = bricks.around(&runs, reach);
    let voxels_within = |mm: f64| (mm / grid.spacing()).round().to_array().map(|r| (r as usize).clamp(1, MARGIN));
    let close = voxels_within(CLOSE_MM);
    let gap = (GAP_MM / grid.spacing()).round().to_array().map(|r| (r as usize).min(MARGIN / 2));
    let shared = Shared {
        volume,
        rows,
        lumen,
        slabs: Slabs::new(grid.spacing(), SLAB_MM),
        bricks,
        tag,
        reach,
        gap,
        close,
        apart: voxels_within(APART_MM),
        rim: voxels_within(RIM_MM),
        sigma: scanner.blur_mm,
        gas: scanner.gas_hu,
        fitter: Fitter::new(),
    };
    let parts = work.par_iter().map(|&brick| {
        progress.check()?;
        Ok(shared.within(brick, taken))
    });
    (out.changed, out.looked_at) = parts.collect::<Result<Vec<_>>>()?.into_iter().unzip();
    Ok(out)
}

/// Returns bright voxels right beyond gas (linear indices), ascending.
fn seeds(volume: &Volume, lumen: &Lumen, taken: &Bits, scanner: &Scanner, progress: &Progress) -> Result<Vec<usize>> {
    let grid = volume.grid();
    let [_, ny, nz] = grid.dims();
    let gas = lumen.gas();
    if gas.runs().is_empty() {
        return Ok(Vec::new());
    }
    let directions = [0, 1, 2].map(|axis| [-1, 1].map(|sign| AxisDirection { axis, sign }));
    let found: Vec<Vec<usize>> = (0..nz)
        .into_par_iter()
        .map(|k| {
            progress.check()?;
            let mut out = Vec::new();
            for j in 0..ny {
                for &run in gas.row(j, k) {
                    for direction in directions.as_flattened() {
                        let far = (EDGE * scanner.blur_mm / grid.spacing()[direction.axis]).ceil().max(2.0) as i64;
                        let step = direction.step();
                        gas.beyond(run, j, k, *direction, |at| {
                            let mut before = i16::MIN;
                            for m in 0..far {
                                let [i, j, k] = [0, 1, 2].map(|a| at[a] + m * step[a]);
                                let hu = volume.get(i, j, k);
                                // Values only rise from gas to tag.
                                if hu < before {
                                    return;
                                }
                                if hu > BRIGHT {
                                    let n = grid.index(i as usize, j as usize, k as usize);
                                    if !taken.has(n) {
                                        out.push(n);
                                    }
                                    return;
                                }
                                before = hu.saturating_sub(30);
                            }
                        });
                    }
                }
            }
            Ok(out)
        })
        .collect::<Result<_>>()?;
    let mut all = found.concat();
    all.sort_unstable();
    all.dedup();
    Ok(all)
}

/// Returns the voxels of all pieces that are tag (linear indices), ascending.
fn pieces(
    volume: &Volume,
    taken: &Bits,
    seeds: &[usize],
    left: &mut Vec<Left>,
    progress: &Progress,
) -> Result<Vec<usize>> {
    let grid = volume.grid();
    let (dims, spacing) = (grid.dims(), grid.spacing());
    let strides = [1, dims[0], dims[0] * dims[1]];
    let most = (MOST_ML / grid.voxel_ml()) as usize;
    let mut is_seed = Bits::new(grid.len());
    seeds.iter().for_each(|&n| is_seed.fill(n..n + 1));
    let mut seen = Bits::new(grid.len());
    let mut out = Vec::new();
    let (mut leads_on, mut large, mut faint) = (0, 0, 0);
    for &seed in seeds {
        if !seen.add(seed) {
            continue;
        }
        progress.check()?;
        // All of one piece, each voxel with its way from the nearest seed.
        let mut piece = vec![seed];
        let mut open = VecDeque::from([(seed, 0.0)]);
        let mut far = 0;
        while let Some((n, way)) = open.pop_front() {
            let at = [n % dims[0], n / dims[0] % dims[1], n / strides[2]];
            for a in 0..3 {
                for m in [(at[a] > 0).then(|| n - strides[a]), (at[a] + 1 < dims[a]).then(|| n + strides[a])] {
                    let Some(m) = m.filter(|&m| volume.data()[m] > BRIGHT && !taken.has(m)) else { continue };
                    let way = if is_seed.has(m) { 0.0 } else { way + spacing[a] };
                    if way > FAR_MM {
                        far += 1;
                    } else if seen.add(m) {
                        piece.push(m);
                        if way == 0.0 { open.push_front((m, way)) } else { open.push_back((m, way)) }
                    }
                }
            }
            if piece.len() > 20 * most {
                break;
            }
        }
        if piece.len() > most {
            large += piece.len();
        } else if f64::from(far) > FAR_SHARE * piece.len() as f64 {
            leads_on += piece.len();
        } else if piece.len() as f64 * 1e3 * grid.voxel_ml() >= LEAST_MM3 {
            let mut hu: Vec<i16> = piece.iter().map(|&n| volume.data()[n]).collect();
            hu.sort_unstable();
            let fifth = &hu[hu.len() * 4 / 5..];
            let brightest = fifth.iter().map(|&h| f64::from(h)).sum::<f64>() / fifth.len() as f64;
            let is_inner = |&&n: &&usize| {
                let at = [n % dims[0], n / dims[0] % dims[1], n / strides[2]];
                (0..3).all(|a| at[a] > 0 && at[a] + 1 < dims[a] && seen.has(n - strides[a]) && seen.has(n + strides[a]))
            };
            let is_solid = || piece.iter().filter(is_inner).count() as f64 > SOLID_SHARE * piece.len() as f64;
            if brightest > SURE_HU || brightest > LIKELY_HU && is_solid() {
                out.append(&mut piece);
            } else {
                faint += piece.len();
            }
        }
    }
    for (count, why) in [
        (leads_on, "bright, and continues beyond the wall"),
        (large, "bright, and too large for residue"),
        (faint, FAINT),
    ] {
        if count > 0 {
            left.push(Left { ml: count as f64 * grid.voxel_ml(), why });
        }
    }
    out.sort_unstable();
    Ok(out)
}

/// Returns the voxels as rows of runs.
fn rows(dims: [usize; 3], voxels: &[usize]) -> Result<Rows> {
    let mut slices: Vec<(Vec<u32>, Vec<Run>)> = vec![(vec![0; dims[1]], Vec::new()); dims[2]];
    for &n in voxels {
        let [i, j, k] = [n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1]].map(|c| c as u32);
        let (lengths, runs) = &mut slices[k as usize];
        match runs.last_mut() {
            Some(run) if run.end == i && lengths[j as usize] > 0 => run.end += 1,
            _ => {
                lengths[j as usize] += 1;
                runs.push(Run { start: i, end: i + 1, label: 0 });
            }
        }
    }
    Rows::from_slices(dims, slices)
}

/// Returns the cells within a lump of tag and up to two cells around it. A wall, with a contrast agent or brightened by tag, is never as
/// thick: tag is where nearly all of fourteen points at the distance [`THICK_MM`] are bright, too, and together clearly so.
fn thick(volume: &Volume, voxels: &[usize], bricks: &Bricks) -> BTreeSet<[usize; 3]> {
    let (dims, spacing) = (volume.grid().dims(), volume.grid().spacing());
    let along = (0..3).flat_map(|a| [-1.0, 1.0].map(|s| s * DVec3::AXES[a]));
    let across =
        (0..8).map(|n| DVec3::from_array([0, 1, 2].map(|a| if n >> a & 1 == 0 { 1.0 } else { -1.0 })).normalize());
    let around: Vec<[i64; 3]> =
        along.chain(across).map(|d| (d * THICK_MM / spacing).round().to_array().map(|c| c as i64)).collect();
    let is_core = |at: [usize; 3]| {
        let hu = around.iter().map(|d| {
            let [i, j, k] = [0, 1, 2].map(|a| (at[a] as i64 + d[a]).clamp(0, dims[a] as i64 - 1));
            f64::from(volume.get(i, j, k))
        });
        let (count, sum) = hu.filter(|hu| *hu > f64::from(BRIGHT)).fold((0, 0.0), |(n, sum), hu| (n + 1, sum + hu));
        count + BUBBLES >= around.len() && sum > THICK_HU * count as f64
    };
    let place = |n: usize| [n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1]];
    let cores: Vec<[usize; 3]> = voxels.par_iter().map(|n| place(*n)).filter(|at| is_core(*at)).collect();
    let cells: BTreeSet<[usize; 3]> = cores.iter().map(|at| [0, 1, 2].map(|a| at[a] / bricks.cell[a])).collect();
    let near = |c: usize| c.saturating_sub(2)..=c + 2;
    let beside =
        |&[x, y, z]: &[usize; 3]| near(z).flat_map(move |z| near(y).flat_map(move |y| near(x).map(move |x| [x, y, z])));
    cells.iter().flat_map(beside).collect()
}

/// Returns how bright pure tag is around each place: the brightest within a cell or beside it.
fn brightness(volume: &Volume, voxels: &[usize], bricks: &Bricks) -> CellMeans {
    let dims = volume.grid().dims();
    let mut most: BTreeMap<[usize; 3], f64> = BTreeMap::new();
    for &n in voxels {
        let at = [n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1]];
        let cell = [0, 1, 2].map(|a| at[a] / bricks.cell[a]);
        let hu = f64::from(volume.data()[n]);
        most.entry(cell).and_modify(|m| *m = hu.max(*m)).or_insert(hu);
    }
    let around = |cell: &[usize; 3]| {
        let near = |a: usize| cell[a].saturating_sub(1)..=cell[a] + 1;
        let mut brightest = f64::from(BRIGHT);
        for z in near(2) {
            for y in near(1) {
                for (_, hu) in
                    most.range([*near(0).start(), y, z]..=[*near(0).end(), y, z]).filter(|c| c.0[1..] == [y, z])
                {
                    brightest = brightest.max(*hu);
                }
            }
        }
        brightest
    };
    let sums: Vec<_> = most.keys().map(|cell| (*cell, around(cell), 1.0)).collect();
    let mean = sums.iter().map(|s| s.1).sum::<f64>() / sums.len().max(1) as f64;
    CellMeans::new(bricks, &sums, mean, 1e-3)
}

/// What all bricks share.
struct Shared<'a> {
    volume: &'a Volume,
    rows: Rows,
    lumen: &'a Lumen,
    slabs: Slabs,
    bricks: Bricks,
    tag: CellMeans,
    reach: [usize; 3],
    gap: [usize; 3],
    close: [usize; 3],
    apart: [usize; 3],
    rim: [usize; 3],
    /// Blur of the scan, mm, and HU of its gas.
    sigma: f64,
    gas: f32,
    fitter: Fitter,
}

impl Shared<'_> {
    /// Returns the new values of one brick, and the values of what was looked at and left.
    fn within(&self, brick: usize, taken: &Bits) -> (Changes, Changes) {
        let grid = self.volume.grid();
        let spacing = grid.spacing();
        let line = f64::from(layer::place(SAMPLES - 1).max(-layer::place(0))) * self.sigma;
        let margin = (line.max(3.0 * NORMAL_MM + spacing.max_element()) / spacing + 1.0).ceil();
        let margin = [0, 1, 2].map(|a| (margin[a] as usize).clamp(self.reach[a], MARGIN));
        let block = self.bricks.block(brick, margin);
        let piece = block.mask(&self.rows, |_| true);
        let near = piece.dilated(self.reach);
        let enclosed = piece.dilated(self.gap).eroded(self.gap);
        let hu = block.load(self.volume);
        let mut tag = vec![0f32; block.len()];
        let mut field = vec![0f32; block.len()];
        for from in (0..block.len()).step_by(block.dims[0]) {
            self.tag.row(block.voxel(from), &mut tag[from..from + block.dims[0]]);
        }
        // Only what is clearly tag is removed, with its edges: one towards tissue is steep, one towards gas half as steep.
        let mut clear = piece;
        clear.keep(|n| hu[n] > TISSUE + (CLEAR * (tag[n] - TISSUE)).max(CLEAR_HU));
        let (beside, around) = (clear.dilated([1; 3]), clear.dilated(self.close));
        // Rises from gas to anything else, and, less so, from tag to tissue.
        for ((field, hu), tag) in field.iter_mut().zip(&hu).zip(&tag) {
            let (low, high) = (hu.clamp(self.gas, TISSUE), hu.clamp(TISSUE, *tag));
            *field = 3.0 * low / (TISSUE - self.gas) - high / (tag - TISSUE).max(1.0);
        }
        block.blur(&mut field, [0, 1, 2].map(|a| NORMAL_MM / spacing[a]));
        let strides = block.strides();
        let per_voxel = (self.sigma / spacing).as_vec3();
        let gas = block.mask(self.lumen.gas(), |_| true);
        // What may be replaced, and around it as far as it decides on it.
        let mut asked = near.clone();
        asked.keep_in(&around);
        asked.keep_within(&[0, 1, 2].map(|a| {
            let rim = block.margin[a] - (self.rim[a] + self.apart[a]).min(block.margin[a]);
            rim..block.dims[a] - rim
        }));
        let [lump, slab] = self.lumps(&block, &asked, &gas, &hu, &tag);
        let (mut changed, mut looked_at) = (Vec::new(), Vec::new());
        near.each_own(|n, v| {
            let index = grid.index(v[0] as usize, v[1] as usize, v[2] as usize);
            if taken.has(index) {
                return;
            }
            // A thin wall with a film on it stays whole.
            if slab.has(n) {
                return looked_at.push((index, hu[n] as i16));
            }
            let slope = DVec3::from_array(
                [0, 1, 2].map(|a| f64::from(field[n + strides[a]] - field[n - strides[a]]) / (2.0 * spacing[a])),
            );
            // What is left may turn out to be connected to nothing.
            let is_close = if hu[n] > DARK { beside.has(n) } else { around.has(n) };
            let Some(normal) = slope.try_normalize().filter(|_| is_close) else {
                return looked_at.push((index, hu[n] as i16));
            };
            let direction = normal.as_vec3() * per_voxel;
            let at = Vec3::from_array([0, 1, 2].map(|a| (v[a] - block.first[a]) as f32));
            let line: [f32; SAMPLES] =
                std::array::from_fn(|m| trilinear(&block, &hu, at + direction * layer::place(m)));
            // Beside dense tag gas is brighter than elsewhere.
            let darkest = line.iter().copied().fold(f32::INFINITY, f32::min);
            let gas = if darkest < GAS_MOST { darkest.max(GAS_LEAST) } else { self.gas };
            let materials = Materials { gas, tag: tag[n].max(TISSUE + 100.0), tissue: TISSUE };
            let is_within = lump.has(n) || enclosed.has(n);
            let found = self.fitter.fit(&line, materials, is_within);
            // If the fit finds no layer, the voxel is left where it may be tissue.
            let unsure = found.rest / (UNSURE * (materials.tag - TISSUE)).max(UNSURE_HU);
            let sure = if is_within { 1.0 } else { 1.0 - step(1.0, 1.5, unsure) };
            // A voxel that is clearly brighter than tissue is at least a mixture of both.
            let bright = step(BRIGHTER[0], BRIGHTER[1], hu[n] - TISSUE) * (1.0 - sure);
            let share = ((materials.tag - hu[n]) / (materials.tag - TISSUE)).clamp(0.0, 1.0);
            let mixture = gas + (TISSUE - gas) * share;
            let own = step(THIN[0], THIN[1], found.wall - found.gas_end) * sure;
            // Gas alone, or a bare wall.
            if bright == 0.0 && (own == 0.0 || found.gas_end > 3.0) {
                return looked_at.push((index, hu[n] as i16));
            }
            let p = self.fitter.phi.at(-found.wall)[0];
            let gas_free = self.fitter.phi.at(-found.gas_end)[0];
            let model = gas + (found.tag - gas) * gas_free + (TISSUE - found.tag) * p;
            let clean = gas + (TISSUE - gas) * p + (hu[n] - model) * step(0.9, 1.0, p);
            let to = if own + bright > 0.5 { &mut changed } else { &mut looked_at };
            to.push((index, (hu[n] + (clean - hu[n]) * own + (mixture - hu[n]) * bright).round() as i16));
        });
        (Changes::from_sorted(changed.into_iter()), Changes::from_sorted(looked_at.into_iter()))
    }
}

impl Shared<'_> {
    /// Returns which voxels of `asked` have gas on both sides and tag alone in between, and which may have a thin wall there.
    ///
    /// A thin wall and tag between gas and gas look alike in their values. Their edges differ: one from gas to tag has the slope
    ///
    /// ```text
    /// |∇v| = (F − A) φ(Φ⁻¹((v − A)/(F − A))) / σ
    /// ```
    ///
    /// at the value `v`, while tissue between them, or between tag and tag, makes a step on which it is smaller. Differences over `±h`
    /// add `h²/3` to σ². Only tag of some thickness is sure, and what is around it and no wall: the rim of a lump.
    fn lumps(&self, block: &Block, asked: &Mask, gas: &Mask, hu: &[f32], tag: &[f32]) -> [Mask; 2] {
        let mut core = asked.clone();
        core.keep_rows(|_| false);
        let (mut wall, mut between) = (core.clone(), core.clone());
        asked.each(|n| {
            let (mut found, mut thin) = (None, f64::INFINITY);
            for (line, mm) in self.slabs.across(block, gas, n) {
                between.set(n);
                found = self.is_tag(block, hu, tag[n], line.clone()).or(found);
                if found == Some(false) {
                    return wall.set(n);
                }
                let share = |n: usize| f64::from((hu[n] - self.gas) / (tag[n] - self.gas).max(1.0)).clamp(0.0, 1.0);
                thin = thin.min(mm * line.map(share).sum::<f64>());
            }
            if found.is_some() && thin > LUMP_MM {
                core.set(n);
            }
        });
        let walls = wall.dilated(self.apart);
        core.rows.iter_mut().zip(&walls.rows).for_each(|(core, walls)| *core &= !walls);
        let around = core.dilated(self.rim);
        let (mut lump, mut slab) = (core, wall);
        between.each(|n| {
            if slab.has(n) || lump.has(n) {
                return;
            }
            if around.has(n) { lump.set(n) } else { slab.set(n) }
        });
        [lump, slab]
    }

    /// True if all edges on a line from gas to gas are those of tag, false if one is not; `None` if there is none.
    fn is_tag(&self, block: &Block, hu: &[f32], tag: f32, line: impl Iterator<Item = usize> + Clone) -> Option<bool> {
        let level = TISSUE + EDGE_SHARE * (tag - TISSUE).max(CLEAR_HU);
        let mut found = None;
        for (m, n) in line.clone().zip(line.skip(1)) {
            if (hu[m] < level) != (hu[n] < level) {
                let edge = if (hu[m] - level).abs() < (hu[n] - level).abs() { m } else { n };
                if !self.is_steep(block, hu, tag, edge) {
                    return Some(false);
                }
                found = Some(true);
            }
        }
        found
    }

    /// True if values at the index `n` of a block are as steep as on an edge from gas to tag.
    fn is_steep(&self, block: &Block, hu: &[f32], tag: f32, n: usize) -> bool {
        let (spacing, strides) = (self.volume.grid().spacing(), block.strides());
        let is_inner = (0..3).all(|a| (1..block.dims[a] - 1).contains(&(n / strides[a] % block.dims[a])));
        if !is_inner {
            return false;
        }
        let rise = |a: usize| f64::from(hu[n + strides[a]] - hu[n - strides[a]]) / (2.0 * spacing[a]);
        let slope = DVec3::from_array([0, 1, 2].map(rise));
        let added = (slope * spacing).length_squared() / slope.length_squared().max(1.0) / 3.0;
        let contrast = f64::from(tag.max(TISSUE + CLEAR_HU) - self.gas);
        let t = normal::quantile((f64::from(hu[n] - self.gas) / contrast).clamp(0.01, 0.99));
        slope.length() > STEEP * contrast * (-0.5 * t * t).exp() / (TAU * (self.sigma.powi(2) + added)).sqrt()
    }
}

/// Returns the value of a block at a position in its voxels.
fn trilinear(block: &Block, values: &[f32], at: Vec3) -> f32 {
    let last = Vec3::from_array(block.dims.map(|d| d as f32 - 1.001));
    let at = at.clamp(Vec3::ZERO, last);
    let low = at.to_array().map(|c| c as usize);
    let t = at - Vec3::from_array(low.map(|c| c as f32));
    let [_, sy, sz] = block.strides();
    let n = low[0] + sy * low[1] + sz * low[2];
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    let row = |n: usize| mix(values[n], values[n + 1], t.x);
    mix(mix(row(n), row(n + sy), t.y), mix(row(n + sz), row(n + sz + sy), t.y), t.z)
}
