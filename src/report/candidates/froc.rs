//! Sensitivity against false positives (FROC): which candidates are polyps, and which polyps are found.

use crate::phantom::{TrueDecoy, TruePolyp};
use crate::polyps::Candidate;

/// Maximum distance of a candidate from the surface of the polyp or decoy that it belongs to, mm.
const NEAR_MM: f64 = 3.0;
/// The quantile of the normal distribution for an interval of 95 %.
const Z: f64 = 1.96;

/// What a candidate is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Is {
    /// The polyp with this number.
    Polyp(usize),
    /// The decoy with this number.
    Decoy(usize),
    /// Neither.
    Other,
}

/// A scan with its truth and what a detector found.
#[derive(Clone, Debug)]
pub(super) struct Trial {
    pub polyps: Vec<TruePolyp>,
    pub decoys: Vec<TrueDecoy>,
    /// The candidates with their classes, best first.
    pub found: Vec<(Candidate, Is)>,
}

impl Trial {
    /// Classifies the candidates of a scan.
    pub(super) fn new(polyps: Vec<TruePolyp>, decoys: Vec<TrueDecoy>, found: Vec<Candidate>) -> Self {
        let is = |c: &Candidate| {
            let gap = |at: glam::DVec3, diameter: f64| at.distance(c.position) - 0.5 * diameter;
            let nearest = |gaps: &mut dyn Iterator<Item = f64>| {
                gaps.enumerate().filter(|g| g.1 <= NEAR_MM).min_by(|a, b| a.1.total_cmp(&b.1)).map(|g| g.0)
            };
            let polyp = nearest(&mut polyps.iter().map(|p| gap(p.position, p.diameter_mm)));
            let decoy = nearest(&mut decoys.iter().map(|d| gap(d.position, d.diameter_mm)));
            polyp.map(Is::Polyp).or(decoy.map(Is::Decoy)).unwrap_or(Is::Other)
        };
        let found = found.into_iter().map(|c| (is(&c), c)).map(|(is, c)| (c, is)).collect();
        Self { polyps, decoys, found }
    }

    /// Returns the best candidate of a polyp.
    pub(super) fn best(&self, polyp: usize) -> Option<&Candidate> {
        self.found.iter().find(|f| f.1 == Is::Polyp(polyp)).map(|f| &f.0)
    }

    /// Returns the best score of a decoy.
    pub(super) fn decoy(&self, decoy: usize) -> Option<&Candidate> {
        self.found.iter().find(|f| f.1 == Is::Decoy(decoy)).map(|f| &f.0)
    }

    fn false_scores(&self) -> impl Iterator<Item = f64> {
        self.found.iter().filter(|f| !matches!(f.1, Is::Polyp(_))).map(|f| f.0.score)
    }
}

/// Returns the lowest score at which the scans together have at most `per_scan` false positives per scan.
pub(super) fn threshold(trials: &[Trial], per_scan: f64) -> f64 {
    let mut scores: Vec<f64> = trials.iter().flat_map(Trial::false_scores).collect();
    scores.sort_by(|a, b| b.total_cmp(a));
    let most = (per_scan * trials.len() as f64).floor() as usize;
    // Just above the score of the first false positive beyond the limit.
    scores.get(most).map_or(f64::NEG_INFINITY, |s| s.next_up())
}

/// Returns the number of false positives per scan with at least this score.
pub(super) fn false_positives(trials: &[Trial], score: f64) -> f64 {
    trials.iter().flat_map(Trial::false_scores).filter(|s| *s >= score).count() as f64 / trials.len() as f64
}

/// Number of polyps in a group, and how many of them are found with at least a given score.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Share {
    pub of: usize,
    pub found: usize,
}

impl Share {
    pub(super) fn at(trials: &[Trial], score: f64, group: impl Fn(&TruePolyp) -> bool) -> Self {
        let mut share = Self::default();
        for t in trials {
            for (n, _) in t.polyps.iter().enumerate().filter(|p| group(p.1)) {
                share.of += 1;
                share.found += usize::from(t.best(n).is_some_and(|c| c.score >= score));
            }
        }
        share
    }

    /// Returns the share found; NaN if there are no polyps.
    pub(super) fn value(self) -> f64 {
        self.found as f64 / self.of as f64
    }

    /// Returns the 95 % interval of the share (Wilson 1927).
    pub(super) fn interval(self) -> [f64; 2] {
        let (n, p) = (self.of as f64, self.value());
        let middle = (p + Z * Z / (2.0 * n)) / (1.0 + Z * Z / n);
        let half = Z / (1.0 + Z * Z / n) * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
        [(middle - half).max(0.0), (middle + half).min(1.0)]
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::phantom::DecoyKind;

    fn polyp(x: f64, diameter_mm: f64) -> TruePolyp {
        TruePolyp { position: DVec3::new(x, 0.0, 0.0), diameter_mm, ..TruePolyp::default() }
    }

    fn candidate(x: f64, score: f64) -> Candidate {
        Candidate::new(DVec3::new(x, 0.0, 0.0), score)
    }

    fn trial() -> Trial {
        let decoy = TrueDecoy { kind: DecoyKind::Stool, position: DVec3::new(60.0, 0.0, 0.0), diameter_mm: 6.0 };
        let found = [(5.0, 0.9), (64.0, 0.8), (100.0, 0.7), (27.9, 0.6), (3.0, 0.5), (90.0, 0.4)];
        let found = found.map(|(x, score)| candidate(x, score)).to_vec();
        Trial::new(vec![polyp(0.0, 8.0), polyp(20.0, 10.0), polyp(-50.0, 4.0)], vec![decoy], found)
    }

    #[test]
    fn candidates_belong_to_what_they_are_near() {
        let t = trial();
        let is: Vec<Is> = t.found.iter().map(|f| f.1).collect();
        assert_eq!(is, [Is::Polyp(0), Is::Decoy(0), Is::Other, Is::Polyp(1), Is::Polyp(0), Is::Other]);
        assert_eq!(t.best(0).map(|c| c.score), Some(0.9));
        assert_eq!((t.best(2), t.decoy(0).map(|c| c.score)), (None, Some(0.8)));
    }

    #[test]
    fn the_curve_counts_each_polyp_once_and_each_false_positive() {
        let trials = [trial(), trial()];
        assert_eq!(false_positives(&trials, 0.0), 3.0);
        assert_eq!(false_positives(&trials, 0.7), 2.0);
        for (per_scan, found) in [(0.5, 1), (1.0, 1), (2.0, 2), (3.0, 2), (9.0, 2)] {
            let score = threshold(&trials, per_scan);
            assert!(false_positives(&trials, score) <= per_scan, "{per_scan}");
            let share = Share::at(&trials, score, |_| true);
            assert_eq!(share, Share { of: 6, found: 2 * found }, "{per_scan}");
        }
        assert_eq!(Share::at(&trials, 0.0, |p| p.diameter_mm < 5.0), Share { of: 2, found: 0 });
        assert!(Share::default().value().is_nan());
    }

    #[test]
    fn the_interval_is_wilsons() {
        // Newcombe 1998, table I: 81 of 263 is 0.2553 to 0.3662, 0 of 20 is 0 to 0.1611.
        let [low, high] = Share { of: 263, found: 81 }.interval();
        assert!((low - 0.2553).abs() < 1e-4 && (high - 0.3662).abs() < 1e-4, "{low}, {high}");
        let [low, high] = Share { of: 20, found: 0 }.interval();
        assert!(low.abs() < 1e-9 && (high - 0.1611).abs() < 1e-4, "{high}");
    }
}
