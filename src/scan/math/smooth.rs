//! Smooth minima and maxima, which join bodies with a fillet.

/// Returns a C1 maximum: the larger value where `a` and `b` differ by `k` or more, and `k`/4 above where they are equal.
#[inline]
pub fn max(a: f64, b: f64, k: f64) -> f64 {
    let h = (k - (a - b).abs()).max(0.0);
    a.max(b) + h * h / (4.0 * k)
}

/// Returns the C1 minimum that corresponds to [`max`].
#[inline]
pub fn min(a: f64, b: f64, k: f64) -> f64 {
    -max(-a, -b, k)
}
