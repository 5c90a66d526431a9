//! What a picture may cost for the frame time to be kept: a clock's view of a budget in samples.

use std::time::Duration;

/// Time from one picture to the next: sixty a second.
pub const FRAME: Duration = Duration::from_micros(16_667);
/// Pictures come at half that rate before a machine that is busy with other things makes them coarser than half their side.
const SLOW_FRAME: Duration = FRAME.saturating_mul(2);
/// Share of it that a picture is planned to take, beside its presentation: the rest is for the simulation and for what
/// cannot be predicted.
const PLANNED: f64 = 0.8;
/// A picture is given this share of the frame at the least.
const LEAST: f64 = 0.25;
/// What samples take is the third slowest of so many pictures: one or two hiccups of the machine change nothing, and what
/// lasts is known after a twentieth of a second.
const REMEMBERED: usize = 8;
const RANK: usize = 2;
/// Their median says what lasts: three hiccups do not, and a machine that has become busy is known after a twelfth of a second.
const LASTING: usize = 4;
/// Three quarters of the side are worth a picture that is planned to take so many times as long.
const LATE: f64 = 1.25;
/// What four shown pixels cost whatever is traced, in samples: they are copied.
const SHOWING: u64 = 1;
/// What a sample takes before any was measured, ns: what it takes two cores of today.
const FIRST_NS: f64 = 2.2;

/// What a picture may cost, in samples ([`cost`](super::cost)).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// A picture is as fine as this allows.
    pub samples: u64,
    /// It is no coarser than three quarters of its side while this allows that, which no hiccup changes.
    pub lasting: u64,
    /// It is no coarser than half its side while that costs no more than this.
    pub at_half: u64,
}

impl Budget {
    /// So many samples, whatever has to become coarse for that.
    pub const fn strict(samples: u64) -> Self {
        Self { samples, lasting: samples, at_half: samples }
    }
}

/// What samples took of late.
#[derive(Clone, Debug)]
struct SampleTime {
    /// Of the last pictures, ns, the newest replacing the oldest.
    recent: [f64; REMEMBERED],
    next: usize,
    /// The fastest that was ever usual: that of a quiet machine.
    quiet: f64,
}

impl Default for SampleTime {
    fn default() -> Self {
        Self { recent: [FIRST_NS; REMEMBERED], next: 0, quiet: FIRST_NS }
    }
}

impl SampleTime {
    /// What a sample takes now, ns: the slowest of the last pictures but for `rank` others.
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

/// Turns time into samples by what samples took.
#[derive(Clone, Debug, Default)]
pub struct FrameBudget {
    moving: SampleTime,
    refined: SampleTime,
}

impl FrameBudget {
    /// What tracing the next picture may cost, of `pixels` pixels and with a presentation that will take `present_ms`;
    /// `rest` for one that is refined.
    pub fn next(&self, rest: bool, present_ms: f64, pixels: usize) -> Budget {
        let time = if rest { &self.refined } else { &self.moving };
        let ms = |frame: Duration| frame.as_secs_f64() * 1e3;
        let planned = (ms(FRAME) * PLANNED - present_ms).max(ms(FRAME) * LEAST);
        let showing = pixels as u64 / 4 * SHOWING;
        let samples = |ms: f64, ns: f64| ((ms * 1e6 / ns) as u64).saturating_sub(showing);
        Budget {
            samples: samples(planned, time.slowest(RANK)),
            lasting: samples(planned * LATE, time.slowest(LASTING)),
            at_half: samples(ms(SLOW_FRAME) * PLANNED, time.quiet),
        }
    }

    /// Learns that a picture of `pixels` pixels, whose tracing cost `samples`, took `ms`.
    pub fn took(&mut self, rest: bool, samples: u64, pixels: usize, ms: f64) {
        if samples == 0 || !(ms.is_finite() && ms >= 0.0) {
            return;
        }
        let samples = samples.saturating_add(pixels as u64 / 4 * SHOWING);
        let time = if rest { &mut self.refined } else { &mut self.moving };
        time.took(ms * 1e6 / samples as f64);
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
        assert_eq!(b.next(false, 2.0, 0).lasting, quiet.lasting / 3);
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
