//! The budget of samples with which a picture keeps the frame time, derived from a clock.

use std::time::Duration;

/// Time from one picture to the next, at sixty a second.
#[doc(hidden)]
pub const FRAME: Duration = Duration::from_micros(16_667);
/// On a machine that is busy with other tasks, the rate drops to half before pictures become coarser than three quarters of the side that
/// they would have otherwise, and even lower before they become coarser than half of it.
const SLOW_FRAME: Duration = FRAME.saturating_mul(2);
/// Share of the frame time planned for a picture and its presentation. The rest is for the simulation and for whatever
/// cannot be predicted.
const PLANNED: f64 = 0.8;
/// Least share of the frame that a picture gets.
const LEAST: f64 = 0.25;
/// The time per sample is the third slowest of this many pictures. One or two hiccups of the machine change nothing,
/// and a lasting change is known after a twentieth of a second.
const REMEMBERED: usize = 8;
const RANK: usize = 2;
/// The median shows what lasts: three hiccups do not, and a machine that has become busy is known after a twelfth of a second.
const LASTING: usize = 4;
/// Three quarters of the side are worth a picture that is planned to take this many times as long.
const LATE: f64 = 1.25;
/// Cost of four shown pixels, in samples, however few are traced: they are copied.
const SHOWING: u64 = 1;
/// Time per sample before any was measured, ns: that of two present-day cores.
const FIRST_NS: f64 = 2.2;

/// The cost that a picture may have, in samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// A picture is as fine as this allows.
    pub samples: u64,
    /// A picture is at least three quarters of its side while this allows that size. No hiccup changes this number.
    pub lasting: u64,
    /// A picture is no coarser than half its side while that size costs no more than this.
    pub at_half: u64,
}

impl Budget {
    /// Creates a budget of this many samples, however coarse a picture has to become for it.
    pub const fn strict(samples: u64) -> Self {
        Self { samples, lasting: samples, at_half: samples }
    }
}

/// The recent time per sample.
#[derive(Clone, Debug)]
struct SampleTime {
    /// Times of the last pictures, ns; the newest replaces the oldest.
    recent: [f64; REMEMBERED],
    next: usize,
    /// The fastest time that was ever usual: that of a quiet machine, ns.
    quiet: f64,
}

impl Default for SampleTime {
    fn default() -> Self {
        Self { recent: [FIRST_NS; REMEMBERED], next: 0, quiet: FIRST_NS }
    }
}

impl SampleTime {
    /// Returns the current time per sample, ns: the slowest of the last pictures except for `rank` others.
    fn slowest(&self, rank: usize) -> f64 {
        let mut sorted = self.recent;
        sorted.sort_by(|a, b| b.total_cmp(a));
        sorted[rank]
    }

    fn took(&mut self, ns: f64) {
        self.recent[self.next] = ns.clamp(1e-2, 1e9);
        self.next = (self.next + 1) % REMEMBERED;
        self.quiet = self.quiet.min(self.slowest(RANK));
    }
}

/// Turns time into samples, using measured times per sample.
#[derive(Clone, Debug, Default)]
#[doc(hidden)]
pub struct FrameBudget {
    moving: SampleTime,
    refined: SampleTime,
}

impl FrameBudget {
    /// Returns the cost that tracing the next picture may have.
    ///
    /// The picture has `pixels` pixels, and its presentation will take `present_ms` milliseconds. `rest` is true for a
    /// picture that is being refined.
    #[doc(hidden)]
    pub fn next(&self, rest: bool, present_ms: f64, pixels: usize) -> Budget {
        let time = if rest { &self.refined } else { &self.moving };
        let ms = |frame: Duration| frame.as_secs_f64() * 1e3;
        let planned = (ms(FRAME) * PLANNED - present_ms).max(ms(FRAME) * LEAST);
        let showing = pixels as u64 / 4 * SHOWING;
        let samples = |ms: f64, ns: f64| ((ms * 1e6 / ns) as u64).saturating_sub(showing);
        let slow = ms(SLOW_FRAME) * PLANNED;
        let lasting = time.slowest(LASTING);
        Budget {
            samples: samples(planned, time.slowest(RANK)),
            lasting: samples(planned * LATE, lasting)
                .max(samples(planned * LATE, time.quiet).min(samples(slow - present_ms, lasting))),
            at_half: samples(slow, time.quiet),
        }
    }

    /// Records that a picture of `pixels` pixels, whose tracing cost `samples`, took `ms` milliseconds.
    #[doc(hidden)]
    pub fn took(&mut self, rest: bool, samples: u64, pixels: usize, ms: f64) {
        if samples == 0 || !(ms.is_finite() && ms >= 0.0) {
            return;
        }
        let samples = samples.saturating_add(pixels as u64 / 4 * SHOWING);
        let time = if rest { &mut self.refined } else { &mut self.moving };
        time.took(ms * 1e6 / samples as f64);
    }

    /// Forgets the times per sample, because the quality of the pictures has changed.
    #[doc(hidden)]
    pub fn forget(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_that_are_none_are_not_counted() {
        for rest in [false, true] {
            let mut b = FrameBudget::default();
            let before = b.next(rest, 0.0, 1000);
            for ms in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -1.0, -1e9] {
                (0..100).for_each(|_| b.took(rest, 1_000_000, 1000, ms));
            }
            b.took(rest, 0, 1000, 5.0);
            assert_eq!(b.next(rest, 0.0, 1000), before);
            (0..100).for_each(|_| b.took(rest, 1_000_000, 1000, 50.0));
            assert_ne!(b.next(rest, 0.0, 1000), before);
        }
    }

    #[test]
    fn what_samples_take_decides() {
        let mut b = FrameBudget::default();
        for _ in 0..100 {
            b.took(false, 1_000_000, 0, 20.0);
            b.took(true, 975_000, 100_000, 5.0);
        }
        let [moving, still] = [false, true].map(|rest| b.next(rest, 2.0, 0).samples as f64);
        assert!((moving * 20e-6 - 11.33).abs() < 0.1 && (still * 5e-6 - 11.33).abs() < 0.1, "{moving} {still}");
        assert!(b.next(false, 100.0, 0).samples > 200_000, "a slow screen must not make the picture vanish");
    }

    #[test]
    fn a_hiccup_changes_nothing_and_what_lasts_is_known_at_once() {
        let mut b = FrameBudget::default();
        for _ in 0..20 {
            b.took(false, 3_000_000, 0, 6.0);
        }
        let quiet = b.next(false, 2.0, 0);
        b.took(false, 3_000_000, 0, 60.0);
        b.took(false, 3_000_000, 0, 60.0);
        assert_eq!(b.next(false, 2.0, 0), quiet);
        b.took(false, 3_000_000, 0, 18.0);
        let busy = b.next(false, 2.0, 0);
        assert_eq!(busy.samples, quiet.samples / 3);
        assert_eq!(busy.lasting, quiet.lasting, "three hiccups do not last");
        b.took(false, 3_000_000, 0, 18.0);
        b.took(false, 3_000_000, 0, 18.0);
        // Three quarters of the side come at thirty a second, as far as the quiet machine had them at sixty.
        let busy = b.next(false, 2.0, 0);
        let slow = 3e6 * (FRAME.as_secs_f64() * 2e3 * PLANNED - 2.0) / 18.0;
        assert!((busy.lasting as f64 - slow).abs() < 2.0 && busy.lasting < quiet.lasting, "{busy:?}");
        assert_eq!(busy.samples, quiet.samples / 3);
        assert_eq!(busy.at_half, quiet.at_half, "a busy machine is no slow one");
        for _ in 0..REMEMBERED {
            b.took(false, 3_000_000, 0, 6.0);
        }
        assert_eq!(b.next(false, 2.0, 0), quiet);
    }

    #[test]
    fn nonsense_is_no_fault() {
        let mut b = FrameBudget::default();
        for (samples, ms) in [(0, 5.0), (5, f64::NAN), (5, -1.0), (1, 1e300), (u64::MAX, 0.0)] {
            for _ in 0..REMEMBERED {
                b.took(true, samples, usize::MAX, ms);
            }
            assert!(b.next(true, f64::NAN, 0).samples < u64::MAX);
        }
    }
}
