//! Measurements on one volume.

use glam::DVec3;

use super::METHODS;
use crate::error::{Error, Result};
use crate::fields::centerline::{self, Centerline, End};
use crate::fields::distance::compare::{self, Cheap};
use crate::fields::{Through, WallDistance, lumen};
use crate::math::hash;
use crate::phantom::Phantom;
use crate::progress::Progress;
use crate::report::{mean, quantile, timed};
use crate::volume::Volume;

/// The distance methods, the exact one first.
pub(super) const DISTANCES: [&str; 3] = ["exact", "chamfer", "chessboard"];
/// Number of voxels at which distances are compared with the analytic wall.
const PROBES: usize = 4000;
/// Largest distance from the analytic wall for the comparison, mm, as that wall is of first order.
const WALL_MM: f64 = 2.0;

/// Results of one distance method in one volume.
#[derive(Clone, Copy, Debug)]
pub(super) struct DistanceLine {
    pub method: &'static str,
    pub seconds: f64,
    pub megabytes: Option<f64>,
    /// Compared with the exact distance, over the lumen.
    pub mean_mm: f64,
    pub max_mm: f64,
    /// Mean error against the analytic wall near it.
    pub wall_mm: Option<f64>,
}

/// Results of one centerline method in one volume.
#[derive(Clone, Copy, Debug)]
pub(super) struct LineLine {
    pub method: &'static str,
    pub seconds: f64,
    pub megabytes: Option<f64>,
    pub mean_mm: Option<f64>,
    pub p95_mm: Option<f64>,
    pub max_mm: Option<f64>,
    pub length_mm: f64,
    pub least_radius_mm: f64,
}

/// All results for one volume.
#[derive(Clone, Debug)]
pub(super) struct Measured {
    pub title: String,
    /// Short name in plots.
    pub short: String,
    pub volume_bytes: usize,
    /// Size of lumen and wall distance in memory.
    pub field_bytes: usize,
    pub lumen_s: f64,
    pub distances: Vec<DistanceLine>,
    pub lines: Vec<LineLine>,
}

/// Measures every method on a volume, and compares it with the ground truth if `phantom` is given.
pub(super) fn measure(
    title: &str,
    volume: &Volume,
    phantom: Option<&Phantom>,
    progress: &Progress,
) -> Result<Measured> {
    let (lumen, lumen_s, _) = timed(|| lumen::find(volume, progress));
    let lumen = lumen?;
    let Some(largest) = lumen.largest() else {
        return Err(Error::incomplete(title, "no gas of a colon was found in it", "report on another scan"));
    };
    // The first allocation pays for the memory, so it is done once without timing.
    drop(WallDistance::of_lumen(volume, &lumen, Through::GasAndFluid, progress)?);
    let (walls, seconds, megabytes) = timed(|| WallDistance::of_lumen(volume, &lumen, Through::GasAndFluid, progress));
    let walls = walls?;
    let probes = phantom.map(|p| probes(&walls, p)).unwrap_or_default();
    let against = |value: &dyn Fn(usize) -> f32| {
        let errors: Vec<f64> = probes.iter().map(|&(n, truth)| (f64::from(value(n)) - truth).abs()).collect();
        Some(mean(&errors)).filter(|_| !errors.is_empty())
    };
    let mut distances = vec![DistanceLine {
        method: DISTANCES[0],
        seconds,
        megabytes,
        mean_mm: 0.0,
        max_mm: 0.0,
        wall_mm: against(&|n| walls.value(n)),
    }];
    for (method, kind) in DISTANCES.into_iter().skip(1).zip([Cheap::Chamfer, Cheap::Chessboard]) {
        progress.check()?;
        let (values, seconds, megabytes) = timed(|| compare::distances(&walls, kind));
        let inside = walls.values().zip(&values).filter(|(d, _)| *d >= 0.0);
        let (mut sum, mut max_mm, mut count) = (0.0, 0.0f64, 0.0f64);
        for (d, v) in inside {
            let error = f64::from((v - d).abs());
            (sum, max_mm, count) = (sum + error, max_mm.max(error), count + 1.0);
        }
        let wall_mm = against(&|n| values[n]);
        distances.push(DistanceLine { method, seconds, megabytes, mean_mm: sum / count.max(1.0), max_mm, wall_mm });
    }
    let ends = lumen.segments[largest].ends;
    let truth = phantom.map(Phantom::truth).map(|t| t.centerline);
    let mut lines = Vec::new();
    for (method, name) in METHODS {
        progress.check()?;
        let [from, to] = ends.map(End::Tip);
        let (line, seconds, megabytes) = timed(|| centerline::by(method, &walls, from, to, &[], progress));
        lines.push(line_of(name, &line?, seconds, megabytes, truth.as_deref()));
    }
    Ok(Measured {
        title: title.to_owned(),
        short: title.rsplit(' ').next().unwrap_or(title).to_owned(),
        volume_bytes: volume.bytes(),
        field_bytes: lumen.bytes() + walls.bytes(),
        lumen_s,
        distances,
        lines,
    })
}

fn line_of(
    method: &'static str,
    line: &Centerline,
    seconds: f64,
    megabytes: Option<f64>,
    truth: Option<&[DVec3]>,
) -> LineLine {
    let errors = truth.map(|t| line.points.iter().map(|&p| off(p, t)).collect::<Vec<f64>>());
    LineLine {
        method,
        seconds,
        megabytes,
        mean_mm: errors.as_ref().map(|e| mean(e)),
        p95_mm: errors.as_ref().map(|e| quantile(e, 0.95)),
        max_mm: errors.as_ref().map(|e| quantile(e, 1.0)),
        length_mm: line.length_mm,
        least_radius_mm: line.radius_mm.iter().copied().fold(f64::INFINITY, f64::min),
    }
}

/// Returns the distance of a point from a line, mm.
fn off(p: DVec3, line: &[DVec3]) -> f64 {
    let part = |w: &[DVec3]| {
        let direction = w[1] - w[0];
        let t = ((p - w[0]).dot(direction) / direction.length_squared().max(1e-12)).clamp(0.0, 1.0);
        p.distance(w[0] + direction * t)
    };
    line.windows(2).map(part).fold(f64::INFINITY, f64::min)
}

/// Returns voxels of the lumen near the wall (their indices) with their distance to the analytic wall, mm.
fn probes(walls: &WallDistance, phantom: &Phantom) -> Vec<(usize, f64)> {
    let count = walls.values().len();
    (0..)
        .map(|n| (hash::uniform(17, n) * count as f64) as usize)
        .take(40 * PROBES)
        .filter(|&n| (0.0..WALL_MM as f32 + 0.5).contains(&walls.value(n)))
        .map(|n| (n, -phantom.wall(walls.world(walls.set().voxel(n)))))
        .filter(|p| (0.0..WALL_MM).contains(&p.1))
        .take(PROBES)
        .collect()
}
