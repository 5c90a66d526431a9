//! Angles of sixteen directions at once.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

/// Beyond this ratio, tan π/8, the angle is measured from π/4.
const EIGHTH: f64 = 0.414_213_562_373_095_05;
/// Numerator and denominator for the arctangent, highest power of x² first: atan x = x + x·x²·P(x²)/Q(x²), to within 2e-16 of the angle for
/// |x| ≤ 0.66 (Moshier, Methods and Programs for Mathematical Functions, 1989).
const P: [f64; 5] = [
    -8.750_608_600_031_904e-1,
    -1.615_753_718_733_365e1,
    -7.500_855_792_314_705e1,
    -1.228_866_684_490_136_1e2,
    -6.485_021_904_942_025e1,
];
const Q: [f64; 6] = [
    1.0,
    2.485_846_490_142_306_2e1,
    1.650_270_098_316_988_6e2,
    4.328_810_604_912_903e2,
    4.853_903_996_359_137e2,
    1.945_506_571_482_614e2,
];

/// Returns the angle of (x, y) from −π to π as [`f64::atan2`] does, to within 1e-15; 0 for no direction. Without branches, so that several
/// are computed with each instruction.
#[inline(always)]
pub(super) fn angle(y: f64, x: f64) -> f64 {
    let (up, right) = (y.abs(), x.abs());
    let (less, more) = if up < right { (up, right) } else { (right, up) };
    let ratio = less / more.max(f64::MIN_POSITIVE);
    let is_wide = ratio > EIGHTH;
    let t = if is_wide { (ratio - 1.0) / (ratio + 1.0) } else { ratio };
    let z = t * t;
    let p = (((P[0] * z + P[1]) * z + P[2]) * z + P[3]) * z + P[4];
    let q = ((((Q[0] * z + Q[1]) * z + Q[2]) * z + Q[3]) * z + Q[4]) * z + Q[5];
    let near = t + t * z * p / q;
    let near = if is_wide { near + FRAC_PI_4 } else { near };
    let near = if up < right { near } else { FRAC_PI_2 - near };
    let near = if x < 0.0 { PI - near } else { near };
    // Nothing at all points along x.
    let near = if more > 0.0 { near } else { 0.0 };
    near.copysign(y)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_those_of_the_library() {
        for n in 0..100_000 {
            let at = f64::from(n) * PI / 50_000.0 - PI;
            for r in [1e-200, 1e-3, 1.0, 1e200] {
                let (x, y) = (r * at.cos(), r * at.sin());
                assert!((angle(y, x) - y.atan2(x)).abs() <= 1e-15, "{at} {r}");
            }
        }
        for (y, x) in [(0.0, 1.0), (1.0, 0.0), (-1.0, 0.0), (0.0, -1.0), (0.0, 0.0)] {
            assert!((angle(y, x) - f64::atan2(y, x)).abs() <= 1e-15, "{y} {x}");
        }
    }
}
