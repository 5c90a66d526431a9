//! Reports: what was measured, now and on this machine, as one HTML page with plots and the CSV of each beside it.
//!
//! Timings are medians of frames that different methods render in turn, so that a busy machine slows all of them alike.

pub mod dynamics;
pub mod fields;
pub mod flight;
pub mod gradients;
pub mod image;
pub mod methods;
pub mod page;
pub mod perforation;
pub mod plot;
pub mod render;
pub mod scenes;
pub mod table;
pub mod trials;

/// How much a report measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// Less, in a small part of the time: to try a report, and for tests.
    Quick,
    /// All that the report's claims rest on.
    Full,
}

impl Effort {
    /// [`Effort::Quick`] where a quick report is asked for.
    pub fn new(quick: bool) -> Self {
        if quick { Self::Quick } else { Self::Full }
    }

    /// One of two values.
    pub fn choose<T>(self, quick: T, full: T) -> T {
        match self {
            Self::Quick => quick,
            Self::Full => full,
        }
    }
}

/// The value below which the share `p` (0 to 1) of `values` lies: nearest rank; not-a-number where there are none.
pub fn quantile(values: &[f64], p: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let rank = (p * sorted.len() as f64).ceil().max(1.0) as usize;
    sorted.get(rank - 1).or(sorted.last()).copied().unwrap_or(f64::NAN)
}

/// The middle of `values`, the lower of two.
pub fn median(values: &[f64]) -> f64 {
    quantile(values, 0.5)
}

/// The mean of `values`; not-a-number where there are none.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
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
