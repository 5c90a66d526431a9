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
pub(crate) const SHIFT: f64 = -0.421_928_888_748_565_5;

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

/// Returns Φ₂(x, y; ρ), the probability that two normal variables of correlation `rho` are below `x` and `y`.
///
/// Plackett's formula: Φ₂ = Φ(x)Φ(y) + 1/2π ∫ exp(−(x² + y² − 2xy sin θ) / 2cos²θ) dθ, from 0 to asin ρ, by Gauss's rule of five
/// points on six intervals that halve towards its end, where the integrand is steepest. Error below 10⁻⁵ for any correlation.
pub(crate) fn normal_cdf_2(x: f64, y: f64, rho: f64) -> f64 {
    const GAUSS: [(f64, f64); 5] = [
        (0.046_910_077_030_668, 0.118_463_442_528_095),
        (0.230_765_344_947_158_5, 0.239_314_335_249_683),
        (0.5, 0.284_444_444_444_444_4),
        (0.769_234_655_052_841_5, 0.239_314_335_249_683),
        (0.953_089_922_969_332, 0.118_463_442_528_095),
    ];
    let (a, b) = (normal_cdf(x), normal_cdf(y));
    let (least, most) = ((a + b - 1.0).max(0.0), a.min(b));
    // One of the two is certain or impossible, or they are independent or the same.
    if most - least < 1e-9 || rho.abs() < 1e-9 {
        return a * b;
    }
    if rho.abs() > 0.999_99 {
        return if rho > 0.0 { most } else { least };
    }
    let end = rho.asin();
    let (mut sum, mut from) = (0.0, 0.0);
    for interval in 1..=6 {
        let to = if interval == 6 { end } else { end * (1.0 - 0.5f64.powi(interval)) };
        for (at, weight) in GAUSS {
            let (sin, cos) = mix(from, to, at).sin_cos();
            sum += weight * (to - from) * (-0.5 * (x * x + y * y - 2.0 * x * y * sin) / (cos * cos)).exp();
        }
        from = to;
    }
    (a * b + sum / (2.0 * std::f64::consts::PI)).clamp(least, most)
}

/// Returns the tissue fraction of a sheet of tissue, `thickness` mm between its two edges as seen by [`tissue_share`], at a signed
/// distance of `d` mm from the nearer one. Each edge's blur reaches the other one.
pub(crate) fn sheet_share(d: f64, thickness: f64, sigma: f64) -> f64 {
    let u = d / sigma + SHIFT;
    // The edges of the tissue itself are where its share is a half.
    (normal_cdf(u) + normal_cdf(thickness / sigma + 2.0 * SHIFT - u) - 1.0).max(0.0)
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
    use std::f64::consts::TAU;

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

    /// Against the sum over a fine grid, at any angle and at the limits.
    #[test]
    fn the_bivariate_normal_distribution_matches_its_sum() {
        let sum = |x: f64, y: f64, rho: f64| {
            // P(X < x, Y < y) = ∫ φ(t) Φ((y − ρt) / √(1 − ρ²)) dt up to x.
            let (n, lo) = (4000, -7.0f64);
            let h = (x - lo) / f64::from(n);
            let f = |t: f64| (-0.5 * t * t).exp() / TAU.sqrt() * normal_cdf((y - rho * t) / (1.0 - rho * rho).sqrt());
            (0..n).map(|i| f(lo + (f64::from(i) + 0.5) * h) * h).sum::<f64>()
        };
        for rho in [-0.9999, -0.99, -0.9, -0.5, -0.1, 0.0, 0.3, 0.8, 0.97, 0.9995] {
            for (x, y) in [(0.0, 0.0), (1.0, -0.5), (-1.2, -1.0), (2.0, 0.4), (-0.3, 0.31), (0.7, 0.7), (-0.6, 0.6)] {
                let (got, want) = (normal_cdf_2(x, y, rho), sum(x, y, rho));
                assert!((got - want).abs() < 2e-5, "{x}, {y}, {rho}: {got}, not {want}");
            }
        }
        assert_eq!(normal_cdf_2(0.5, 0.2, 1.0), normal_cdf(0.2));
        assert_eq!(normal_cdf_2(0.5, -0.2, -1.0), normal_cdf(0.5) + normal_cdf(-0.2) - 1.0);
        assert_eq!(normal_cdf_2(7.0, 0.3, 0.6), normal_cdf(0.3));
        assert_eq!(normal_cdf_2(-7.0, 0.3, 0.6), 0.0);
        let corner = normal_cdf_2(0.0, 0.0, 0.5);
        assert!((corner - (0.25 + 0.5f64.asin() / TAU)).abs() < 1e-9, "{corner}");
    }

    #[test]
    fn distance_zero_is_the_walls_value() {
        for sigma in [0.2, 0.6] {
            assert!((mix(GAS, TISSUE, tissue_share(0.0, sigma)) - WALL_HU).abs() < 1e-9);
        }
    }
}
