//! The point spread of a scan, measured at its own walls.
//!
//! The values along a normal of the wall are a step from gas to tissue, blurred by the scanner: the edge spread E. Profiles of many flat
//! places, put on top of each other at their half-way level, have a median that is fitted by
//!
//!   E(u) = Φ(u) + β u φ(u), u = d / σ,
//!
//! the edge spread of the kernel G − β σ² G'' (G the normal density): a reconstruction that sharpens overshoots (β > 0). The wall may be
//! thin, with fat behind, so that only the side of the gas is fitted; tissue has the brightest value of the median profile. Walls that run
//! along the axis of the slices give σ and β in the plane of a slice, walls across it σ between slices. Values between voxels are
//! interpolated linearly, which adds h²/6 to the variance along each axis; that is taken off again.

use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;

use crate::math::normal;
use crate::math::ranked::median;
use crate::polyps::Wall;
use crate::space::ray::trilinear;
use crate::volume::Volume;

/// A wall is flat where both curvatures are below this, 1/mm.
const FLAT: f32 = 0.08;
/// Profiles reach this far into gas and into tissue, mm, in such steps; the gas is level up to the second number.
const REACH_MM: f64 = 4.0;
const LEVEL_MM: f64 = 2.6;
const STEP_MM: f64 = 0.1;
/// Gas is darker than this, HU, and even to this, peak to peak of a mean of five; the brightest such mean of tissue is within these values.
const GAS_HU: f64 = -850.0;
const EVEN_HU: f64 = 90.0;
const TISSUE_HU: [f64; 2] = [-30.0, 150.0];
/// Tissue, until it has been measured, HU.
const USUAL_HU: f64 = 40.0;
/// Limits of |cos| between the normal and the slices' axis for walls along it and across it.
const ALONG: f64 = 0.35;
const ACROSS: f64 = 0.9;
/// Profiles of a kind that are wanted: fewer say too little, more say no more.
const LEAST: usize = 40;
const MOST: usize = 20_000;
/// The edge spread is fitted from this far in the gas up to this far in the tissue, mm.
const FIT_MM: [f64; 2] = [2.2, 0.3];
/// Limits of the result, mm.
const SIGMA_MM: [f64; 2] = [0.2, 2.5];
const SHARP: [f64; 2] = [0.0, 0.6];
/// A kernel sharpens if gas beside the wall is darker than elsewhere by this share of the step. Without that, σ and β cannot be told apart.
const UNDERSHOOT: f64 = 0.01;

/// What a scanner makes of a point, and of tissue.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Standard deviation of the blur in the plane of a slice and along its normal, mm.
    pub sigma_mm: [f64; 2],
    /// How far the kernel sharpens in the plane: β above; 0 for a Gaussian.
    pub sharpness: f64,
    /// HU of the tissue behind walls, and of the gas before them.
    pub tissue_hu: f64,
    /// See `tissue_hu`.
    pub gas_hu: f64,
    /// Walls that were measured, along the axis of the slices and across it.
    pub walls: [usize; 2],
}

/// One profile across a wall.
struct Profile {
    /// |cos| between the wall's normal and the axis of the slices.
    cos: f64,
    gas: f64,
    /// Values from the gas to the tissue, HU.
    values: Vec<f64>,
}

impl Spread {
    /// Measures the spread of `volume` at its `wall`. Returns `None` if too few of its walls lie against thick tissue.
    pub(super) fn of(volume: &Volume, wall: &Wall) -> Option<Self> {
        let flat: Vec<u32> =
            (0..wall.len() as u32).filter(|&v| wall.curvatures(v).iter().all(|k| k.abs() < FLAT)).collect();
        let every = flat.len().div_ceil(20 * MOST).max(1);
        let some: Vec<u32> = flat.into_iter().step_by(every).collect();
        let profiles: Vec<Profile> = some.par_iter().filter_map(|&v| Profile::at(volume, wall, v)).collect();
        let kind = |is: &dyn Fn(f64) -> bool| -> Vec<&Profile> {
            let all: Vec<&Profile> = profiles.iter().filter(|p| is(p.cos)).collect();
            let every = all.len().div_ceil(MOST).max(1);
            all.into_iter().step_by(every).collect()
        };
        let [along, across] = [kind(&|c| c < ALONG), kind(&|c| c > ACROSS)];
        if along.len() < LEAST {
            return None;
        }
        let gas_hu = median(profiles.iter().map(|p| p.gas).collect())?;
        let tissue_hu = brightest(&along)?;
        let h = volume.grid().spacing();
        let square = |fitted: f64, axes: f64| (fitted * fitted - axes).max(SIGMA_MM[0] * SIGMA_MM[0]);
        let mean_cos2 = |of: &[&Profile]| of.iter().map(|p| p.cos * p.cos).sum::<f64>() / of.len() as f64;
        let plane = h.truncate().length_squared() / 12.0;
        let slices = h.z * h.z / 6.0;
        let (first, sharpness) = fit(&along, tissue_hu, None)?;
        let c = mean_cos2(&along);
        let mut xy = square(first, (1.0 - c) * plane + c * slices);
        // Without walls across the slices, they are as sharp as the plane, or as thick as they are apart.
        let mut z = xy.max(h.z * h.z / 12.0);
        if across.len() >= LEAST {
            let (second, _) = fit(&across, tissue_hu, Some(0.0))?;
            let d = mean_cos2(&across);
            let [a, b] =
                [square(first, (1.0 - c) * plane + c * slices), square(second, (1.0 - d) * plane + d * slices)];
            // a = (1 − c) xy + c z, b = (1 − d) xy + d z.
            z = ((1.0 - c) * b - (1.0 - d) * a) / (d - c);
            xy = (a - c * z) / (1.0 - c);
        }
        let limited = |square: f64| square.max(0.0).sqrt().clamp(SIGMA_MM[0], SIGMA_MM[1]);
        Some(Self {
            sigma_mm: [limited(xy), limited(z)],
            sharpness,
            tissue_hu,
            gas_hu,
            walls: [along.len(), across.len()],
        })
    }
}

impl Profile {
    /// Returns the profile across a wall at a vertex, if it is a step from gas to tissue.
    fn at(volume: &Volume, wall: &Wall, vertex: u32) -> Option<Self> {
        let grid = volume.grid();
        let normal = wall.normal(vertex).as_dvec3();
        let start = wall.world(vertex) + normal * REACH_MM;
        let count = (2.0 * REACH_MM / STEP_MM).round() as usize;
        let end = start - normal * (count as f64 * STEP_MM);
        if normal == DVec3::ZERO || !grid.contains(start) || !grid.contains(end) {
            return None;
        }
        let values: Vec<f64> =
            (0..=count).map(|n| trilinear(volume, grid.voxel(start - normal * (n as f64 * STEP_MM)))).collect();
        let (level, middle) = (((REACH_MM - LEVEL_MM) / STEP_MM).round() as usize, count / 2);
        let mean = |of: &[f64]| of.iter().sum::<f64>() / of.len() as f64;
        let range =
            |of: &[f64]| of.windows(5).map(mean).fold((f64::MAX, f64::MIN), |(lo, hi), m| (lo.min(m), hi.max(m)));
        let (gas, (lo, hi)) = (mean(&values[..=level]), range(&values[..=level]));
        let (darkest, brightest) = range(&values[middle..]);
        let is_step = gas < GAS_HU
            && hi - lo < EVEN_HU
            && (TISSUE_HU[0]..TISSUE_HU[1]).contains(&brightest)
            && darkest > 0.5 * gas - EVEN_HU;
        let axis = grid.direction().z_axis.normalize_or_zero();
        is_step.then(|| Self { cos: normal.dot(axis).abs(), gas, values })
    }

    /// Returns where the profile crosses the level half-way to `tissue` HU, in steps.
    fn half(&self, tissue: f64) -> Option<f64> {
        let level = 0.5 * (self.gas + tissue);
        let at = (1..self.values.len()).find(|&n| self.values[n - 1] < level && self.values[n] >= level)?;
        let [a, b] = [self.values[at - 1], self.values[at]];
        Some(at as f64 - 1.0 + (level - a) / (b - a))
    }

    /// Returns the value at a distance from a place, mm into the tissue, HU; the place is in steps.
    fn value(&self, from: f64, mm: f64) -> Option<f64> {
        let at = from + mm / STEP_MM;
        let n = at.floor();
        if n < 0.0 {
            return None;
        }
        let [a, b] = [self.values.get(n as usize)?, self.values.get(n as usize + 1)?];
        Some(a + (at - n) * (b - a))
    }
}

/// Returns the brightest value of the median profile, HU.
fn brightest(profiles: &[&Profile]) -> Option<f64> {
    let halves: Vec<Option<f64>> = profiles.iter().map(|p| p.half(USUAL_HU)).collect();
    let at = |mm: f64| {
        let values = profiles.iter().zip(&halves).filter_map(|(p, half)| p.value((*half)?, mm));
        median(values.collect())
    };
    (5..=(REACH_MM / STEP_MM) as usize).step_by(2).filter_map(|n| at(n as f64 * STEP_MM)).reduce(f64::max)
}

/// Fits the edge spread of profiles. Returns σ, mm, and β, which may be given.
fn fit(profiles: &[&Profile], tissue: f64, sharp: Option<f64>) -> Option<(f64, f64)> {
    let halves: Vec<Option<f64>> = profiles.iter().map(|p| p.half(tissue)).collect();
    let [before, behind] = FIT_MM.map(|mm| (mm / STEP_MM).round() as i32);
    let points: Vec<(f64, f64)> = (-before..=behind)
        .filter_map(|n| {
            let mm = f64::from(n) * STEP_MM;
            let shares = profiles.iter().zip(&halves).filter_map(|(p, half)| {
                let hu = p.value((*half)?, mm)?;
                Some((hu - p.gas) / (tissue - p.gas))
            });
            Some((mm, median(shares.collect())?))
        })
        .collect();
    let cost = |sigma: f64, sharp: f64| -> f64 {
        points.iter().map(|&(mm, value)| (edge(mm / sigma, sharp) - value).powi(2)).sum()
    };
    let undershoots = points.iter().any(|p| p.1 < -UNDERSHOOT);
    let sharp = sharp.or_else(|| (!undershoots).then_some(0.0));
    // Two parameters within limits: every pair of a grid, finer around the best.
    let (mut sigma, mut beta) = ([SIGMA_MM[0], 2.0 * SIGMA_MM[1]], sharp.map_or(SHARP, |s| [s, s]));
    let mut best = (f64::INFINITY, 0.0, 0.0);
    for _ in 0..6 {
        let at = |range: [f64; 2], n: i32| range[0] + (range[1] - range[0]) * f64::from(n) / 20.0;
        for (i, j) in (0..=20).flat_map(|i| (0..=20).map(move |j| (i, j))) {
            let (s, b) = (at(sigma, i), at(beta, j));
            let c = cost(s, b);
            if c < best.0 {
                best = (c, s, b);
            }
        }
        let around = |range: [f64; 2], at: f64, limits: [f64; 2]| {
            let half = 0.1 * (range[1] - range[0]);
            [(at - half).max(limits[0]), (at + half).min(limits[1])]
        };
        sigma = around(sigma, best.1, [SIGMA_MM[0], 2.0 * SIGMA_MM[1]]);
        beta = around(beta, best.2, sharp.map_or(SHARP, |s| [s, s]));
    }
    (points.len() > before as usize).then_some((best.1, best.2))
}

/// Returns the edge spread, 0 in gas and 1 in tissue, at `u` standard deviations into the tissue.
fn edge(u: f64, sharp: f64) -> f64 {
    normal::cdf(u) + sharp * u * (-0.5 * u * u).exp() / std::f64::consts::TAU.sqrt()
}
