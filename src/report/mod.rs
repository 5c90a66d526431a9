//! Reports: measurements on this machine at this time, as one HTML page with plots and a CSV file for each.
//!
//! Timings are medians of frames that different methods render in turn, so that load on the machine slows all methods alike.

pub(crate) mod dynamics;
pub(crate) mod fields;
pub mod flight;
pub(crate) mod gradients;
mod image;
mod methods;
mod page;
pub mod perforation;
mod plot;
pub mod render;
pub(crate) mod scenes;
mod table;
pub mod trials;

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
