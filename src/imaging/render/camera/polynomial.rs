//! Roots and extremes of polynomials, for the curves of lenses.

/// Returns the value of a polynomial (lowest power first) at `x`.
pub(super) fn value(c: &[f64], x: f64) -> f64 {
    c.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

/// Returns the derivative's coefficients.
pub(super) fn derivative(c: &[f64]) -> Vec<f64> {
    c.iter().enumerate().skip(1).map(|(n, c)| n as f64 * c).collect()
}

/// Returns the coefficients of a product.
pub(super) fn product(a: &[f64], b: &[f64]) -> Vec<f64> {
    let mut all = vec![0.0; (a.len() + b.len()).saturating_sub(1)];
    for (n, x) in a.iter().enumerate() {
        b.iter().enumerate().for_each(|(m, y)| all[n + m] += x * y);
    }
    all
}

/// Returns where a polynomial changes its sign between `from` and `to`, in order.
///
/// Between two neighbouring roots of its derivative a polynomial is monotonic: each change of sign is enclosed there, and bisected.
pub(super) fn roots(c: &[f64], from: f64, to: f64) -> Vec<f64> {
    if c.len() < 2 {
        return Vec::new();
    }
    let turns = roots(&derivative(c), from, to);
    let ends: Vec<f64> = [from].into_iter().chain(turns).chain([to]).collect();
    let mut found = Vec::new();
    for pair in ends.windows(2) {
        let (mut low, mut high) = (pair[0], pair[1]);
        let is_low = value(c, low) < 0.0;
        if is_low == (value(c, high) < 0.0) {
            continue;
        }
        loop {
            let middle = low.midpoint(high);
            if middle <= low || middle >= high {
                break;
            }
            if (value(c, middle) < 0.0) == is_low { low = middle } else { high = middle }
        }
        found.push(high);
    }
    found
}

/// Returns the least and the greatest value of a polynomial between `from` and `to`.
pub(super) fn extremes(c: &[f64], from: f64, to: f64) -> [f64; 2] {
    let places = roots(&derivative(c), from, to).into_iter().chain([from, to]);
    places.map(|x| value(c, x)).fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(v), b.max(v)])
}

/// Solves `of(x).0 = wanted` between `low` and `high`, for a function that grows there. `of` also returns its slope.
///
/// Newton's steps, and the middle of what is left where a step would leave it: the bracket at least halves every second time.
pub(super) fn solve(of: impl Fn(f64) -> (f64, f64), wanted: f64, [mut low, mut high]: [f64; 2], first: f64) -> f64 {
    let mut x = first.clamp(low, high);
    for n in 0..200 {
        let (value, slope) = of(x);
        let error = value - wanted;
        if error == 0.0 {
            return x;
        }
        if error > 0.0 {
            high = x;
        } else {
            low = x;
        }
        let step = x - error / slope;
        let next = if n % 3 < 2 && step > low && step < high { step } else { low.midpoint(high) };
        if (next - x).abs() <= 4.0 * f64::EPSILON * x.abs() || next <= low || next >= high {
            return next;
        }
        x = next;
    }
    x
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn roots_are_where_the_sign_changes() {
        // (x − 1)(x − 2)(x − 3), and x², which touches 0 without changing its sign.
        let found = roots(&[-6.0, 11.0, -6.0, 1.0], 0.0, 10.0);
        assert_eq!(found.len(), 3);
        found.iter().zip([1.0, 2.0, 3.0]).for_each(|(a, b)| assert!((a - b).abs() < 1e-12, "{found:?}"));
        assert!(roots(&[0.0, 0.0, 1.0], -1.0, 1.0).is_empty() && roots(&[3.0], 0.0, 1.0).is_empty());
        assert_eq!(extremes(&[-1.0, 0.0, 1.0], -1.0, 3.0), [-1.0, 8.0]);
        assert_eq!(product(&[1.0, 1.0], &[-1.0, 1.0]), [-1.0, 0.0, 1.0]);
    }

    proptest! {
        #[test]
        fn no_value_is_beyond_the_extremes(c in prop::array::uniform6(-2.0f64..2.0), x in 0.0f64..3.0) {
            let [least, most] = extremes(&c, 0.0, 3.0);
            let v = value(&c, x);
            prop_assert!(v >= least - 1e-9 && v <= most + 1e-9, "{v} {least} {most}");
        }

        #[test]
        fn what_is_solved_is_a_solution(a in 0.01f64..3.0, b in 0.0f64..3.0, x in 0.0f64..4.0, first in 0.0f64..4.0) {
            let of = |x: f64| (a * x + b * x * x * x, a + 3.0 * b * x * x);
            let found = solve(of, of(x).0, [0.0, 4.0], first);
            prop_assert!((found - x).abs() < 1e-9 * (1.0 + x), "{found} {x}");
        }
    }
}
