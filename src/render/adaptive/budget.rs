//! What a picture may cost for the frame time to be kept: a clock's view of a budget in samples.

use std::time::Duration;

/// Time from one picture to the next: sixty a second.
pub const FRAME: Duration = Duration::from_micros(16_667);
/// Share of it that a picture is planned to take, beside its presentation: the rest is for the simulation and for what
/// cannot be predicted.
const PLANNED: f64 = 0.8;
/// A picture is given this share of the frame at the least.
const LEAST: f64 = 0.25;
/// Weight of the newest picture in what samples take, when they take longer than was thought, and when shorter: to be late is
/// noticed, to be early is not.
const SLOWER: f64 = 0.4;
const FASTER: f64 = 0.1;
/// A picture tells of samples so many times slower than was thought at the most.
const HICCUP: f64 = 3.0;
/// What each shown pixel costs whatever is traced, in samples: it is stretched from a coarser picture, and copied. Were it
/// left out, a coarse picture, which is mostly stretching, would make samples look slow and stay coarse.
const SHOWING: u64 = 1;
/// What a sample takes before any was measured, ns.
const FIRST_NS: f64 = 10.0;

/// Turns time into samples by what samples took.
#[derive(Clone, Debug)]
pub struct FrameBudget {
    /// Of a moving picture, and of one that is refined, ns.
    sample_ns: [f64; 2],
}

impl Default for FrameBudget {
    fn default() -> Self {
        Self { sample_ns: [FIRST_NS; 2] }
    }
}

impl FrameBudget {
    /// What tracing the next picture may cost, in samples, of `pixels` pixels and with a presentation that will take
    /// `present_ms`; `rest` for one that is refined.
    pub fn samples(&self, rest: bool, present_ms: f64, pixels: usize) -> u64 {
        let frame_ms = FRAME.as_secs_f64() * 1e3;
        let ms = (frame_ms * PLANNED - present_ms).max(frame_ms * LEAST);
        ((ms * 1e6 / self.sample_ns[usize::from(rest)]) as u64).saturating_sub((pixels as u64).saturating_mul(SHOWING))
    }

    /// Learns that a picture of `pixels` pixels, whose tracing cost `samples`, took `ms`.
    pub fn took(&mut self, rest: bool, samples: u64, pixels: usize, ms: f64) {
        if samples == 0 || !(ms.is_finite() && ms >= 0.0) {
            return;
        }
        let known = &mut self.sample_ns[usize::from(rest)];
        let samples = samples.saturating_add((pixels as u64).saturating_mul(SHOWING));
        // A hiccup of the machine must not blur what follows.
        let now = (ms * 1e6 / samples as f64).min(HICCUP * *known);
        *known += (now - *known) * if now > *known { SLOWER } else { FASTER };
        *known = known.clamp(1e-2, 1e9);
    }

    /// Forgets what samples take: the quality of the pictures has changed.
    pub fn forget(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_samples_take_decides() {
        let mut b = FrameBudget::default();
        for _ in 0..100 {
            b.took(false, 1_000_000, 0, 20.0);
            b.took(true, 900_000, 100_000, 5.0);
        }
        let [moving, still] = [false, true].map(|rest| b.samples(rest, 2.0, 0) as f64);
        assert!((moving * 20e-6 - 11.33).abs() < 0.1 && (still * 5e-6 - 11.33).abs() < 0.1, "{moving} {still}");
        assert!(b.samples(false, 100.0, 0) > 200_000, "a slow screen must not make the picture vanish");
        // Late is learnt quickly.
        b.took(false, 1_000_000, 0, 60.0);
        assert!(b.samples(false, 2.0, 0) as f64 <= moving * 0.6);
    }

    #[test]
    fn nonsense_is_no_fault() {
        let mut b = FrameBudget::default();
        for (samples, ms) in [(0, 5.0), (5, f64::NAN), (5, -1.0), (1, 1e300), (u64::MAX, 0.0)] {
            b.took(true, samples, usize::MAX, ms);
            assert!(b.samples(true, f64::NAN, 0) < u64::MAX);
        }
    }
}
