//! Counter-based pseudo-random numbers. A value depends on its counter, not on the order of calls, so any number of
//! threads draws the same numbers.

/// SplitMix64's output function (Steele, Lea, Flood 2014) of `seed` and `counter`: 64 well-mixed bits.
#[inline]
pub fn bits(seed: u64, counter: u64) -> u64 {
    let mut z = seed ^ counter.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// Returns a uniform number in `[0, 1)`.
#[inline]
pub fn uniform(seed: u64, counter: u64) -> f64 {
    (bits(seed, counter) >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
}

/// Returns an approximately normal number with mean 0 and standard deviation 1: the sum of four 16-bit uniforms
/// (Irwin–Hall of order 4).
#[inline]
pub fn normal(seed: u64, counter: u64) -> f64 {
    let b = bits(seed, counter);
    let sum: u64 = (0..4).map(|k| (b >> (16 * k)) & 0xFFFF).sum();
    // Each uniform has variance 1/12, so the sum of four has 1/3.
    (sum as f64 / 65535.0 - 2.0) * 3f64.sqrt()
}

/// A stream of random numbers: each draw has the next counter. Streams of one seed are independent of each other.
#[derive(Clone, Debug)]
pub struct Stream {
    seed: u64,
    next: u64,
}

impl Stream {
    /// Returns a stream of a seed, by its number.
    pub fn new(seed: u64, stream: u64) -> Self {
        Self { seed: bits(seed, stream), next: 0 }
    }

    /// Draws a number from `lo` to `hi`.
    pub fn within(&mut self, lo: f64, hi: f64) -> f64 {
        self.next += 1;
        lo + (hi - lo) * uniform(self.seed, self.next)
    }

    /// Draws a number below `count`, which is not 0.
    pub fn below(&mut self, count: usize) -> usize {
        (self.within(0.0, count as f64) as usize).min(count.saturating_sub(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments() {
        let n = 200_000;
        let (mut m, mut v, mut u) = (0.0, 0.0, 0.0);
        for i in 0..n {
            let x = normal(7, i);
            m += x;
            v += x * x;
            u += uniform(9, i);
        }
        let n = n as f64;
        assert!((m / n).abs() < 0.01 && (v / n - 1.0).abs() < 0.02 && (u / n - 0.5).abs() < 0.005);
    }
}
