//! Values by their rank.

/// Returns the median of values, the upper one of an even number; `None` of none.
pub fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Returns the quantile `share` (0 to 1) of values, that of the nearest rank; `None` of none.
pub fn quantile(mut values: Vec<f64>, share: f64) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    let at = (last as f64 * share).round() as usize;
    Some(*values.select_nth_unstable_by(at.min(last), f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_are_of_values_that_are_there() {
        let values = vec![4.0, -1.0, 9.0, 2.0];
        assert_eq!((median(values.clone()), median(Vec::new())), (Some(4.0), None));
        assert_eq!([0.0, 0.34, 1.0, 7.0].map(|q| quantile(values.clone(), q)), [-1.0, 2.0, 9.0, 9.0].map(Some));
        assert_eq!(quantile(Vec::new(), 0.5), None);
    }
}
