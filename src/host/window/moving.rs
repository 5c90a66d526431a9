//! Statistics of the size and rate of pictures while the camera moves.

use std::collections::VecDeque;
use std::time::Instant;

use serde::Serialize;

/// Maximum number of samples: an hour at sixty per second.
const KEPT: usize = 216_000;

/// Statistics of pictures of a moving camera in a window.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[doc(hidden)]
pub struct Moving {
    /// All of them.
    #[serde(flatten)]
    pub all: Pictures,
    /// Those beside which the other position's flight was rendered too; `None` if there were none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub both: Option<Pictures>,
}

/// Size and rate of pictures.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[doc(hidden)]
pub struct Pictures {
    /// Number of pictures.
    pub pictures: usize,
    /// Side of the rendered picture relative to the window's.
    pub side: Side,
    /// Time from one picture to the next, ms.
    pub interval_ms: Interval,
}

/// Relative sides of pictures, 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[doc(hidden)]
pub struct Side {
    /// Half of the pictures are at least this large.
    pub median: f64,
    /// 99 % of the pictures are at least this large.
    pub p01: f64,
}

/// Times between pictures, ms.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[doc(hidden)]
pub struct Interval {
    /// Half of the intervals are at most this long.
    pub median: f64,
    /// 99 % of the intervals are at most this long.
    pub p99: f64,
}

/// A picture of a moving camera.
#[derive(Clone, Copy, Debug)]
struct Sample {
    side: f32,
    /// Since the one before it, ms; `None` after a rest.
    interval: Option<f32>,
    /// True if the other position's flight was rendered both in its frame and in the one before.
    is_shared: bool,
}

/// Collects the samples.
#[derive(Clone, Debug, Default)]
pub(crate) struct MovingPictures {
    samples: VecDeque<Sample>,
    last: Option<(Instant, bool)>,
}

impl MovingPictures {
    /// Adds a finished picture with its relative side; `is_shared` if the other position's flight was rendered beside it.
    pub(crate) fn took(&mut self, side: f64, is_shared: bool, now: Instant) {
        let last = self.last.replace((now, is_shared));
        if self.samples.len() == KEPT {
            self.samples.pop_front();
        }
        self.samples.push_back(Sample {
            side: side as f32,
            interval: last.map(|(then, _)| (now.saturating_duration_since(then).as_secs_f64() * 1e3) as f32),
            is_shared: is_shared && last.is_none_or(|(_, was_shared)| was_shared),
        });
    }

    /// Interrupts the intervals: the time at rest is not one.
    pub(crate) fn rest(&mut self) {
        self.last = None;
    }

    /// Returns the statistics; `None` if there was no interval.
    pub(crate) fn summary(&self) -> Option<Moving> {
        let all = Pictures::of(self.samples.iter())?;
        Some(Moving { all, both: Pictures::of(self.samples.iter().filter(|s| s.is_shared)) })
    }
}

impl Pictures {
    /// `None` if there is no interval.
    fn of<'a>(samples: impl Iterator<Item = &'a Sample> + Clone) -> Option<Self> {
        let sorted = |mut all: Vec<f32>| {
            all.sort_by(f32::total_cmp);
            all
        };
        let at = |sorted: &[f32], share: f64| {
            let n = (sorted.len().checked_sub(1)? as f64 * share).ceil() as usize;
            sorted.get(n).map(|&v| f64::from(v))
        };
        let sides = sorted(samples.clone().map(|s| s.side).collect());
        let intervals = sorted(samples.filter_map(|s| s.interval).collect());
        Some(Self {
            pictures: sides.len(),
            side: Side { median: at(&sides, 0.5)?, p01: at(&sides, 0.01)? },
            interval_ms: Interval { median: at(&intervals, 0.5)?, p99: at(&intervals, 0.99)? },
        })
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_rest_is_no_interval() {
        let (mut m, start) = (MovingPictures::default(), Instant::now());
        assert_eq!(m.summary(), None);
        for n in 0..100 {
            m.took(if n == 7 { 0.5 } else { 1.0 }, false, start + Duration::from_millis(20 * n));
        }
        m.rest();
        m.took(1.0, false, start + Duration::from_secs(60));
        let Moving { all: s, both } = m.summary().unwrap();
        assert_eq!((s.pictures, s.side.median, s.side.p01, both), (101, 1.0, 1.0, None));
        assert!((s.interval_ms.p99 - 20.0).abs() < 1e-3, "{s:?}");
    }

    #[test]
    fn pictures_beside_those_of_the_other_position_are_counted_on_their_own() {
        let (mut m, start) = (MovingPictures::default(), Instant::now());
        let mut now = start;
        for n in 0..300 {
            let is_shared = (100..200).contains(&n);
            now += Duration::from_millis(if is_shared { 30 } else { 10 });
            m.took(if is_shared { 0.5 } else { 1.0 }, is_shared, now);
        }
        let Moving { all, both } = m.summary().unwrap();
        let both = both.unwrap();
        // The first has begun while the other one was not there yet.
        assert_eq!((all.pictures, both.pictures, both.side.median), (300, 99, 0.5));
        assert!(
            (both.interval_ms.median - 30.0).abs() < 1e-3 && (both.interval_ms.p99 - 30.0).abs() < 1e-3,
            "{both:?}"
        );
        assert!((all.interval_ms.median - 10.0).abs() < 1e-3, "{all:?}");
        let written = serde_json::to_value(m.summary()).unwrap();
        assert!(written["both"]["interval_ms"]["p99"].is_number() && written["interval_ms"]["median"].is_number());
    }
}
