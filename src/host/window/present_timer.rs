//! Time from finished images to the screen.

use std::collections::VecDeque;

use serde::Serialize;

/// Maximum number of samples: an hour at sixty per second.
const KEPT: usize = 216_000;

/// Time from the finished image to the presented one, ms: the overlay, the copy and the call to the window system.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[doc(hidden)]
pub struct PresentMs {
    /// Half of the presentations took at most this time.
    pub median: f64,
    /// 99 % of the presentations took at most this time.
    pub p99: f64,
}

/// Collects the times of presentations.
#[derive(Clone, Debug, Default)]
pub(crate) struct PresentTimer {
    all: VecDeque<f32>,
    usual: Option<f64>,
}

impl PresentTimer {
    /// Adds a presentation that took `ms`.
    pub(crate) fn took(&mut self, ms: f64) {
        if self.all.len() == KEPT {
            self.all.pop_front();
        }
        self.all.push_back(ms as f32);
        self.usual = Some(self.usual.map_or(ms, |u| u + (ms - u) * 0.1));
    }

    /// Returns the recent time of a presentation, ms; 0 if there was none.
    pub(crate) fn usual_ms(&self) -> f64 {
        self.usual.unwrap_or(0.0)
    }

    /// Returns the statistics; `None` if there was no presentation.
    pub(crate) fn summary(&self) -> Option<PresentMs> {
        let mut sorted: Vec<f32> = self.all.iter().copied().collect();
        sorted.sort_by(f32::total_cmp);
        let at = |share: f64| sorted.get(((sorted.len() - 1) as f64 * share).ceil() as usize).map(|&ms| f64::from(ms));
        if sorted.is_empty() { None } else { Some(PresentMs { median: at(0.5)?, p99: at(0.99)? }) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn most_and_nearly_all() {
        let mut p = PresentTimer::default();
        assert_eq!((p.summary(), p.usual_ms()), (None, 0.0));
        p.took(3.0);
        assert_eq!(p.summary(), Some(PresentMs { median: 3.0, p99: 3.0 }));
        for n in 0..=200 {
            p.took(f64::from(n));
        }
        let s = p.summary().unwrap();
        assert!((s.median - 100.0).abs() <= 1.0 && (s.p99 - 198.0).abs() <= 1.0, "{s:?}");
    }
}
