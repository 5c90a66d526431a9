//! Scalar functions that turn distances into Hounsfield units.

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

/// The argument where the normal distribution equals (WALL_HU − GAS) / (TISSUE − GAS). It makes distance 0 exactly
/// [`WALL_HU`].
const SHIFT: f64 = -0.421_928_888_748_565_5;

/// Returns Φ(x), the cumulative normal distribution, by Marsaglia's series ("Evaluating the normal distribution",
/// 2004): Φ = ½ + φ(x)·(x + x³/3 + x⁵/(3·5) + …). Beyond |x| = 6 it returns 0 or 1 (error 10⁻⁹).
pub(crate) fn normal_cdf(x: f64) -> f64 {
    if x.abs() >= 6.0 {
        return if x < 0.0 { 0.0 } else { 1.0 };
    }
    let square = x * x;
    let (mut term, mut sum, mut odd) = (x, x, 1.0);
    while term.abs() > 1e-17 {
        odd += 2.0;
        term *= square / odd;
        sum += term;
    }
    0.5 + sum * (-0.5 * square).exp() / (2.0 * std::f64::consts::PI).sqrt()
}

/// Returns the tissue fraction at a signed distance of `d` mm from the wall (positive in tissue), for a scanner blur of
/// `sigma` mm.
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

/// Returns a C1 maximum: the larger value where `a` and `b` differ by `k` or more, and `k`/4 above where they are
/// equal.
#[inline]
pub(crate) fn smooth_max(a: f64, b: f64, k: f64) -> f64 {
    let h = (k - (a - b).abs()).max(0.0);
    a.max(b) + h * h / (4.0 * k)
}

/// Returns the C1 minimum that corresponds to [`smooth_max`].
#[inline]
pub(crate) fn smooth_min(a: f64, b: f64, k: f64) -> f64 {
    -smooth_max(-a, -b, k)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_normal_distribution_matches_its_table() {
        for (x, phi) in
            [(0.0, 0.5), (1.0, 0.841_344_746_068_543), (-1.96, 0.024_997_895_148_220), (5.0, 1.0 - 2.866_5e-7)]
        {
            assert!((normal_cdf(x) - phi).abs() < 1e-11, "{x}");
        }
        assert!(normal_cdf(5.999_999) <= 1.0 && normal_cdf(-5.999_999) >= -1e-12);
    }

    #[test]
    fn distance_zero_is_the_walls_value() {
        for sigma in [0.2, 0.6] {
            assert!((mix(GAS, TISSUE, tissue_share(0.0, sigma)) - WALL_HU).abs() < 1e-9);
        }
    }
}
