//! Cubic polynomials, coefficients lowest power first. A trilinear value along a straight line is one.

/// Value at `s`.
#[inline]
pub fn value(c: [f64; 4], s: f64) -> f64 {
    c[0] + s * (c[1] + s * (c[2] + s * c[3]))
}

/// The two zeros of the cubic's derivative, in ascending order; NaN if it has none.
pub fn critical_points([_, b, c, d]: [f64; 4]) -> [f64; 2] {
    // Solves 3d s² + 2c s + b = 0 in the form without cancellation.
    let disc = c * c - 3.0 * d * b;
    if disc < 0.0 {
        return [f64::NAN; 2];
    }
    let q = -(c + disc.sqrt().copysign(c));
    let (x, y) = (q / (3.0 * d), b / q);
    if x > y { [y, x] } else { [x, y] }
}
