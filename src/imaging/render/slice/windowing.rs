//! Windowing: HU to grey.

use fearless_simd::Level;
use rayon::prelude::*;

/// Pixels of a task.
const PART: usize = 1 << 15;

/// A window of HU that is mapped to the greys from black to white.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Windowing {
    level: f64,
    width: f64,
}

impl Default for Windowing {
    /// Level 0, width 2000 HU: gas, wall and tagged fluid.
    fn default() -> Self {
        Self { level: 0.0, width: 2000.0 }
    }
}

impl Windowing {
    /// Creates a window around `level` that is `width` wide, HU.
    ///
    /// # Errors
    /// Returns a short reason if the level is not finite, or the width is not positive and finite.
    pub fn new(level: f64, width: f64) -> Result<Self, String> {
        if !level.is_finite() {
            return Err(format!("a level of {level} HU is not finite"));
        }
        if !(width.is_finite() && width > 0.0) {
            return Err(format!("a width of {width} HU is not positive and finite"));
        }
        Ok(Self { level, width })
    }

    /// Returns the value shown as middle grey, HU.
    pub fn level(self) -> f64 {
        self.level
    }

    /// Returns the range from black to white, HU.
    pub fn width(self) -> f64 {
        self.width
    }

    /// Returns 255 · clamp((HU − L + W/2)/W, 0, 1), rounded.
    #[inline]
    pub fn grey(self, hu: f32) -> u8 {
        let share = ((f64::from(hu) - self.level + self.width / 2.0) / self.width).clamp(0.0, 1.0);
        // Halves round up; the cast truncates.
        (255.0 * share + 0.5) as u8
    }

    /// Converts an image in HU to greys. `out` must have the same length.
    pub fn fill(self, hu: &[f32], out: &mut [u8]) {
        let level = Level::new();
        out.par_chunks_mut(PART).zip(hu.par_chunks(PART)).for_each(|(out, hu)| {
            fearless_simd::dispatch!(level, _simd => self.fill_part(hu, out));
        });
    }

    #[inline(always)]
    fn fill_part(self, hu: &[f32], out: &mut [u8]) {
        for (out, hu) in out.iter_mut().zip(hu) {
            *out = self.grey(*hu);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn greys_are_those_of_the_formula() {
        let w = Windowing::default();
        assert_eq!(
            [-1024.0, -1000.0, -600.0, 0.0, 500.0, 1000.0, 3071.0].map(|hu| w.grey(hu)),
            [0, 0, 51, 128, 191, 255, 255]
        );
        let w = Windowing::new(40.0, 400.0).unwrap();
        assert_eq!([-160.0, 40.0, 240.0].map(|hu| w.grey(hu)), [0, 128, 255]);
        let mut out = [7; 2];
        w.fill(&[f32::NAN, f32::INFINITY], &mut out);
        assert_eq!(out, [0, 255]);
    }

    #[test]
    fn windows_that_are_none_are_refused_and_extreme_ones_taken() {
        for (level, width) in [(0.0, 0.0), (0.0, -1.0), (0.0, f64::NAN), (0.0, f64::INFINITY), (f64::NAN, 1.0)] {
            assert!(Windowing::new(level, width).is_err(), "{level} {width}");
        }
        for width in [f64::MIN_POSITIVE, f64::MAX] {
            for level in [f64::MIN, 0.0, f64::MAX] {
                let w = Windowing::new(level, width).unwrap();
                assert!(w.grey(-1024.0) <= w.grey(3071.0), "{level} {width}");
            }
        }
    }
}
