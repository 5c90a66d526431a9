//! `report gradients`: compares gradient estimators with analytic gradients, error against time.

mod estimators;
mod signals;

use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

use glam::DVec3;
use rayon::prelude::*;

use crate::error::Result;
use crate::math::hash;
use crate::progress::Progress;
use crate::volume::Volume;

use super::page::Page;
use super::plot::{Plot, Point, Series};
use super::table::table;
use super::{Effort, mean, median};
use estimators::{ESTIMATORS, Estimator};
use signals::Signal;

/// Standard deviations of the noise, HU. The second is that of the phantom.
const NOISE_HU: [f64; 4] = [0.0, 22.0, 30.0, 100.0];
/// Spacings as multiples of the smallest one.
const SHAPES: [(&str, DVec3); 2] = [("cubic voxels", DVec3::ONE), ("voxels 1:1:3", DVec3::new(1.0, 1.0, 3.0))];
/// Number of timing rounds.
const ROUNDS: usize = 9;

/// A line of the report.
#[derive(Clone, Debug)]
struct Line {
    signal: &'static str,
    wall: bool,
    shape: &'static str,
    noise: f64,
    estimator: &'static str,
    degrees: f64,
}

/// Measures and writes the report into `folder`. Returns the findings, one sentence each.
///
/// # Errors
/// Returns status 4 if interrupted, 5 if a file cannot be written.
pub fn report(effort: Effort, folder: &Path, progress: &Progress) -> Result<Vec<String>> {
    let count = effort.choose(4_000, 40_000);
    progress.stage("estimating gradients", (SHAPES.len() * NOISE_HU.len()) as u64);
    let mut lines = Vec::new();
    let mut times = Vec::new();
    for (shape, spacing) in SHAPES {
        let signals = signals::all(spacing, progress)?;
        let points: Vec<Vec<(DVec3, DVec3)>> = signals.iter().map(|s| s.points(count)).collect();
        for noise in NOISE_HU {
            for (s, points) in signals.iter().zip(&points) {
                let volume = with_noise(&s.volume, noise);
                lines.extend(ESTIMATORS.iter().map(|e| Line {
                    signal: s.name,
                    wall: s.wall,
                    shape,
                    noise,
                    estimator: e.name,
                    degrees: degrees(e, &volume, points),
                }));
            }
            progress.advance(1)?;
        }
        times.push(nanoseconds(&signals[0], &points[0]));
    }
    write(&lines, &times, folder)
}

/// Adds noise with the standard deviation `hu`. The noise depends on the voxel, not on the order of computation.
fn with_noise(volume: &Volume, hu: f64) -> Volume {
    let noisy = |(n, v): (usize, &i16)| (f64::from(*v) + hu * hash::normal(11, n as u64)).round() as i16;
    Volume::new(volume.grid().clone(), volume.data().iter().enumerate().map(noisy).collect())
}

/// Returns the mean angle between estimate and truth, degrees.
fn degrees(estimator: &Estimator, volume: &Volume, points: &[(DVec3, DVec3)]) -> f64 {
    let estimate = (estimator.make)(volume);
    let angle = |&(p, truth): &(DVec3, DVec3)| {
        let g = estimate.at(volume, volume.grid().voxel(p)).as_dvec3();
        // An estimate without direction counts as the mean error of random directions.
        if g.length() > 0.0 { g.angle_between(truth).to_degrees() } else { 90.0 }
    };
    // Collected in order, so that the sum does not depend on the threads.
    mean(&points.par_iter().map(angle).collect::<Vec<_>>())
}

/// Returns the time of one gradient for each estimator, ns, measured in turns on one thread.
fn nanoseconds(signal: &Signal, points: &[(DVec3, DVec3)]) -> Vec<f64> {
    let made: Vec<_> = ESTIMATORS.iter().map(|e| (e.make)(&signal.volume)).collect();
    let voxels: Vec<DVec3> = points.iter().map(|p| signal.volume.grid().voxel(p.0)).collect();
    let mut rounds = vec![Vec::new(); ESTIMATORS.len()];
    for _ in 0..ROUNDS {
        for (estimate, ns) in made.iter().zip(&mut rounds) {
            let begun = Instant::now();
            estimate.all(&signal.volume, &voxels, &mut |g| _ = black_box(g));
            ns.push(begun.elapsed().as_secs_f64() * 1e9 / voxels.len() as f64);
        }
    }
    rounds.iter().map(|r| median(r)).collect()
}

fn write(lines: &[Line], times: &[Vec<f64>], folder: &Path) -> Result<Vec<String>> {
    let ns = |l: &Line| {
        let shape = SHAPES.iter().position(|s| s.0 == l.shape).unwrap_or(0);
        let estimator = ESTIMATORS.iter().position(|e| e.name == l.estimator).unwrap_or(0);
        times[shape][estimator]
    };
    let mut page = Page::new(folder, "colvis: gradient estimators, error against time")?;
    page.text(
        "Mean angle between the estimated and the analytic gradient at points between voxels, all estimators interpolated \
         trilinearly; times are for one gradient on one thread, the median of alternating rounds. Walls: a tube and a sphere \
         of radius 20 voxels with an edge of 1000 HU blurred by one voxel, and the folded wall of the phantom. The \
         Marschner–Lobb signal is the test of sampling near its limit (41 voxels across, 1000 HU).",
    );
    let findings = findings(lines, &ns);
    page.findings(&findings);
    for (number, (shape, _)) in SHAPES.into_iter().enumerate() {
        for (wall, what) in [(true, "walls"), (false, "Marschner–Lobb")] {
            let series = ESTIMATORS.iter().zip(&times[number]).map(|(e, &ns)| {
                let point = |noise: f64| {
                    let degrees = over(lines, e.name, |l| l.wall == wall && l.shape == shape && l.noise == noise);
                    Point { x: ns, y: degrees, name: format!("{noise:.0} HU") }
                };
                Series::line(e.name, NOISE_HU.map(point))
            });
            let title = format!("Gradients of {what}, {shape}, noise 0 to 100 HU");
            let (x, y) = ("time of one gradient / ns", "mean angular error / degrees");
            let plot = Plot::new(title, x, y, series.collect());
            let file = format!("{}-{}", if wall { "walls" } else { "marschner-lobb" }, ["cubic", "1-1-3"][number]);
            page.plot(&file, &plot, "Each line is one estimator; its lower end is noise-free.")?;
        }
    }
    page.section("All numbers");
    let table = table!(for l in lines;
        "signal" => l.signal,
        "voxels" => l.shape,
        "noise / HU" => (l.noise, 0),
        "estimator" => l.estimator,
        "mean error / degrees" => (l.degrees, 2),
        "time / ns" => (ns(l), 1),
    );
    page.table("gradients", &table)?;
    page.finish()?;
    Ok(findings)
}

/// Returns the mean error of an estimator over the selected lines.
fn over(lines: &[Line], estimator: &str, meant: impl Fn(&Line) -> bool) -> f64 {
    mean(&lines.iter().filter(|l| l.estimator == estimator && meant(l)).map(|l| l.degrees).collect::<Vec<_>>())
}

/// Returns the findings, in two sentences.
fn findings(lines: &[Line], ns: &dyn Fn(&Line) -> f64) -> Vec<String> {
    let scanner = |l: &Line| l.wall && l.noise == NOISE_HU[1] && l.shape == SHAPES[0].0;
    let error = |e: &Estimator| over(lines, e.name, scanner);
    let time = |e: &Estimator| lines.iter().find(|l| l.estimator == e.name && scanner(l)).map_or(f64::NAN, ns);
    let direct = || ESTIMATORS.iter().filter(|e| !e.stored);
    let best = direct().min_by(|a, b| error(a).total_cmp(&error(b)));
    let quickest = direct().min_by(|a, b| time(a).total_cmp(&time(b)));
    let stored = ESTIMATORS.iter().filter(|e| e.stored).min_by(|a, b| time(a).total_cmp(&time(b)));
    let (Some(best), Some(quickest), Some(stored)) = (best, quickest, stored) else { return Vec::new() };
    let clean = |e: &Estimator| over(lines, e.name, |l| !l.wall && l.noise == 0.0 && l.shape == SHAPES[0].0);
    let sharp = direct().min_by(|a, b| clean(a).total_cmp(&clean(b))).unwrap_or(best);
    vec![
        format!(
            "On walls with a scanner's noise ({:.0} HU, cubic voxels) {} has the smallest error, {:.2}° in {:.0} ns; the fastest, {}, takes {:.0} ns with {:.2}°. On the noise-free Marschner–Lobb signal {} is most accurate.",
            NOISE_HU[1],
            best.name,
            error(best),
            time(best),
            quickest.name,
            time(quickest),
            error(quickest),
            sharp.name
        ),
        format!(
            "Precomputed ({}), a gradient takes {:.0} ns, {:.1} times less than {} on demand, with an error of {:.2}°, for {} bytes \
             a voxel.",
            stored.name,
            time(stored),
            time(best) / time(stored),
            best.name,
            error(stored),
            stored.bytes
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn findings_follow_the_numbers() {
        let line = |estimator, degrees| Line {
            signal: "tube",
            wall: true,
            shape: SHAPES[0].0,
            noise: NOISE_HU[1],
            estimator,
            degrees,
        };
        let mut lines: Vec<Line> = ESTIMATORS.iter().enumerate().map(|(n, e)| line(e.name, 1.0 + n as f64)).collect();
        let ns = |l: &Line| 10.0 + l.degrees;
        assert!(findings(&lines, &ns)[0].contains(&format!("{} has the smallest error", ESTIMATORS[0].name)));
        lines[2].degrees = 0.25;
        assert!(findings(&lines, &ns)[0].contains(&format!("{} has the smallest error, 0.25°", ESTIMATORS[2].name)));
    }
}
