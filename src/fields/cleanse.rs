//! Electronic cleansing: the scan with the colon's tagged fluid replaced by gas and the wall beneath restored.
//!
//! A voxel holds three materials: tissue (share `p`), and gas or tag in the lumen. The surface of a pool is a plane, so what the
//! lumen alone would show there is known: `M = A + (F − A)·Φ(depth/σ)`, with gas `A`, the tag's local level `F` and the scanner's
//! blur `σ`. A voxel then shows `v = T p + M (1 − p)`, exact where the level meets the wall at a right angle (a corner of three
//! materials) and everywhere else near it. The share is estimated by least squares over a small Gaussian neighbourhood,
//!
//! ```text
//! p = Σ G (T − M)(v − M) / Σ G (T − M)²
//! ```
//!
//! so that it comes from below and above the thin layer where a mixture of gas and tag looks like tissue (`M ≈ T`), and noise
//! that the lower contrast to tag would amplify is averaged. The neighbourhood's own blur is then taken off: an edge of width
//! `√(σ² + s²)` gets the width σ by `Φ(√(1 + s²/σ²) Φ⁻¹(p))`, exact on planes. The cleansed value is `A + (T − A) p`.

use glam::DVec3;
use rayon::prelude::*;

use super::Lumen;
use super::lumen::frame::{AxisDirection, Frame};
use crate::math::normal;
use crate::volume::Volume;

/// HU of gas and of the colon's wall.
const GAS: f32 = -1000.0;
const TISSUE: f32 = 40.0;
/// Standard deviation of the neighbourhood, mm, and of that in which the tag's level is averaged.
const NEIGHBOURHOOD_MM: f64 = 0.6;
const LEVEL_MM: f64 = 2.5;
/// How far from fluid values are replaced, mm.
const REACH_MM: f64 = 3.5;
/// No wall is brighter, HU.
const BRIGHT: f64 = 150.0;
/// The least contrast of tag, HU.
const CONTRAST: f32 = 100.0;

/// A cleansed scan.
#[derive(Clone, Debug)]
pub(crate) struct Cleansed {
    /// The scan without tag.
    pub volume: Volume,
    /// The pools that were taken out.
    #[cfg_attr(not(test), expect(dead_code, reason = "for the stats of `colvis cleanse`"))]
    pub pools: Vec<CleansedPool>,
}

/// A pool that was taken out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CleansedPool {
    /// Volume of the fluid, ml.
    pub ml: f64,
    /// Mean HU of its tag.
    pub tag_hu: f64,
    /// A point of its level and the unit normal, upwards; world.
    pub level: [DVec3; 2],
}

/// A box of voxels around a pool.
struct Box3 {
    first: [i64; 3],
    dims: [usize; 3],
}

impl Box3 {
    fn len(&self) -> usize {
        self.dims.iter().product()
    }

    fn index(&self, v: [i64; 3]) -> Option<usize> {
        let at = [0, 1, 2].map(|a| v[a] - self.first[a]);
        let inside = (0..3).all(|a| (0..self.dims[a] as i64).contains(&at[a]));
        inside.then(|| at[0] as usize + self.dims[0] * (at[1] as usize + self.dims[1] * at[2] as usize))
    }

    fn voxel(&self, n: usize) -> [i64; 3] {
        let [nx, ny, _] = self.dims;
        let at = [n % nx, n / nx % ny, n / nx / ny];
        [0, 1, 2].map(|a| self.first[a] + at[a] as i64)
    }
}

/// Returns the scan without the lumen's tagged fluid.
pub(crate) fn cleansed(volume: &Volume, lumen: &Lumen) -> Cleansed {
    let grid = volume.grid();
    let rows = lumen.fluid();
    let (label, count) = rows.components_by_corners();
    let mut runs: Vec<Vec<(usize, usize, std::ops::Range<usize>)>> = vec![Vec::new(); count];
    for ((j, k, r), &label) in rows.iter().zip(&label) {
        runs[label as usize].push((j, k, r.range()));
    }
    let sigma = blur_mm(volume, lumen);
    let made: Vec<_> = runs.par_iter().filter_map(|runs| pool(volume, lumen, runs, sigma)).collect();
    let mut data = volume.data().to_vec();
    let mut pools = Vec::new();
    for (pool, changed) in made {
        for (n, hu) in changed {
            // Where the boxes of two pools overlap, the darker value is that without either.
            data[n] = if data[n] == volume.data()[n] { hu } else { data[n].min(hu) };
        }
        pools.push(pool);
    }
    Cleansed { volume: Volume::new(grid.clone(), data), pools }
}

/// Estimates the scanner's blur, mm, from walls against gas. Where an edge has passed the share `p`, its slope is `(T − A) φ(Φ⁻¹(p)) / σ`;
/// differences over `±h` add `h²/3` to σ². Returns the median over such voxels.
fn blur_mm(volume: &Volume, lumen: &Lumen) -> f64 {
    let grid = volume.grid();
    let spacing = grid.spacing();
    let mut found: Vec<f64> = Vec::new();
    for (j, k, r) in lumen.gas().iter().step_by(3) {
        for i in [i64::from(r.start) - 1, i64::from(r.end)] {
            let v = [i, j as i64, k as i64];
            let hu = |a: usize, d: i64| {
                let mut at = v;
                at[a] += d;
                f64::from(volume.get(at[0], at[1], at[2]))
            };
            let p = (hu(0, 0) - f64::from(GAS)) / f64::from(TISSUE - GAS);
            let is_tag = (0..3).any(|a| (-4..=4).any(|d| hu(a, d) > BRIGHT));
            if !(0.2..0.8).contains(&p) || is_tag {
                continue;
            }
            let slope = DVec3::from_array([0, 1, 2].map(|a| (hu(a, 1) - hu(a, -1)) / (2.0 * spacing[a])));
            let t = normal::quantile(p);
            let seen =
                f64::from(TISSUE - GAS) * (-0.5 * t * t).exp() / std::f64::consts::TAU.sqrt() / slope.length().max(1.0);
            let added = (slope * spacing).length_squared() / slope.length_squared().max(1.0) / 3.0;
            found.push((seen * seen - added).max(0.01).sqrt());
        }
    }
    if found.len() < 100 {
        return 0.65 * grid.min_spacing();
    }
    found.sort_unstable_by(f64::total_cmp);
    found[found.len() / 2].clamp(0.3 * grid.min_spacing(), 3.0)
}

type Changed = Vec<(usize, i16)>;

/// Cleanses around one pool. Returns its description and the new values by voxel.
fn pool(
    volume: &Volume,
    lumen: &Lumen,
    runs: &[(usize, usize, std::ops::Range<usize>)],
    sigma: f64,
) -> Option<(CleansedPool, Changed)> {
    let grid = volume.grid();
    let spacing = grid.spacing();
    let reach = (REACH_MM / spacing).ceil().to_array().map(|r| r as i64);
    let (mut low, mut high) = ([i64::MAX; 3], [i64::MIN; 3]);
    for (j, k, r) in runs {
        for (a, (l, h)) in [(r.start, r.end - 1), (*j, *j), (*k, *k)].into_iter().enumerate() {
            low[a] = low[a].min(l as i64);
            high[a] = high[a].max(h as i64);
        }
    }
    let dims = grid.dims();
    let first = [0, 1, 2].map(|a| (low[a] - reach[a]).max(0));
    let last = [0, 1, 2].map(|a| (high[a] + reach[a]).min(dims[a] as i64 - 1));
    let area = Box3 { first, dims: [0, 1, 2].map(|a| (last[a] - first[a] + 1) as usize) };
    let mut fluid = vec![0f32; area.len()];
    let mut voxels = 0;
    for (j, k, r) in runs {
        for i in r.clone() {
            fluid[area.index([i as i64, *j as i64, *k as i64])?] = 1.0;
            voxels += 1;
        }
    }
    let hu: Vec<f32> = (0..area.len())
        .map(|n| {
            let [i, j, k] = area.voxel(n);
            f32::from(volume.get(i, j, k))
        })
        .collect();
    let down = downwards(lumen, Frame::of(grid), &area, &fluid)?;
    // The tag's level: of voxels with fluid all around.
    let inner = eroded(&area, &fluid, &[0, 1, 2].map(|a| (1.6 * sigma / spacing[a]).ceil().max(1.0) as usize));
    let bright: Vec<f32> = (0..area.len()).filter(|&n| inner[n] > 0.0).map(|n| hu[n]).collect();
    let all = || (0..area.len()).filter(|&n| fluid[n] > 0.0).map(|n| hu[n]);
    let mean = if bright.len() >= 8 {
        bright.iter().sum::<f32>() / bright.len() as f32
    } else {
        all().fold(f32::NEG_INFINITY, f32::max)
    };
    if mean < TISSUE + CONTRAST {
        return None;
    }
    let level_sigma = [0, 1, 2].map(|a| LEVEL_MM / spacing[a]);
    let mut sum: Vec<f32> = (0..area.len()).map(|n| inner[n] * hu[n]).collect();
    let mut weight = inner;
    blur(&area, &mut sum, level_sigma);
    blur(&area, &mut weight, level_sigma);
    let tag = |n: usize| {
        let known = weight[n].min(1.0);
        // Far from any pure tag, the pool's mean.
        ((sum[n] + 1e-3 * mean) / (known + 1e-3)).max(TISSUE + CONTRAST)
    };
    let level = level(&area, &fluid, &hu, down, mean)?;
    // Depth below the level, mm.
    let mm = spacing[down.axis];
    let depth = |n: usize| {
        let v = area.voxel(n);
        (v[down.axis] as f64 * down.sign as f64 - level) * mm
    };
    let table = Sharpened::new(sigma, NEIGHBOURHOOD_MM);
    let near = dilated(&area, &fluid, &reach.map(|r| r as usize));
    let mut product = vec![0f32; area.len()];
    let mut square = vec![0f32; area.len()];
    let mut lumen_hu = vec![0f32; area.len()];
    for n in 0..area.len() {
        let mixed = GAS + (tag(n) - GAS) * normal::cdf(depth(n) / sigma) as f32;
        let contrast = TISSUE - mixed;
        lumen_hu[n] = mixed;
        product[n] = contrast * (hu[n] - mixed);
        square[n] = contrast * contrast;
    }
    let s = [0, 1, 2].map(|a| NEIGHBOURHOOD_MM / spacing[a]);
    blur(&area, &mut product, s);
    blur(&area, &mut square, s);
    let mut changed = Vec::new();
    for n in (0..area.len()).filter(|&n| near[n] > 0.0) {
        let p = table.at(product[n] / square[n].max(1.0));
        let clean = GAS + (TISSUE - GAS) * p;
        // Tissue keeps its own texture.
        let rest = hu[n] - (TISSUE * p + lumen_hu[n] * (1.0 - p));
        let clean = clean + rest * step(0.9, 1.0, p);
        // Above the blur of the level the scan is as it should be.
        let own = step(-3.5, -2.0, (depth(n) / sigma) as f32);
        let value = hu[n] + (clean - hu[n]) * own;
        let [i, j, k] = area.voxel(n);
        changed.push((grid.index(i as usize, j as usize, k as usize), value.round() as i16));
    }
    let axis = grid.direction().col(down.axis) * down.sign as f64;
    let mut at = [0, 1, 2].map(|a| 0.5 * (first[a] + last[a]) as f64);
    at[down.axis] = level * down.sign as f64;
    let pool = CleansedPool {
        ml: f64::from(voxels) * grid.voxel_ml(),
        tag_hu: f64::from(mean),
        level: [grid.world(DVec3::from_array(at)), -axis],
    };
    Some((pool, changed))
}

/// Returns the cubic step from 0 at `lo` to 1 at `hi`.
fn step(lo: f32, hi: f32, x: f32) -> f32 {
    let t = ((x - lo) / (hi - lo)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Returns the direction in which gravity pulls: away from the gas above the fluid.
fn downwards(lumen: &Lumen, frame: Frame, area: &Box3, fluid: &[f32]) -> Option<AxisDirection> {
    let above = |down: AxisDirection| {
        let step = down.step().map(|s| -3 * s);
        (0..area.len())
            .filter(|&n| fluid[n] > 0.0)
            .filter(|&n| {
                let v = area.voxel(n);
                lumen.gas().find(v[0] + step[0], v[1] + step[1], v[2] + step[2]).is_some()
            })
            .count()
    };
    let [a, b] = [frame.posterior, frame.posterior.back()].map(|d| (above(d), d));
    let (count, down) = if a.0 >= b.0 { a } else { b };
    (count > 0).then_some(down)
}

/// Returns the position of the level along `down`, in voxels times its sign: the median of where columns pass half-way from gas to
/// fluid.
fn level(area: &Box3, fluid: &[f32], hu: &[f32], down: AxisDirection, tag: f32) -> Option<f64> {
    let half = 0.5 * (GAS + tag);
    let step = down.step();
    let mut found = Vec::new();
    for n in (0..area.len()).filter(|&n| fluid[n] > 0.0) {
        let v = area.voxel(n);
        let at = |m: i64| area.index([0, 1, 2].map(|a| v[a] + m * step[a]));
        // The first voxel of fluid under gas.
        let Some(up) = at(-1) else { continue };
        if hu[n] < half || hu[up] >= half {
            continue;
        }
        // Gas above and fluid below, without tissue between or beside.
        let clear = at(-3).is_some_and(|m| hu[m] < GAS + 100.0) && at(3).is_some_and(|m| hu[m] > 0.7 * tag);
        if clear {
            let share = f64::from((half - hu[up]) / (hu[n] - hu[up]));
            found.push((v[down.axis] * down.sign) as f64 - 1.0 + share);
        }
    }
    if found.len() < 6 {
        return None;
    }
    found.sort_unstable_by(f64::total_cmp);
    Some(found[found.len() / 2])
}

/// Blurs by Gaussians of standard deviations `sigma` (voxels), one axis after the other.
fn blur(area: &Box3, values: &mut [f32], sigma: [f64; 3]) {
    let strides = [1, area.dims[0], area.dims[0] * area.dims[1]];
    for a in 0..3 {
        let reach = (3.0 * sigma[a]).ceil() as usize;
        let mut bell: Vec<f32> =
            (0..=reach).map(|n| (-0.5 * (n as f64 / sigma[a].max(1e-6)).powi(2)).exp() as f32).collect();
        let total = bell[0] + 2.0 * bell[1..].iter().sum::<f32>();
        bell.iter_mut().for_each(|b| *b /= total);
        let (count, stride) = (area.dims[a], strides[a]);
        let mut line = vec![0f32; count];
        for n in (0..area.len()).filter(|n| n / stride % count == 0) {
            for (m, l) in line.iter_mut().enumerate() {
                *l = values[n + m * stride];
            }
            for m in 0..count {
                let mut sum = bell[0] * line[m];
                for (d, b) in bell.iter().enumerate().skip(1) {
                    // Beyond the ends their values go on.
                    let (l, h) = (m.saturating_sub(d), (m + d).min(count - 1));
                    sum += b * (line[l] + line[h]);
                }
                values[n + m * stride] = sum;
            }
        }
    }
}

/// Returns 1 where all values within a box of half sides `reach` are positive.
fn eroded(area: &Box3, values: &[f32], reach: &[usize; 3]) -> Vec<f32> {
    let inverse: Vec<f32> = values.iter().map(|v| 1.0 - v).collect();
    dilated(area, &inverse, reach).iter().map(|v| 1.0 - v).collect()
}

/// Returns 1 where a value within a box of half sides `reach` is positive.
fn dilated(area: &Box3, values: &[f32], reach: &[usize; 3]) -> Vec<f32> {
    let strides = [1, area.dims[0], area.dims[0] * area.dims[1]];
    let mut out = values.to_vec();
    for a in 0..3 {
        let (count, stride) = (area.dims[a], strides[a]);
        let mut line = vec![false; count];
        for n in (0..area.len()).filter(|n| n / stride % count == 0) {
            for (m, l) in line.iter_mut().enumerate() {
                *l = out[n + m * stride] > 0.0;
            }
            let mut next = line.iter().position(|l| *l).unwrap_or(usize::MAX);
            let mut last: Option<usize> = None;
            for m in 0..count {
                if line[m] {
                    last = Some(m);
                }
                if next < m {
                    next = (m..count).find(|&x| line[x]).unwrap_or(usize::MAX);
                }
                let is_near =
                    last.is_some_and(|l| m - l <= reach[a]) || next != usize::MAX && next.saturating_sub(m) <= reach[a];
                out[n + m * stride] = f32::from(u8::from(is_near));
            }
        }
    }
    out
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

#[cfg(test)]
#[path = "cleanse_tests.rs"]
mod tests;
