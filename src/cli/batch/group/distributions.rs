//! Distributions of the measures, and the cases that lie far outside them.
//!
//! A value's score is its distance from the median in robust standard deviations: 1.4826 times the median of all distances from the
//! median (MAD). Scores above 3.5 are outliers: Iglewicz and Hoaglin, *How to detect and handle outliers* (1993). Neither median nor MAD
//! moves with the outliers themselves, as mean and standard deviation do. Many measures have a long side, such as the share of the length
//! that is distended, which ends at 1. There a standard deviation is no smaller than the 10 % or 90 % quantile of the side tells.

use super::measures::{MEASURES, Measure};
use super::rows::Row;

/// The score from which a value is an outlier.
pub(super) const OUTLIER: f64 = 3.5;
/// With fewer values, none is an outlier.
const FEWEST: usize = 8;
/// A normal distribution's standard deviation in its MADs, and in its mean distances from the mean.
const MAD_TO_SD: f64 = 1.4826;
const MEAN_TO_SD: f64 = 1.2533;
/// Distance of a normal distribution's 10 % and 90 % quantiles from its median, in standard deviations.
const TENTH_TO_SD: f64 = 1.2816;
/// Standard deviations are no smaller than this share of the median: what hardly varies has no outliers.
const LEAST_SPREAD: f64 = 0.01;
/// Number of bars of a histogram.
const BARS: [usize; 2] = [5, 40];
/// A histogram reaches so many times the distance of the 5 % and 95 % quantiles beyond them. The rest is counted at its ends.
const REACH: f64 = 1.5;

/// The values of a measure, in the page's unit.
pub(super) struct Distribution {
    /// Its place in [`MEASURES`].
    pub(super) number: usize,
    /// In order.
    values: Vec<f64>,
    pub(super) median: f64,
    /// The 5 % and 95 % quantiles.
    pub(super) low: f64,
    pub(super) high: f64,
    /// The robust standard deviations below and above the median; 0 if there are no outliers to look for.
    spread: [f64; 2],
}

/// Bars of equal width.
#[derive(Debug, PartialEq)]
pub(super) struct Histogram {
    /// Lower edge of the first bar.
    pub(super) from: f64,
    pub(super) width: f64,
    pub(super) counts: Vec<usize>,
    /// True if the values are counts: the bars of single numbers have them in their middle.
    pub(super) is_whole: bool,
    /// Number of values below the first bar and above the last.
    pub(super) beyond: [usize; 2],
}

impl Distribution {
    /// The distribution of a measure over all cases that have it; `None` if none has.
    pub(super) fn of(number: usize, rows: &[Row]) -> Option<Self> {
        let scale = MEASURES[number].scale;
        Self::new(number, rows.iter().filter_map(|r| r.values[number]).map(|x| x * scale))
    }

    fn new(number: usize, values: impl Iterator<Item = f64>) -> Option<Self> {
        let mut values: Vec<f64> = values.filter(|x| x.is_finite()).collect();
        values.sort_unstable_by(f64::total_cmp);
        let median = quantile(&values, 0.5)?;
        let mut distances: Vec<f64> = values.iter().map(|x| (x - median).abs()).collect();
        distances.sort_unstable_by(f64::total_cmp);
        let mut spread = MAD_TO_SD * quantile(&distances, 0.5)?;
        if spread <= 0.0 {
            // More than half of the values are the same.
            spread = MEAN_TO_SD * distances.iter().sum::<f64>() / distances.len() as f64;
        }
        spread = spread.max(LEAST_SPREAD * median.abs());
        let side = |share: f64| Some(spread.max((quantile(&values, share)? - median).abs() / TENTH_TO_SD));
        let spread = if values.len() < FEWEST { [0.0; 2] } else { [side(0.1)?, side(0.9)?] };
        let [low, high] = [quantile(&values, 0.05)?, quantile(&values, 0.95)?];
        Some(Self { number, median, low, high, spread, values })
    }

    pub(super) fn measure(&self) -> &'static Measure {
        &MEASURES[self.number]
    }

    pub(super) fn count(&self) -> usize {
        self.values.len()
    }

    pub(super) fn least(&self) -> f64 {
        self.values.first().copied().unwrap_or(self.median)
    }

    pub(super) fn most(&self) -> f64 {
        self.values.last().copied().unwrap_or(self.median)
    }

    /// Returns how far a value lies from the median, with its sign.
    fn score(&self, x: f64) -> f64 {
        let spread = self.spread[usize::from(x > self.median)];
        if spread > 0.0 { (x - self.median) / spread } else { 0.0 }
    }

    /// Returns the bars. Their width is 1, 2 or 5 times a power of ten, near that of Freedman and Diaconis (1981).
    pub(super) fn histogram(&self) -> Histogram {
        let beyond = REACH * (self.high - self.low);
        let from = self.least().max(self.low - beyond);
        let to = self.most().min(self.high + beyond);
        let n = self.values.len() as f64;
        let quartiles = [0.25, 0.75].map(|share| quantile(&self.values, share).unwrap_or(self.median));
        let wanted = 2.0 * (quartiles[1] - quartiles[0]) / n.cbrt();
        let [fewest, most] = BARS.map(|n| n as f64);
        let least = (LEAST_SPREAD * from.abs()).max(1e-9);
        let width = match to - from {
            span if span < least => nice(least),
            span => nice(wanted.clamp(span / most, span / fewest)),
        };
        // Counts have no parts.
        let is_whole = self.values.iter().all(|x| x.fract() == 0.0);
        let width = if is_whole { width.max(1.0).round() } else { width };
        let middle = if is_whole && width == 1.0 { 0.5 } else { 0.0 };
        let place = |x: f64| (x / width + middle).floor();
        let first = place(from);
        let bars = (place(to) - first) as usize + 1;
        let mut all =
            Histogram { from: (first - middle) * width, width, counts: vec![0; bars], is_whole, beyond: [0; 2] };
        for x in &self.values {
            let bar = place(*x) - first;
            match all.counts.get_mut(bar.max(0.0) as usize) {
                _ if bar < 0.0 => all.beyond[0] += 1,
                Some(count) => *count += 1,
                None => all.beyond[1] += 1,
            }
        }
        all
    }
}

/// Returns the smallest of 1, 2 and 5 times a power of ten that is at least `x`, for `x` above 0.
pub(super) fn nice(x: f64) -> f64 {
    let power = 10f64.powf(x.log10().floor());
    [1.0, 2.0, 5.0].into_iter().map(|n| n * power).find(|n| *n >= x * (1.0 - 1e-9)).unwrap_or(10.0 * power)
}

/// Returns a quantile of values in order, between the two values next to it where it is none.
pub(super) fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let at = share * sorted.len().checked_sub(1)? as f64;
    let (low, high) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    Some(low + (high - low) * at.fract())
}

/// A value of an outlier.
pub(super) struct Reason {
    /// The place of its distribution in the list.
    pub(super) distribution: usize,
    /// In the page's unit.
    pub(super) value: f64,
    pub(super) score: f64,
}

/// A case with values far outside the others'.
pub(super) struct Outlier {
    /// The place of the case among the rows.
    pub(super) row: usize,
    /// The farthest value first.
    pub(super) reasons: Vec<Reason>,
}

/// Returns the distributions of all measures that the page shows.
pub(super) fn all(rows: &[Row]) -> Vec<Distribution> {
    let shown = MEASURES.iter().enumerate().filter(|(_, m)| m.is_shown);
    shown.filter_map(|(number, _)| Distribution::of(number, rows)).collect()
}

/// Returns the outliers, the farthest first.
pub(super) fn outliers(distributions: &[Distribution], rows: &[Row]) -> Vec<Outlier> {
    let reasons = |row: &Row| {
        let reason = |(n, d): (usize, &Distribution)| {
            let value = row.values[d.number]? * d.measure().scale;
            let score = d.score(value);
            (score.abs() > OUTLIER).then_some(Reason { distribution: n, value, score })
        };
        let mut all: Vec<Reason> = distributions.iter().enumerate().filter_map(reason).collect();
        all.sort_by(|a, b| b.score.abs().total_cmp(&a.score.abs()));
        all
    };
    let all = rows.iter().enumerate().map(|(row, r)| Outlier { row, reasons: reasons(r) });
    let mut all: Vec<Outlier> = all.filter(|o| !o.reasons.is_empty()).collect();
    // Equal ones stay in the order of the rows.
    all.sort_by(|a, b| b.reasons[0].score.abs().total_cmp(&a.reasons[0].score.abs()));
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::batch::group::rows::State;

    fn of(values: &[f64]) -> Distribution {
        Distribution::new(0, values.iter().copied()).unwrap()
    }

    #[test]
    fn quantiles_lie_between_values_and_what_is_no_number_is_left_out() {
        let d = of(&[3.0, f64::NAN, 1.0, 2.0, f64::INFINITY, 4.0]);
        assert_eq!((d.count(), d.median, d.least(), d.most()), (4, 2.5, 1.0, 4.0));
        assert!((d.low - 1.15).abs() < 1e-12 && (d.high - 3.85).abs() < 1e-12);
        assert!(Distribution::new(0, [f64::NAN].into_iter()).is_none());
        assert!(Distribution::new(0, std::iter::empty()).is_none());
    }

    #[test]
    fn a_histogram_counts_every_value_once() {
        let many: Vec<f64> = (0..1000).map(|n| 700.0 + f64::from(n % 97)).collect();
        let far = [&many[..], &[1e9, -1e9]].concat();
        let tenths: Vec<f64> = (0..500).map(|n| 0.1 * f64::from(n % 7)).collect();
        for values in [
            &many,
            &far,
            &tenths,
            &vec![5.0],
            &vec![0.0; 9],
            &vec![-3.5, -3.5],
            &vec![1e-12, 2e-12],
            &vec![1e300, 2e300],
        ] {
            let h = of(values).histogram();
            assert_eq!(h.counts.iter().sum::<usize>() + h.beyond.iter().sum::<usize>(), values.len(), "{h:?}");
            assert!(h.width > 0.0 && (1..=60).contains(&h.counts.len()), "{h:?}");
        }
        assert_eq!(of(&far).histogram().beyond, [1, 1]);
        assert_eq!(of(&many).histogram().width.fract(), 0.0, "counts have no parts");
        let one = of(&[5.0]).histogram();
        assert_eq!((one.from, one.width, one.counts), (4.5, 1.0, vec![1]));
        assert_eq!([nice(0.3), nice(1.0), nice(2.1), nice(70.0)], [0.5, 1.0, 5.0, 100.0]);
    }

    #[test]
    fn outliers_are_far_from_the_median_in_robust_deviations() {
        let around: Vec<f64> = (0..40).map(|n| 100.0 + f64::from(n % 5)).collect();
        let d = of(&[&around[..], &[150.0, 20.0]].concat());
        assert!(d.score(150.0) > 20.0 && d.score(20.0) < -20.0 && d.score(104.0).abs() < 2.0);
        // Ties, and what hardly varies.
        let same = of(&[vec![7.0; 50], vec![7.01]].concat());
        assert!(same.score(7.01).abs() < OUTLIER && same.score(9.0) > OUTLIER);
        let zeros = of(&[vec![0.0; 50], vec![12.0]].concat());
        assert!(zeros.score(12.0) > OUTLIER && zeros.score(0.0).abs() < 1.0);
        assert_eq!(of(&[0.0; 20]).score(5.0), 0.0);
        // A long side that ends at 1 has none on it, and one apart from it is found.
        let long: Vec<f64> = (0..100).map(|n| (1.0 + 0.002 * f64::from(n - 60)).min(1.0)).collect();
        assert!(of(&long).score(0.88).abs() < OUTLIER && of(&[&long[..], &[0.3]].concat()).score(0.3) < -OUTLIER);
        // Too few to tell.
        assert_eq!(of(&[1.0, 1.0, 1.0, 90.0]).score(90.0), 0.0);
    }

    #[test]
    fn the_farthest_case_comes_first_with_its_reasons() {
        let number = |name: &str| MEASURES.iter().position(|m| m.name == name).unwrap();
        let rows: Vec<Row> = (0..30)
            .map(|n| {
                let mut row = Row::unknown(&n.to_string(), State::Done, "", "");
                row.values[number("length_mm")] = Some(1500.0 + f64::from(n % 7));
                row.values[number("distended")] = (n != 3).then_some(0.9 + 0.01 * f64::from(n % 3));
                row
            })
            .collect();
        let mut far = rows.clone();
        far[5].values[number("length_mm")] = Some(900.0);
        far[5].values[number("distended")] = Some(0.5);
        far[9].values[number("distended")] = Some(0.0);
        let distributions = all(&far);
        let found = outliers(&distributions, &far);
        assert_eq!(found.iter().map(|o| o.row).collect::<Vec<_>>(), [9, 5]);
        assert_eq!(found[1].reasons.len(), 2);
        let first = &found[0].reasons[0];
        assert_eq!((distributions[first.distribution].measure().name, first.value), ("distended", 0.0));
        assert!(first.score < -OUTLIER);
        assert!(outliers(&all(&rows), &rows).is_empty());
        assert!(outliers(&all(&[]), &[]).is_empty());
    }
}
