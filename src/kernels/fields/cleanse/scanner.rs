//! The blur of the scan, from walls against gas.

use glam::DVec3;

use super::{GAS, TISSUE};
use crate::fields::Lumen;
use crate::math::normal;
use crate::volume::Volume;

/// Maximum value of a wall, HU.
const BRIGHT: f64 = 150.0;
/// Minimum number of places for an estimate.
const LEAST: usize = 100;
/// Maximum number of places that are examined.
const MOST: usize = 8_000;

/// Returns the mean of the lumen's gas, away from walls, HU.
pub(super) fn gas_hu(volume: &Volume, lumen: &Lumen) -> f32 {
    let (mut sum, mut count) = (0.0, 0);
    let every = (lumen.gas().runs().len() / MOST).max(1);
    for (j, k, r) in lumen.gas().iter().step_by(every).filter(|(_, _, r)| r.len() > 8) {
        sum += f64::from(volume.get(i64::from(r.start + r.len() / 2), j as i64, k as i64));
        count += 1;
    }
    // In a lumen without width nothing can be measured: the usual value remains.
    ((sum + f64::from(GAS)) / f64::from(count + 1)).clamp(-1050.0, -800.0) as f32
}

/// Estimates the scanner's blur, mm, from walls against gas. Where an edge has passed the share `p`, its slope is
/// `(T − A) φ(Φ⁻¹(p)) / σ`; differences over `±h` add `h²/3` to σ². Returns the median over such voxels.
pub(super) fn blur_mm(volume: &Volume, lumen: &Lumen) -> f64 {
    let grid = volume.grid();
    let spacing = grid.spacing();
    let mut found: Vec<f64> = Vec::new();
    let every = (2 * lumen.gas().runs().len() / MOST).max(3);
    for (j, k, r) in lumen.gas().iter().step_by(every) {
        for i in [i64::from(r.start) - 1, i64::from(r.end)] {
            let v = [i, j as i64, k as i64];
            let hu = |a: usize, d: i64| {
                let mut at = v;
                at[a] += d;
                f64::from(volume.get(at[0], at[1], at[2]))
            };
            let p = (hu(0, 0) - f64::from(GAS)) / f64::from(TISSUE - GAS);
            if !(0.2..0.8).contains(&p) {
                continue;
            }
            let is_tag = (0..3).any(|a| (-4..=4).any(|d| hu(a, d) > BRIGHT));
            if is_tag {
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
    if found.len() < LEAST {
        return 0.65 * grid.min_spacing();
    }
    found.sort_unstable_by(f64::total_cmp);
    found[found.len() / 2].clamp(0.3 * grid.min_spacing(), 3.0)
}
