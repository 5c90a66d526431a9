//! Scalar functions that turn distances into Hounsfield units.

pub(crate) use crate::math::normal::{cdf as normal_cdf, cdf_2 as normal_cdf_2};

/// Gas, HU.
pub(crate) const GAS: f64 = -1000.0;
/// The colon's wall, folds, polyps and bridges, HU.
pub(crate) const TISSUE: f64 = 40.0;
/// Tagged fluid, HU.
pub(crate) const FLUID: f64 = 450.0;
/// Mesenteric and subcutaneous fat, HU.
pub(crate) const FAT: f64 = -100.0;
/// The wall's iso-value, HU: the middle of the default opacity ramp.
pub(crate) const WALL_HU: f64 = -650.0;

/// The argument where the normal distribution equals (WALL_HU − GAS) / (TISSUE − GAS). It makes distance 0 exactly [`WALL_HU`].
pub(crate) const SHIFT: f64 = -0.421_928_888_748_565_5;

/// Returns the tissue fraction of a sheet of tissue, `thickness` mm between its two edges as seen by [`tissue_share`], at a signed
/// distance of `d` mm from the nearer one. Each edge's blur reaches the other one.
pub(crate) fn sheet_share(d: f64, thickness: f64, sigma: f64) -> f64 {
    let u = d / sigma + SHIFT;
    // The edges of the tissue itself are where its share is a half.
    (normal_cdf(u) + normal_cdf(thickness / sigma + 2.0 * SHIFT - u) - 1.0).max(0.0)
}

/// Returns the tissue fraction at a signed distance of `d` mm from the wall (positive in tissue), for a scanner blur of `sigma` mm.
pub(crate) fn tissue_share(d: f64, sigma: f64) -> f64 {
    normal_cdf(d / sigma + SHIFT)
}

/// Interpolates linearly: `a` at `t` = 0, `b` at `t` = 1.
#[inline]
pub(crate) fn mix(a: f64, b: f64, t: f64) -> f64 {
    a + (b - a) * t
}

/// Returns the cubic step from 0 at `lo` to 1 at `hi`.
#[inline]
pub(crate) fn smooth_step(lo: f64, hi: f64, x: f64) -> f64 {
    let t = ((x - lo) / (hi - lo)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

pub(crate) use crate::math::smooth::{max as smooth_max, min as smooth_min};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distance_zero_is_the_walls_value() {
        for sigma in [0.2, 0.6] {
            assert!((mix(GAS, TISSUE, tissue_share(0.0, sigma)) - WALL_HU).abs() < 1e-9);
        }
    }
}
