//! The normal distribution.

/// Returns Φ(x), the cumulative normal distribution, by Marsaglia's series ("Evaluating the normal distribution",
/// 2004): Φ = ½ + φ(x)·(x + x³/3 + x⁵/(3·5) + …). Beyond |x| = 6 it returns 0 or 1 (error 10⁻⁹).
pub fn cdf(x: f64) -> f64 {
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

/// Returns Φ⁻¹(p), from −6 to 6, by Newton's method, which halves the interval that holds the root where a step would leave it. Order 2;
/// it stops at steps below 10⁻¹⁴. It begins where a rational function is, which is right to 4.5·10⁻⁴ (Hastings 1955; Abramowitz and Stegun
/// 26.2.23).
pub fn quantile(p: f64) -> f64 {
    let (mut low, mut high) = (-6.0, 6.0);
    let tail = p.min(1.0 - p);
    let mut x = 0.0;
    if tail > 1e-8 {
        let t = (-2.0 * tail.ln()).sqrt();
        let by = 1.0 + t * (1.432_788 + t * (0.189_269 + t * 0.001_308));
        x = (t - (2.515_517 + t * (0.802_853 + t * 0.010_328)) / by).copysign(p - 0.5);
    }
    for _ in 0..60 {
        let error = cdf(x) - p;
        *(if error < 0.0 { &mut low } else { &mut high }) = x;
        let newton = x - error * (0.5 * x * x).exp() * (2.0 * std::f64::consts::PI).sqrt();
        let next: f64 = if low < newton && newton < high { newton } else { 0.5 * (low + high) };
        if (next - x).abs() < 1e-14 {
            return next;
        }
        x = next;
    }
    x
}

/// Returns Φ₂(x, y; ρ), the probability that two normal variables of correlation `rho` are below `x` and `y`.
///
/// Plackett's formula: Φ₂ = Φ(x)Φ(y) + 1/2π ∫ exp(−(x² + y² − 2xy sin θ) / 2cos²θ) dθ, from 0 to asin ρ, by Gauss's rule of five
/// points on six intervals that halve towards its end, where the integrand is steepest. Error below 10⁻⁵ for any correlation.
pub fn cdf_2(x: f64, y: f64, rho: f64) -> f64 {
    const GAUSS: [(f64, f64); 5] = [
        (0.046_910_077_030_668, 0.118_463_442_528_095),
        (0.230_765_344_947_158_5, 0.239_314_335_249_683),
        (0.5, 0.284_444_444_444_444_4),
        (0.769_234_655_052_841_5, 0.239_314_335_249_683),
        (0.953_089_922_969_332, 0.118_463_442_528_095),
    ];
    let (a, b) = (cdf(x), cdf(y));
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
            let (sin, cos) = (from + (to - from) * at).sin_cos();
            sum += weight * (to - from) * (-0.5 * (x * x + y * y - 2.0 * x * y * sin) / (cos * cos)).exp();
        }
        from = to;
    }
    (a * b + sum / (2.0 * std::f64::consts::PI)).clamp(least, most)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    #[test]
    fn the_quantile_undoes_the_distribution() {
        for n in -480..=480 {
            let x = f64::from(n) * 0.01;
            // The distribution is exact to 10⁻¹⁵, which is more in x where it is flat.
            let exact = 1e-14 + 4e-16 * (0.5 * x * x).exp() * TAU.sqrt();
            assert!((quantile(cdf(x)) - x).abs() < 10.0 * exact, "{x}: {}", quantile(cdf(x)));
        }
        for (p, x) in [(0.0, -6.0), (1.0, 6.0), (-3.0, -6.0), (f64::INFINITY, 6.0), (f64::NAN, -6.0)] {
            assert!((quantile(p) - x).abs() < 1e-6, "{p}: {}", quantile(p));
        }
    }

    #[test]
    fn the_normal_distribution_matches_its_table() {
        for (x, phi) in
            [(0.0, 0.5), (1.0, 0.841_344_746_068_543), (-1.96, 0.024_997_895_148_220), (5.0, 1.0 - 2.866_5e-7)]
        {
            assert!((cdf(x) - phi).abs() < 1e-11, "{x}");
        }
        assert!(cdf(5.999_999) <= 1.0 && cdf(-5.999_999) >= -1e-12);
        for p in [0.001, 0.2, 0.5, 0.77, 0.9999] {
            assert!((cdf(quantile(p)) - p).abs() < 1e-12, "{p}");
        }
        assert!(quantile(0.0) < -5.9 && quantile(1.0) > 5.9 && quantile(f64::NAN).is_finite());
    }

    /// Against the sum over a fine grid, at any angle and at the limits.
    #[test]
    fn the_bivariate_normal_distribution_matches_its_sum() {
        let sum = |x: f64, y: f64, rho: f64| {
            // P(X < x, Y < y) = ∫ φ(t) Φ((y − ρt) / √(1 − ρ²)) dt up to x.
            let (n, lo) = (4000, -7.0f64);
            let h = (x - lo) / f64::from(n);
            let f = |t: f64| (-0.5 * t * t).exp() / TAU.sqrt() * cdf((y - rho * t) / (1.0 - rho * rho).sqrt());
            (0..n).map(|i| f(lo + (f64::from(i) + 0.5) * h) * h).sum::<f64>()
        };
        for rho in [-0.9999, -0.99, -0.9, -0.5, -0.1, 0.0, 0.3, 0.8, 0.97, 0.9995] {
            for (x, y) in [(0.0, 0.0), (1.0, -0.5), (-1.2, -1.0), (2.0, 0.4), (-0.3, 0.31), (0.7, 0.7), (-0.6, 0.6)] {
                let (got, want) = (cdf_2(x, y, rho), sum(x, y, rho));
                assert!((got - want).abs() < 2e-5, "{x}, {y}, {rho}: {got}, not {want}");
            }
        }
        assert_eq!(cdf_2(0.5, 0.2, 1.0), cdf(0.2));
        assert_eq!(cdf_2(0.5, -0.2, -1.0), cdf(0.5) + cdf(-0.2) - 1.0);
        assert_eq!(cdf_2(7.0, 0.3, 0.6), cdf(0.3));
        assert_eq!(cdf_2(-7.0, 0.3, 0.6), 0.0);
        let corner = cdf_2(0.0, 0.0, 0.5);
        assert!((corner - (0.25 + 0.5f64.asin() / TAU)).abs() < 1e-9, "{corner}");
    }
}
