//! Reports: measurements on this machine at this time, as one HTML page with plots and a CSV file for each.
//!
//! Timings are medians of frames that different methods render in turn, so that load on the machine slows all methods alike.

#[doc(hidden)]
pub mod candidates;
#[doc(hidden)]
pub mod cleansing;
#[doc(hidden)]
pub mod coverage;
mod dots;
#[doc(hidden)]
pub mod dynamics;
#[doc(hidden)]
pub mod fields;
pub mod flight;
#[doc(hidden)]
pub mod gradients;
mod image;
mod methods;
mod page;
mod pen;
pub mod perforation;
mod plot;
pub mod render;
#[doc(hidden)]
pub mod scenes;
mod table;
pub mod trials;
#[doc(hidden)]
pub mod unfold;

/// Parts of `report dynamics` for a test against an independent solver, `tests/bench/independent.rs`. They may change at any time.
#[doc(hidden)]
pub mod internals {
    pub use super::dynamics::{ACCURACY, CASES, Case, SECONDS, errors, forces, solve, start, turning};
    pub use crate::dynamics::rigid::angle;
    pub use crate::dynamics::rigid::free::{exp, turn};
}

use std::time::Instant;

use crate::memory::resident_bytes;

/// Extent of a report's measurements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// Fewer measurements in a fraction of the time, for a trial or a test.
    Quick,
    /// All measurements on which the report's claims are based.
    Full,
}

impl Effort {
    /// Returns [`Effort::Quick`] if `quick` is set.
    pub fn new(quick: bool) -> Self {
        if quick { Self::Quick } else { Self::Full }
    }

    /// Selects one of two values.
    pub fn choose<T>(self, quick: T, full: T) -> T {
        match self {
            Self::Quick => quick,
            Self::Full => full,
        }
    }
}

/// Returns the quantile `p` (0 to 1) of `values` by nearest rank; NaN if there are none.
pub fn quantile(values: &[f64], p: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let rank = (p * sorted.len() as f64).ceil().max(1.0) as usize;
    sorted.get(rank - 1).or(sorted.last()).copied().unwrap_or(f64::NAN)
}

/// Returns the median of `values`, the lower one of an even number.
pub fn median(values: &[f64]) -> f64 {
    quantile(values, 0.5)
}

/// Returns the mean of `values`; NaN if there are none.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Runs `work`. Returns its result, its time in seconds, and its peak memory (MB) if the system reports it (Linux).
pub(crate) fn timed<T>(work: impl FnOnce() -> T) -> (T, f64, Option<f64>) {
    // This resets the peak of resident memory to the current value.
    let is_reset = std::fs::write("/proc/self/clear_refs", "5").is_ok();
    let before = resident_bytes("VmRSS").filter(|_| is_reset);
    let begun = Instant::now();
    let out = work();
    let seconds = begun.elapsed().as_secs_f64();
    let megabytes = before.and_then(|b| Some(resident_bytes("VmHWM")?.saturating_sub(b) as f64 / 1e6));
    (out, seconds, megabytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_values_that_were_measured() {
        let v = [5.0, 1.0, 3.0, 2.0, 4.0];
        assert_eq!([median(&v), quantile(&v, 0.99), quantile(&v, 0.0)], [3.0, 5.0, 1.0]);
        assert_eq!(median(&[2.0, 1.0]), 1.0);
        assert!(median(&[]).is_nan() && mean(&[]).is_nan());
        assert_eq!(mean(&v), 3.0);
    }
}
