//! Where the edge of a lesion's tissue is, under the blur of the scan.
//!
//! The wall is drawn at −650 HU, a third of the way from gas to tissue: on an edge that a scanner blurs by a Gaussian of σ mm, that is
//! Φ⁻¹(0.337) σ = 0.42 σ outside of where the tissue ends, which is half-way (FWHM). A blurred ball of radius R has its half-way level at
//! R − σ²/R to first order. Where the ball stands on a wall, the concave seam between the two moves the level the other way: on balls
//! that are half sunk into a wall, half of that is left (an observation on blurred phantoms of exact shape, σ from 0.5 to 1.2 mm).
//! Both depend on the scan and are measured at the lesion itself.

use super::Wall;
use crate::math::ranked::median;
use crate::space::ray::trilinear;
use crate::volume::Volume;

/// Tissue has this value, HU, unless a lesion's inside says that it consists of fat.
const TISSUE_HU: f64 = 40.0;
/// The inside of a lesion of fat, HU.
const FAT_HU: [f64; 2] = [-120.0, -60.0];
/// A lesion whose mean inside is darker than this, and bright nowhere, is fat, HU.
const DARK_HU: f64 = -60.0;
/// Gas is looked for this far before the surface, mm.
const GAS_MM: [f64; 4] = [2.0, 2.5, 3.0, 3.5];
/// Levels are looked for this far before and behind the surface, mm, in such steps.
const REACH_MM: f64 = 3.0;
const STEP_MM: f64 = 0.1;
/// The outer level is this share of the way from gas to tissue; Φ⁻¹ of it is the second number.
const OUTER: (f64, f64) = (0.2, -0.841_621_233_572_914);
/// No scan is blurred more than this, mm.
const MOST_MM: f64 = 2.0;
/// Share of the first-order shift of a ball that is left on a wall.
const ON_WALL: f64 = 0.5;

/// The edge of a lesion's tissue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Edge {
    /// How far within the surface the half-way level is, mm.
    pub(super) shift_mm: f64,
    /// Standard deviation of the blur, mm.
    pub(super) sigma_mm: f64,
}

impl Edge {
    /// Measures the edge at the vertices of a head, whose inside has a mean and a largest value, HU. Returns `None` where fewer than half
    /// of them show one: in a thin fold, beside tag, or where the scan ends.
    pub(super) fn of(wall: &Wall, head: &[u32], volume: &Volume, mean_hu: f64, most_hu: f64) -> Option<Self> {
        let at = |v: u32, mm: f64| {
            let place = wall.world(v) + wall.normal(v).as_dvec3() * mm;
            volume.grid().contains(place).then(|| trilinear(volume, volume.grid().voxel(place)))
        };
        let gas = median(head.iter().flat_map(|&v| GAS_MM.into_iter().filter_map(move |mm| at(v, mm))).collect())?;
        let tissue = if mean_hu < DARK_HU && most_hu < 0.0 { mean_hu.clamp(FAT_HU[0], FAT_HU[1]) } else { TISSUE_HU };
        let range = tissue - gas;
        // Under fluid, or with the wall at another value, there is no such edge.
        if range < 500.0 {
            return None;
        }
        let (mut shifts, mut widths) = (Vec::new(), Vec::new());
        for &v in head {
            let level = |share: f64| crossing(gas + share * range, |mm| at(v, mm));
            if let (Some(half), Some(outer)) = (level(0.5), level(OUTER.0)) {
                shifts.push(-half);
                widths.push(outer - half);
            }
        }
        if 2 * shifts.len() < head.len() {
            return None;
        }
        let sigma_mm = median(widths)? / -OUTER.1;
        let shift_mm = wall.tissue_mm().or_else(|| median(shifts))?;
        (sigma_mm > 0.0).then(|| Self { shift_mm: shift_mm.clamp(-1.0, MOST_MM), sigma_mm: sigma_mm.min(MOST_MM) })
    }

    /// Returns the diameter of the tissue, mm, of a lesion whose surface has this diameter, mm.
    pub(super) fn diameter(&self, surface_mm: f64) -> f64 {
        let radius = (0.5 * surface_mm - self.shift_mm).max(0.25 * surface_mm);
        // Of a lesion that is hardly larger than the blur, the first order says too much.
        2.0 * (radius + ON_WALL * self.sigma_mm.powi(2) / radius.max(self.sigma_mm))
    }
}

/// Returns where along a normal, mm from the surface into the lumen, the values first rise to a level on the way from the lumen into the
/// tissue.
pub(super) fn crossing(level: f64, at: impl Fn(f64) -> Option<f64>) -> Option<f64> {
    let count = (2.0 * REACH_MM / STEP_MM) as usize;
    let mut before = at(REACH_MM)?;
    for n in 1..=count {
        let mm = REACH_MM - n as f64 * STEP_MM;
        let here = at(mm)?;
        if before < level && here >= level {
            return Some(mm + STEP_MM * (here - level) / (here - before));
        }
        before = here;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_outermost_rise_to_a_level_is_found_between_steps() {
        // −1000 at 3 mm in the lumen, rising evenly to 200 at 3 mm in the tissue.
        let even = |mm: f64| Some(-1000.0 + 200.0 * (3.0 - mm));
        assert!((crossing(-650.0, even).unwrap() - 1.25).abs() < 1e-9);
        assert_eq!(crossing(300.0, even), None);
        assert_eq!(crossing(-650.0, |mm: f64| (mm > 2.0).then_some(-1000.0)), None);
    }

    #[test]
    fn a_diameter_stays_one_whatever_the_edge() {
        for (shift_mm, sigma_mm) in [(0.0, 0.01), (2.0, 2.0), (-1.0, 2.0)] {
            for surface_mm in [0.5, 3.0, 40.0] {
                let mm = Edge { shift_mm, sigma_mm }.diameter(surface_mm);
                assert!(mm > 0.0 && mm < surface_mm + 5.0, "{shift_mm} {sigma_mm} {surface_mm}: {mm}");
            }
        }
        let edge = Edge { shift_mm: 0.42 * 0.7, sigma_mm: 0.7 };
        assert!((edge.diameter(10.0) - (10.0 - 0.588 + 0.104)).abs() < 1e-3);
    }
}
