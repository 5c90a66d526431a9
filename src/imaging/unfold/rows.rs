//! Where the rows of a map are along the line.

use super::chart::Chart;

/// Between places this far apart along the line, mm, rows are evenly spaced.
const KNOT_MM: f64 = 0.1;
/// Rows come closer where more than this many times the mean area of the wall belongs to a length of the line: where a deep sac opens.
const CROWDED: f64 = 1.2;
/// Rows come at most this many times as close.
const CLOSEST: f64 = 6.0;

/// The distances of rows along the line: a piecewise linear function that grows, and its inverse.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Rows {
    first_mm: f64,
    /// The row at each knot, [`KNOT_MM`] apart from `first_mm` on.
    knots: Vec<f64>,
}

impl Rows {
    /// Spaces rows between two distances along the line, mm, at most `step_mm` apart, and closer where much wall belongs to little of the
    /// line. `girth_mm` is the wall's mean area over the line's length.
    pub(super) fn new(chart: &Chart, [from, to]: [f64; 2], step_mm: f64, girth_mm: f64) -> Self {
        let count = ((to - from) / KNOT_MM).ceil().max(1.0) as usize;
        let areas = chart.areas(from, KNOT_MM, count);
        let crowd = 1.0 / (KNOT_MM * CROWDED * girth_mm.max(1e-3));
        let mut row = 0.0;
        let knots = std::iter::once(0.0).chain(areas.into_iter().map(|mm2| {
            row += (mm2 * crowd).clamp(1.0, CLOSEST) * KNOT_MM / step_mm;
            row
        }));
        Self { first_mm: from, knots: knots.collect() }
    }

    /// Returns the number of whole rows.
    pub(super) fn count(&self, to_mm: f64) -> usize {
        // A hair more: rows at the very end are rows.
        (self.row(to_mm) + 1e-9).floor().max(0.0) as usize + 1
    }

    /// Returns the row at a distance along the line, mm. Beyond either end it goes on as at that end.
    pub(super) fn row(&self, mm: f64) -> f64 {
        let at = (mm - self.first_mm) / KNOT_MM;
        let n = (at.floor().max(0.0) as usize).min(self.knots.len() - 2);
        self.knots[n] + (self.knots[n + 1] - self.knots[n]) * (at - n as f64)
    }

    /// Returns the distance along the line of a row, mm.
    pub(super) fn mm(&self, row: f64) -> f64 {
        let n = self.knots.partition_point(|k| *k <= row).clamp(1, self.knots.len() - 1) - 1;
        let share = (row - self.knots[n]) / (self.knots[n + 1] - self.knots[n]);
        self.first_mm + (n as f64 + share) * KNOT_MM
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_and_distances_are_each_others_inverse_and_grow() {
        let knots = vec![0.0, 0.25, 0.5, 6.5, 6.75];
        let rows = Rows { first_mm: -3.0, knots };
        assert_eq!(rows.count(-3.0), 1);
        assert_eq!(rows.count(-2.6), 7);
        let mut before = f64::NEG_INFINITY;
        for n in -40..60 {
            let mm = -3.0 + f64::from(n) * 0.013;
            let row = rows.row(mm);
            assert!(row > before && (rows.mm(row) - mm).abs() < 1e-12, "{mm} mm: row {row}");
            before = row;
        }
    }
}
