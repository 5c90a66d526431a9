//! Detectors on a real scan that lesions are put into: background, noise and anatomy are real, and the truth of the lesions is exact.
//!
//! What else a detector finds may be a polyp or not: nobody has said. It counts as false, so the rates of false positives are upper bounds.
//!
//! The score was taught by lesions in every other stretch of one scan's centerline. The stretches between, and other scans, are a test.

use glam::DVec3;

use super::froc::{Is, Trial};
use super::{Effort, Measured, Part, collected, trials_of};
use crate::app::graft::{self, GraftTruth};
use crate::error::Result;
use crate::polyps::Detector;
use crate::progress::Progress;
use crate::space::TransferFunction;
use crate::volume::Volume;

/// Length of a stretch of the centerline, mm.
const STRETCH_MM: f64 = 100.0;

/// The stretches of a scan's centerline.
struct Stretches {
    line: Vec<DVec3>,
    along_mm: Vec<f64>,
}

impl Stretches {
    fn of(truth: &GraftTruth) -> Self {
        let line = truth.centerline.clone();
        let mut along_mm = Vec::with_capacity(line.len());
        for n in 0..line.len() {
            along_mm.push(if n == 0 { 0.0 } else { along_mm[n - 1] + line[n - 1].distance(line[n]) });
        }
        Self { line, along_mm }
    }

    /// True if a place (world, mm) is beside a stretch with an odd number: one that taught nothing.
    fn is_apart(&self, place: DVec3) -> bool {
        let square = |n: &usize| self.line[*n].distance_squared(place);
        let nearest = (0..self.line.len()).min_by(|a, b| square(a).total_cmp(&square(b)));
        nearest.is_some_and(|n| (self.along_mm[n] / STRETCH_MM) as usize % 2 == 1)
    }

    /// Returns the share of the line that is in such stretches.
    fn share_apart(&self) -> f64 {
        let apart = self.along_mm.iter().filter(|mm| (**mm / STRETCH_MM) as usize % 2 == 1).count();
        apart as f64 / self.along_mm.len().max(1) as f64
    }

    /// Returns what of a trial is in such stretches, or the rest.
    fn part(&self, trial: &Trial, apart: bool) -> Trial {
        let is_own = |place: DVec3| self.is_apart(place) == apart;
        let mut number = vec![None; trial.polyps.len()];
        let mut polyps = Vec::new();
        for (n, polyp) in trial.polyps.iter().enumerate().filter(|p| is_own(p.1.position)) {
            number[n] = Some(polyps.len());
            polyps.push(*polyp);
        }
        let found = trial.found.iter().filter_map(|(candidate, is)| match is {
            // A lesion's candidates go with it.
            Is::Polyp(n) => number[*n].map(|n| (candidate.clone(), Is::Polyp(n))),
            _ => is_own(candidate.position).then(|| (candidate.clone(), *is)),
        });
        Trial { found: found.collect(), polyps, decoys: trial.decoys.clone() }
    }
}

/// Puts lesions into a scan, several times, and measures the detectors on them: in the stretches that taught nothing, and in the others.
pub(super) fn measured(
    title: &str,
    volume: Volume,
    effort: Effort,
    first: u64,
    detectors: &[Detector],
    transfer: TransferFunction,
    progress: &Progress,
) -> Result<Vec<Part>> {
    let (times, count) = (effort.choose(1, 4), effort.choose(20, 60));
    let mut runs = Vec::new();
    let mut known: Option<(Stretches, GraftTruth)> = None;
    let mut lesions = 0;
    for seed in first..first + times {
        let made = graft::graft(volume.clone(), seed, count, progress)?;
        lesions += made.truth.polyps.len();
        runs.push(trials_of(made.volume, &made.truth.polyps, &[], detectors, transfer, progress)?);
        known.get_or_insert_with(|| (Stretches::of(&made.truth), made.truth));
        progress.check()?;
    }
    drop(volume);
    let whole = collected(detectors, runs);
    let Some((stretches, truth)) = known else { return Ok(Vec::new()) };
    let host = &truth.scan;
    let text = format!(
        "{lesions} lesions, put into the scan {times} times: blurred by a Gaussian of {:.2} mm in the plane and {:.2} mm along z, with noise \
         of {:.0} HU, as measured at the scan's walls and in its tissue. Whatever is not one of them counts as a false positive, also where \
         the patient has a polyp: the rates are upper bounds.",
        host.spread.sigma_mm[0], host.spread.sigma_mm[1], host.noise.tissue_hu,
    );
    let share = stretches.share_apart();
    let part = |name, apart: bool, said: &str| Part {
        name,
        title: format!("Lesions put into {title}: {said}"),
        text: text.clone(),
        measured: whole
            .iter()
            .map(|m| of_part(m, &stretches, apart, if apart { share } else { 1.0 - share }))
            .collect(),
    };
    Ok(vec![
        part("put-in-apart", true, "every other 100 mm, which taught the score nothing"),
        part("put-in-taught", false, "the stretches between"),
    ])
}

fn of_part(m: &Measured, stretches: &Stretches, apart: bool, share: f64) -> Measured {
    let trials = m.trials.iter().map(|t| stretches.part(t, apart)).collect();
    Measured { detector: m.detector, share, seconds: m.seconds, megabytes: m.megabytes, trials }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phantom::TruePolyp;
    use crate::polyps::Candidate;

    #[test]
    fn what_is_in_a_stretch_is_judged_there() {
        let line: Vec<DVec3> = (0..=400).map(|n| DVec3::X * f64::from(n)).collect();
        let stretches = Stretches { along_mm: (0..=400).map(f64::from).collect(), line };
        let at = |x: f64| DVec3::new(x, 12.0, 0.0);
        let polyp = |x: f64| TruePolyp { position: at(x), diameter_mm: 6.0, ..TruePolyp::default() };
        let found = [50.0, 150.0, 152.0, 250.0, 350.0].map(|x| Candidate::new(at(x), x)).to_vec();
        let trial = Trial::new(vec![polyp(50.0), polyp(150.0), polyp(340.0)], Vec::new(), found);
        let apart = stretches.part(&trial, true);
        let is: Vec<Is> = apart.found.iter().map(|f| f.1).collect();
        assert_eq!(is, [Is::Polyp(0), Is::Polyp(0), Is::Other]);
        assert_eq!(apart.polyps.len(), 2);
        let rest = stretches.part(&trial, false);
        assert_eq!(rest.found.iter().map(|f| f.1).collect::<Vec<_>>(), [Is::Polyp(0), Is::Other]);
        assert!((stretches.share_apart() - 0.5).abs() < 0.01);
    }
}
