//! The noise of a scan: its strength in gas and in tissue, and its correlation from voxel to voxel.
//!
//! A reconstruction's noise is not white. Its autocovariance is measured in even tissue, in cubes whose linear trend is taken off, at
//! distances of up to [`LAGS`] voxels. The spectrum of that on a torus of [`TORUS`] voxels, without its negative parts, has a square root
//! whose inverse transform is the filter that makes such noise of white noise.

use std::f64::consts::TAU;

use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;

use crate::math::hash;
use crate::math::ranked::quantile;
use crate::volume::Volume;

/// Edges of a cube in which noise is measured, voxels; and in gas, where there may be little room.
const CUBE: [usize; 3] = [11, 11, 5];
const GAS_CUBE: [usize; 3] = [7, 7, 3];
/// Largest distances at which the autocovariance is measured, voxels.
const LAGS: [i64; 3] = [4, 4, 2];
/// Size of the torus, voxels.
const TORUS: [usize; 3] = [12, 12, 6];
/// Tissue and gas are within these values, HU.
const TISSUE_HU: [i16; 2] = [-60, 160];
const GAS_HU: i16 = -850;
/// Structure only adds to a deviation: that of this share of the cubes is the noise's.
const QUIET: f64 = 0.3;
/// Cubes up to this much noisier than that show how noise is correlated.
const ALIKE: f64 = 1.2;
/// As many of them are enough.
const MOST: usize = 500;
/// The noise beside a place is that within this distance, mm, if there are so many cubes.
const NEAR_MM: f64 = 60.0;
const LEAST: usize = 12;

/// The noise of a scan.
#[derive(Clone, Debug)]
pub(super) struct Noise {
    tissue: Vec<(DVec3, f64)>,
    gas: Vec<(DVec3, f64)>,
    /// The filter, in the order of the torus. Its squares sum to 1.
    filter: Vec<f64>,
}

/// The strength of a scan's noise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct NoiseLevel {
    /// Standard deviation in tissue, HU.
    pub tissue_hu: f64,
    /// Standard deviation in gas, HU.
    pub gas_hu: f64,
}

/// A cube of even values.
struct Cube {
    middle: DVec3,
    sd: f64,
    /// Values without their linear trend, HU.
    values: Vec<f64>,
}

impl Noise {
    /// Measures the noise of `volume`: the scan around a colon.
    pub(super) fn of(volume: &Volume) -> Self {
        let tissue = cubes(volume, CUBE, |hu| (TISSUE_HU[0]..=TISSUE_HU[1]).contains(&hu));
        let gas = cubes(volume, GAS_CUBE, |hu| hu < GAS_HU);
        let quiet = quantile(tissue.iter().map(|c| c.sd).collect(), QUIET).unwrap_or(0.0);
        let alike: Vec<&Cube> = tissue.iter().filter(|c| c.sd <= ALIKE * quiet).collect();
        let filter = filter(alike.iter().copied().step_by(alike.len().div_ceil(MOST).max(1)));
        let places = |cubes: Vec<Cube>| cubes.into_iter().map(|c| (c.middle, c.sd)).collect();
        Self { tissue: places(tissue), gas: places(gas), filter }
    }

    /// Returns the level of the noise in the whole scan.
    pub(super) fn level(&self) -> NoiseLevel {
        let of = |all: &[(DVec3, f64)]| quantile(all.iter().map(|c| c.1).collect(), QUIET).unwrap_or(0.0);
        NoiseLevel { tissue_hu: of(&self.tissue), gas_hu: of(&self.gas) }
    }

    /// Returns the level of the noise around a place (world, mm).
    pub(super) fn near(&self, place: DVec3) -> NoiseLevel {
        let of = |all: &[(DVec3, f64)]| {
            let near: Vec<f64> = all.iter().filter(|c| c.0.distance(place) < NEAR_MM).map(|c| c.1).collect();
            let near = if near.len() < LEAST { all.iter().map(|c| c.1).collect() } else { near };
            quantile(near, QUIET).unwrap_or(0.0)
        };
        NoiseLevel { tissue_hu: of(&self.tissue), gas_hu: of(&self.gas) }
    }

    /// Returns correlated noise of variance 1 at a voxel.
    pub(super) fn at(&self, seed: u64, voxel: [i64; 3]) -> f64 {
        let mut sum = 0.0;
        for (n, weight) in self.filter.iter().enumerate() {
            let [i, j, k] = place(n);
            let off = |a: usize, of: usize| a as i64 - (of / 2) as i64;
            let at = [i, j, k];
            let [x, y, z] = std::array::from_fn(|a| (voxel[a] + off(at[a], TORUS[a])) as u64 & 0x1F_FFFF);
            sum += weight * hash::normal(seed, x | y << 21 | z << 42);
        }
        sum
    }
}

/// Returns the cubes of a volume all of whose values pass, without their linear trends, side by side.
fn cubes(volume: &Volume, edges: [usize; 3], is_even: impl Fn(i16) -> bool + Sync) -> Vec<Cube> {
    let grid = volume.grid();
    let dims = grid.dims();
    let counts: [usize; 3] = std::array::from_fn(|a| dims[a] / edges[a]);
    let per_layer = |c: usize| -> Vec<Cube> {
        let mut out = Vec::new();
        for (b, a) in (0..counts[1]).flat_map(|b| (0..counts[0]).map(move |a| (b, a))) {
            let first = [a * edges[0], b * edges[1], c * edges[2]];
            let mut values = Vec::with_capacity(edges.iter().product());
            let mut passes = true;
            'cube: for k in 0..edges[2] {
                for j in 0..edges[1] {
                    let row = grid.index(first[0], first[1] + j, first[2] + k);
                    let row = &volume.data()[row..row + edges[0]];
                    if !row.iter().all(|&hu| is_even(hu)) {
                        passes = false;
                        break 'cube;
                    }
                    values.extend(row.iter().map(|&hu| f64::from(hu)));
                }
            }
            if passes {
                without_trend(&mut values, edges);
                let freedom = (values.len() - 4) as f64;
                let sd = (values.iter().map(|v| v * v).sum::<f64>() / freedom).sqrt();
                let middle: [f64; 3] = std::array::from_fn(|a| first[a] as f64 + 0.5 * (edges[a] - 1) as f64);
                out.push(Cube { middle: grid.world(DVec3::from_array(middle)), sd, values });
            }
        }
        out
    };
    (0..counts[2]).into_par_iter().flat_map_iter(per_layer).collect()
}

/// Takes the mean and the slope along each axis off the values of a cube.
fn without_trend(values: &mut [f64], edges: [usize; 3]) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let at = |n: usize| -> [f64; 3] {
        let place = [n % edges[0], n / edges[0] % edges[1], n / (edges[0] * edges[1])];
        std::array::from_fn(|a| place[a] as f64 - 0.5 * (edges[a] - 1) as f64)
    };
    // The axes are independent of each other on a full cube.
    let (mut slope, mut square) = ([0.0; 3], [0.0; 3]);
    for (n, v) in values.iter().enumerate() {
        for (a, x) in at(n).into_iter().enumerate() {
            slope[a] += x * (v - mean);
            square[a] += x * x;
        }
    }
    for (n, v) in values.iter_mut().enumerate() {
        let trend: f64 = at(n).into_iter().enumerate().map(|(a, x)| x * slope[a] / f64::max(square[a], 1.0)).sum();
        *v -= mean + trend;
    }
}

/// Returns the place of the torus' `n`-th voxel.
fn place(n: usize) -> [usize; 3] {
    [n % TORUS[0], n / TORUS[0] % TORUS[1], n / (TORUS[0] * TORUS[1])]
}

/// Returns the filter of noise as in these cubes; that of white noise without any.
fn filter<'a>(cubes: impl Iterator<Item = &'a Cube>) -> Vec<f64> {
    let sums = autocovariance(cubes);
    let lag = |d: [i64; 3]| {
        let of = |a: usize| (d[a].unsigned_abs() as usize).min((TORUS[a] as i64 - d[a]).unsigned_abs() as usize);
        let at = [of(0), of(1), of(2)];
        let most = LAGS.map(|l| l as usize);
        if at.iter().zip(most).any(|(a, m)| *a > m) { 0.0 } else { sums[at[0] + 5 * (at[1] + 5 * at[2])] }
    };
    let cosines = |of: &dyn Fn(usize) -> f64| -> Vec<f64> {
        (0..TORUS.iter().product())
            .map(|n| {
                let f = place(n);
                (0..TORUS.iter().product())
                    .map(|m| {
                        let x = place(m);
                        let phase: f64 = (0..3).map(|a| (f[a] * x[a]) as f64 / TORUS[a] as f64).sum();
                        of(m) * (TAU * phase).cos()
                    })
                    .sum()
            })
            .collect()
    };
    let power = cosines(&|m| lag(place(m).map(|p| p as i64)));
    let root = cosines(&|m| power[m].max(0.0).sqrt());
    let norm = root.iter().map(|r| r * r).sum::<f64>().sqrt();
    // In the middle of the torus, so that its neighbours are on both sides.
    let turned = |n: usize| {
        let p = place(n);
        let at: [usize; 3] = std::array::from_fn(|a| (p[a] + TORUS[a] - TORUS[a] / 2) % TORUS[a]);
        root[at[0] + TORUS[0] * (at[1] + TORUS[1] * at[2])]
    };
    if norm > 0.0 {
        (0..root.len()).map(|n| turned(n) / norm).collect()
    } else {
        let middle = TORUS[0] / 2 + TORUS[0] * (TORUS[1] / 2 + TORUS[1] * (TORUS[2] / 2));
        (0..root.len()).map(|n| f64::from(u8::from(n == middle))).collect()
    }
}

/// Returns the mean autocovariance at lags of 0 to 4, 0 to 4 and 0 to 2 voxels; each is the mean of those along and against an axis.
fn autocovariance<'a>(cubes: impl Iterator<Item = &'a Cube>) -> [f64; 75] {
    let (mut sums, mut counts) = ([0.0; 75], [0.0; 75]);
    for cube in cubes {
        let scale = 1.0 / cube.sd.max(1e-9).powi(2);
        let index = |p: [i64; 3]| p[0] as usize + CUBE[0] * (p[1] as usize + CUBE[1] * p[2] as usize);
        for dz in 0..=LAGS[2] {
            for dy in -LAGS[1]..=LAGS[1] {
                for dx in -LAGS[0]..=LAGS[0] {
                    let at = (dx.unsigned_abs() + 5 * (dy.unsigned_abs() + 5 * dz.unsigned_abs())) as usize;
                    let range = |d: i64, edge: usize| (-d).max(0)..(edge as i64 - d.max(0));
                    for z in range(dz, CUBE[2]) {
                        for y in range(dy, CUBE[1]) {
                            for x in range(dx, CUBE[0]) {
                                let (a, b) = (index([x, y, z]), index([x + dx, y + dy, z + dz]));
                                sums[at] += scale * cube.values[a] * cube.values[b];
                                counts[at] += 1.0;
                            }
                        }
                    }
                }
            }
        }
    }
    std::array::from_fn(|n| if counts[n] > 0.0 { sums[n] / counts[n] } else { 0.0 })
}
