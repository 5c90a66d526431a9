//! What the rays of smooth blocks predict of the rays between them.
//!
//! Five rays of a block, its corners and its centre, determine a quadratic polynomial of the place in the picture but for how its curvature
//! is divided between the two axes:
//!
//! ```text
//! f(x, y) = e + gx x + gy y + t x y + k (x² + y²) / 2 + …,
//! ```
//!
//! which is not asked for: the quarters' centres are on the diagonals, and for the middle of a side the block beyond has its part. Both are
//! exact for quadratic polynomials, so that errors shrink with the third power of the side.

use fearless_simd::{Simd, f32x16};

/// Number of rays that a block predicts: the middles of two of its sides, and the centres of its quarters.
pub(super) const REST: usize = 6;

/// Returns what the rays of sixteen wide blocks (corners, then centre), the centres of the blocks above and to the left, and the other
/// corners of those predict: the middles of the top and left sides, and the centres of the quarters, row by row.
#[inline(always)]
pub(super) fn predicted<S: Simd>(
    [a, b, c, d, e]: [f32x16<S>; 5],
    [above, above_left, above_right]: [f32x16<S>; 3],
    [left, left_top, left_bottom]: [f32x16<S>; 3],
) -> [f32x16<S>; REST] {
    // How much a centre differs from the corners' mean. No closures: they do not inherit the level's instructions.
    let own = e - (a + b + c + d) * 0.25;
    let over = above - (above_left + above_right + a + b) * 0.25;
    let beside = left - (left_top + left_bottom + a + c) * 0.25;
    let top = (a + b + e + above + own + over) * 0.25;
    let side = (a + c + e + left + own + beside) * 0.25;
    let (base, x, y) = (e - own * 0.25, (b + d - a - c) * 0.125, (c + d - a - b) * 0.125);
    let twist = (a + d - b - c) * 0.0625;
    [top, side, base - x - y + twist, base + x - y - twist, base - x + y - twist, base + x + y + twist]
}

#[cfg(test)]
mod tests {
    use std::array::from_fn;

    use fearless_simd::{Level, prelude::*};
    use proptest::prelude::*;

    use super::*;

    /// Returns what wide blocks of the side 2 predict of `f` around (`x`, `y`), and what is there.
    fn compare(f: impl Fn(f64, f64) -> f64, [x, y]: [f64; 2], half: f64) -> [[f64; REST]; 2] {
        let at = |u: f64, v: f64| f(x + u * half, y + v * half);
        let lanes = |u: f64, v: f64| [at(u, v) as f32; 16];
        let own = [lanes(-1.0, -1.0), lanes(1.0, -1.0), lanes(-1.0, 1.0), lanes(1.0, 1.0), lanes(0.0, 0.0)];
        let above = [lanes(0.0, -2.0), lanes(-1.0, -3.0), lanes(1.0, -3.0)];
        let left = [lanes(-2.0, 0.0), lanes(-3.0, -1.0), lanes(-3.0, 1.0)];
        let found = fearless_simd::dispatch!(Level::new(), simd => {
            let load = |v: &[f32; 16]| f32x16::load_array_ref(simd, v);
            predicted(own.each_ref().map(load), above.each_ref().map(load), left.each_ref().map(load)).map(|v| f64::from(v.to_array()[7]))
        });
        let places = [[0.0, -1.0], [-1.0, 0.0], [-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5], [0.5, 0.5]];
        [found, places.map(|[u, v]| at(u, v))]
    }

    /// Errors of what is predicted shrink with the third power of the side or faster.
    #[test]
    fn the_order_is_three() {
        let f = |x: f64, y: f64| (0.9 * x + 0.3).sin() * (0.7 * y - 0.2).cos() + 0.2 * (x * y).sin();
        let worst = |half: f64| {
            let places = (0..40).map(|n| [0.31 * f64::from(n % 7) - 1.0, 0.27 * f64::from(n / 7) - 0.8]);
            let errors = places.flat_map(|at| {
                let [found, truth] = compare(f, at, half);
                from_fn::<f64, REST, _>(|n| (found[n] - truth[n]).abs())
            });
            errors.fold(0.0, f64::max)
        };
        let [coarse, fine] = [worst(0.4), worst(0.2)];
        let order = (coarse / fine).log2();
        assert!((2.7..4.5).contains(&order) && fine > 1e-5, "{coarse} {fine}: {order}");
    }

    proptest! {
        #[test]
        fn what_is_quadratic_is_predicted_exactly(k in prop::array::uniform6(-1.0f64..1.0), x in -2.0f64..2.0, y in -2.0f64..2.0) {
            let f = |x: f64, y: f64| k[0] + k[1] * x + k[2] * y + k[3] * x * x + k[4] * x * y + k[5] * y * y;
            let [found, truth] = compare(f, [x, y], 0.8);
            for n in 0..REST {
                prop_assert!((found[n] - truth[n]).abs() < 3e-5, "{n}: {found:?} {truth:?}");
            }
        }
    }
}
