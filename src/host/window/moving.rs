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

/// Collects the samples.
#[derive(Clone, Debug, Default)]
pub(crate) struct MovingPictures {
    sides: VecDeque<f32>,
    intervals: VecDeque<f32>,
    last: Option<Instant>,
}

impl MovingPictures {
    /// Adds a finished picture with its relative side.
    pub(crate) fn took(&mut self, side: f64, now: Instant) {
        let keep = |all: &mut VecDeque<f32>, value: f64| {
            if all.len() == KEPT {
                all.pop_front();
            }
            all.push_back(value as f32);
        };
        keep(&mut self.sides, side);
        if let Some(last) = self.last.replace(now) {
            keep(&mut self.intervals, now.saturating_duration_since(last).as_secs_f64() * 1e3);
        }
    }

    /// Interrupts the intervals: the time at rest is not one.
    pub(crate) fn rest(&mut self) {
        self.last = None;
    }

    /// Returns the statistics; `None` if there was no interval.
    pub(crate) fn summary(&self) -> Option<Moving> {
        let sorted = |all: &VecDeque<f32>| {
            let mut sorted: Vec<f32> = all.iter().copied().collect();
            sorted.sort_by(f32::total_cmp);
            sorted
        };
        let at = |sorted: &[f32], share: f64| {
            let n = (sorted.len().checked_sub(1)? as f64 * share).ceil() as usize;
            sorted.get(n).map(|&v| f64::from(v))
        };
        let (sides, intervals) = (sorted(&self.sides), sorted(&self.intervals));
        Some(Moving {
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
            m.took(if n == 7 { 0.5 } else { 1.0 }, start + Duration::from_millis(20 * n));
        }
        m.rest();
        m.took(1.0, start + Duration::from_secs(60));
        let s = m.summary().unwrap();
        assert_eq!((s.pictures, s.side.median, s.side.p01), (101, 1.0, 1.0));
        assert!((s.interval_ms.p99 - 20.0).abs() < 1e-3, "{s:?}");
    }
}
