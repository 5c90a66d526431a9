//! Measurements of a body of gas from which its kind is derived.

use super::landmarks::Landmarks;
use crate::fields::lumen::Segment;
use crate::fields::lumen::runs::{Rows, near};
use crate::volume::Grid;

/// Distance along a path between two constrictions that are told apart, nodes.
const APART: usize = 2;

/// Measures of a body of gas. Lengths that are compared with an adult's are divided by the patient's size.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Features {
    /// Volume of gas, ml, in an adult.
    pub ml: f64,
    /// Length from end to end, mm, in an adult.
    pub length_mm: f64,
    /// Mean diameter, mm, in an adult: of a tube of this volume and length.
    pub caliber_mm: f64,
    /// Largest distance across, mm, in an adult.
    pub widest_mm: f64,
    /// Constrictions for each 100 mm of length, in an adult: haustra.
    pub constrictions: f64,
    /// Surface compared with that of the smooth tube of this volume and length: folds, texture of the wall.
    pub roughness: f64,
    /// Volume of tagged fluid compared with that of gas.
    pub fluid: f64,
    /// Centre of its box: to the left of the midline, as a share of half the body's width; negative to the right.
    pub aside: f64,
    /// Centre of its box: 0 at the belly, 1 at the back.
    pub back: f64,
    /// Centre of its box: 0 in the scan's lowest slice, 1 in its highest.
    pub height: f64,
    /// Largest extent across the body, as a share of its width.
    pub across: f64,
    /// Largest extent along the body, mm, in an adult.
    pub along_mm: f64,
    /// Distance from its centre up to the lungs' lower end, mm, in an adult; negative above it. `None` without lungs.
    pub below_lungs_mm: Option<f64>,
    /// Largest share of lung in a slice through it.
    pub lung_beside: f64,
    /// Volume compared with that of the largest body.
    pub share: f64,
    /// True if fluid joins it to a larger body.
    pub joined: bool,
}

/// Measures body `n` of `segments`, whose gas is labelled in `gas` and whose clearances along the way are given, mm.
pub(crate) fn measure(
    segments: &[Segment],
    n: usize,
    clearances: &[f64],
    surface_mm2: f64,
    body: &Landmarks,
) -> Features {
    let (s, scale) = (&segments[n], body.scale());
    let (ml, length) = (s.ml / scale.powi(3), (s.length_mm / scale).max(1.0));
    let caliber = |ml: f64, length: f64| 2.0 * (1000.0 * ml / (std::f64::consts::PI * length)).sqrt();
    // Its ends are the centres of balls: the tube is longer by about its radius at each.
    let tube = length + 0.7 * caliber(ml, length);
    let caliber_mm = caliber(ml, tube);
    let centre = 0.5 * (s.bounds_mm[0] + s.bounds_mm[1]);
    let extent = s.bounds_mm[1] - s.bounds_mm[0];
    let largest = segments.iter().map(|s| s.ml).fold(0.0, f64::max);
    Features {
        ml,
        length_mm: length,
        caliber_mm,
        widest_mm: 2.0 * clearances.iter().copied().fold(0.0, f64::max) / scale,
        constrictions: 100.0 * constrictions(clearances) as f64 / length,
        roughness: surface_mm2 / (scale * scale) / (std::f64::consts::PI * caliber_mm * (tube + 0.5 * caliber_mm)),
        fluid: s.fluid_ml / s.ml.max(1e-9),
        aside: body.aside(centre),
        back: body.back(centre),
        height: body.height(centre),
        across: 0.5 * extent.x / body.half_width,
        along_mm: extent.z / scale,
        below_lungs_mm: body.diaphragm.map(|z| (z - centre.z) / scale),
        lung_beside: body.lung_between(s.bounds_mm[0].z, s.bounds_mm[1].z),
        share: s.ml / largest.max(1e-9),
        joined: s.joined_to.iter().any(|&o| segments[o].ml > s.ml),
    }
}

/// Counts the narrow places between two wide ones.
fn constrictions(clearances: &[f64]) -> usize {
    let is_least = |n: usize| {
        let reach = |d: usize| [n.checked_sub(d), Some(n + d)].into_iter().flatten().filter_map(|m| clearances.get(m));
        (1..=APART).flat_map(reach).all(|&c| c >= clearances[n])
            && (1..=2 * APART).flat_map(reach).any(|&c| c > 1.25 * clearances[n])
    };
    (APART..clearances.len().saturating_sub(APART)).filter(|&n| is_least(n)).count()
}

/// Returns the area of the voxels' faces between each label and what is not it, mm², brought to that of a smooth surface: a slanted
/// surface shows more faces, by half on average.
pub(crate) fn surfaces(grid: &Grid, gas: &Rows, count: usize) -> Vec<f64> {
    const SLANTED: f64 = 1.5;
    let [_, ny, nz] = gas.dims();
    let s = grid.spacing();
    let mut faces = vec![[0u64; 3]; count];
    for (j, k, r) in gas.iter() {
        let f = &mut faces[r.label as usize];
        f[0] += 2;
        f[1] += 2 * u64::from(r.len());
        f[2] += 2 * u64::from(r.len());
        for (axis, other) in
            [(1, (j + 1 < ny).then(|| gas.row(j + 1, k))), (2, (k + 1 < nz).then(|| gas.row(j, k + 1)))]
        {
            let own = [r];
            near(&own, other.unwrap_or_default(), 0, |_, b| {
                let o = other.unwrap_or_default()[b];
                if o.label == r.label {
                    f[axis] -= 2 * u64::from(r.end.min(o.end) - r.start.max(o.start));
                }
            });
        }
    }
    let area = |f: [u64; 3]| f[0] as f64 * s.y * s.z + f[1] as f64 * s.x * s.z + f[2] as f64 * s.x * s.y;
    faces.into_iter().map(|f| area(f) / SLANTED).collect()
}
