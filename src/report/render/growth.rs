//! How the default renderer's time grows with the volume, and the effect of threads and SIMD levels.

use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use rayon::ThreadPool;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::render::packets::{self, PacketRenderer, Pixels};
use crate::render::{Frame, Renderer, Settings};
use crate::report::flight::{self, Flown, Stop};
use crate::report::{median, quantile};
use crate::space::PreparedVolume;
use crate::volume::{Grid, Volume};

use super::Extent;

/// Number of times that a preparation is timed.
const BUILDS: usize = 3;

/// One configuration of the same renderer.
pub(crate) struct Row {
    /// Name of the configuration.
    pub name: String,
    /// Number of voxels of its volume.
    pub voxels: usize,
    /// Time to prepare the volume for rays, s.
    pub prepare_s: f64,
    /// Memory in addition to the voxels, bytes.
    pub bytes: usize,
    /// Time of each frame, ms.
    pub ms: Vec<f64>,
    /// Rays and samples of all frames.
    pub rays: u64,
    /// See `rays`.
    pub samples: u64,
    /// Largest difference of a pixel from the first row's, grey levels.
    pub off: u8,
}

impl Row {
    /// Returns the median frame time, ms.
    pub(crate) fn median(&self) -> f64 {
        median(&self.ms)
    }

    /// Returns the 99th percentile of the frame time, ms.
    pub(crate) fn p99(&self) -> f64 {
        quantile(&self.ms, 0.99)
    }
}

/// Results of the measurement.
pub(crate) struct Growth {
    /// Volumes with increasing numbers of voxels.
    pub volumes: Vec<Row>,
    /// Numbers of threads.
    pub threads: Vec<Row>,
    /// SIMD levels.
    pub levels: Vec<Row>,
    /// True if the flight's log is the same for every number of threads.
    pub same_log: bool,
}

/// Measures at the poses of `stops`, rendered by all configurations in turn.
pub(crate) fn growth(
    volume: &PreparedVolume,
    flown: &Flown,
    stops: &[Stop],
    extent: &Extent,
    progress: &Progress,
) -> Result<Growth> {
    let mut sized = Vec::new();
    for &side in extent.sides {
        progress.stage("resampling", 1);
        let voxels = Arc::new(resample(volume.voxels(), side)?);
        sized.push(Runner::new(format!("{side}³"), &voxels, volume, None, packets::levels()[0].1)?);
        progress.advance(1)?;
    }
    let volumes = race(sized, stops, extent, progress)?;

    let voxels = volume.shared_voxels();
    let best = packets::levels()[0].1;
    let mut counts = vec![1, 2, rayon::current_num_threads()];
    counts.sort_unstable();
    counts.dedup();
    let pools = counts.iter().map(|&n| pool(n)).collect::<Result<Vec<_>>>()?;
    let mut same_log = true;
    for p in &pools {
        same_log &= p.install(|| flight::fly(volume, progress))?.log == flown.log;
    }
    let with_threads =
        counts.iter().zip(pools).map(|(n, p)| Runner::new(n.to_string(), &voxels, volume, Some(p), best));
    let threads = race(with_threads.collect::<Result<_>>()?, stops, extent, progress)?;
    let on_level =
        packets::levels().into_iter().map(|(name, l)| Runner::new(name.to_owned(), &voxels, volume, None, l));
    let levels = race(on_level.collect::<Result<_>>()?, stops, extent, progress)?;
    Ok(Growth { volumes, threads, levels, same_log })
}

fn pool(threads: usize) -> Result<ThreadPool> {
    let built = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    built.map_err(|e| Error::fault("threads", e.to_string(), "try fewer").caused_by(e))
}

struct Runner {
    row: Row,
    pool: Option<ThreadPool>,
    renderer: PacketRenderer,
}

impl Runner {
    fn new(
        name: String,
        voxels: &Arc<Volume>,
        like: &PreparedVolume,
        pool: Option<ThreadPool>,
        level: fearless_simd::Level,
    ) -> Result<Self> {
        let make = || {
            let volume = PreparedVolume::new(Arc::clone(voxels), like.transfer());
            PacketRenderer::with_level(&volume, Settings::default(), Pixels::Needed, level)
        };
        let build = || {
            let begun = Instant::now();
            let renderer = make();
            (begun.elapsed().as_secs_f64(), renderer)
        };
        let mut times = Vec::new();
        let mut renderer = None;
        for _ in 0..BUILDS {
            drop(renderer.take());
            let (s, made) = pool.as_ref().map_or_else(build, |p| p.install(build));
            times.push(s);
            renderer = Some(made);
        }
        let renderer = renderer.ok_or_else(|| Error::fault("renderer", "was not built", "build one"))?;
        let row = Row {
            name,
            voxels: voxels.grid().len(),
            prepare_s: median(&times),
            bytes: 0,
            ms: Vec::new(),
            rays: 0,
            samples: 0,
            off: 0,
        };
        Ok(Self { row, pool, renderer })
    }

    fn render(&mut self, view: &crate::render::View, frame: &mut Frame) -> (f64, crate::render::Work) {
        let renderer = &mut self.renderer;
        let mut timed = || {
            let begun = Instant::now();
            let work = renderer.render(view, frame);
            (begun.elapsed().as_secs_f64() * 1e3, work)
        };
        match &self.pool {
            Some(pool) => pool.install(timed),
            None => timed(),
        }
    }
}

/// Renders each pose with all configurations in turn, after the preceding frame of the flight.
fn race(mut runners: Vec<Runner>, stops: &[Stop], extent: &Extent, progress: &Progress) -> Result<Vec<Row>> {
    progress.stage("measuring", stops.len() as u64);
    let side = extent.pixels * 2;
    let (mut first, mut frame) = (Frame::new(side, side), Frame::new(side, side));
    for stop in stops {
        let view = stop.pose.view(extent.fov_degrees, side)?;
        let before = stop.lead.last().unwrap_or(&stop.pose).view(extent.fov_degrees, side)?;
        for (n, runner) in runners.iter_mut().enumerate() {
            runner.render(&before, &mut frame);
            let (ms, work) = runner.render(&view, &mut frame);
            let row = &mut runner.row;
            row.ms.push(ms);
            row.rays += work.rays;
            row.samples += work.samples;
            if n == 0 {
                std::mem::swap(&mut first, &mut frame);
            } else {
                let off = |(a, b): (&[u8; 3], &[u8; 3])| a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max();
                let most = first.pixels().iter().zip(frame.pixels()).filter_map(off).max();
                row.off = row.off.max(most.unwrap_or(0));
            }
        }
        progress.advance(1)?;
    }
    let finish = |mut r: Runner| {
        r.row.bytes = r.renderer.bytes();
        r.row
    };
    Ok(runners.into_iter().map(finish).collect())
}

/// Resamples the same body to `side`³ voxels by trilinear interpolation. Fails if that many voxels cannot be addressed or
/// allocated.
fn resample(voxels: &Volume, side: usize) -> Result<Volume> {
    let grid = voxels.grid();
    let dims = grid.dims();
    let ratio = DVec3::from_array(dims.map(|d| (d as f64 - 1.0) / (side as f64 - 1.0)));
    let new = Grid::new([side; 3], grid.spacing() * ratio, grid.origin(), grid.direction());
    let too_large =
        |why: String| Error::fault(format!("{side}³ voxels"), why, "run the full report on a machine with more memory");
    let new = new.map_err(|e| too_large(e.why))?;
    let mut data = Vec::new();
    data.try_reserve_exact(new.len()).map_err(|e| too_large(e.to_string()))?;
    data.resize(new.len(), 0i16);
    // The voxels before and behind, and the weight of the one behind.
    let between = |axis: usize| -> Vec<(usize, usize, f32)> {
        let at = |n: usize| n as f64 * ratio[axis];
        let split = |u: f64| {
            let low = (u as usize).min(dims[axis] - 1);
            (low, (low + 1).min(dims[axis] - 1), (u - low as f64) as f32)
        };
        (0..side).map(|n| split(at(n))).collect()
    };
    let [xs, ys, zs] = [between(0), between(1), between(2)];
    let row = |j: usize, k: usize| &voxels.data()[grid.index(0, j, k)..][..dims[0]];
    data.par_chunks_mut(side * side).zip(&zs).for_each(|(slice, &(k0, k1, tz))| {
        let mut line = vec![0f32; dims[0]];
        for (out, &(j0, j1, ty)) in slice.chunks_exact_mut(side).zip(&ys) {
            let rows = [row(j0, k0), row(j1, k0), row(j0, k1), row(j1, k1)];
            let mix = |a: i16, b: i16, t: f32| f32::from(a) + (f32::from(b) - f32::from(a)) * t;
            for (i, v) in line.iter_mut().enumerate() {
                let (low, high) = (mix(rows[0][i], rows[1][i], ty), mix(rows[2][i], rows[3][i], ty));
                *v = low + (high - low) * tz;
            }
            for (out, &(i0, i1, tx)) in out.iter_mut().zip(&xs) {
                *out = (line[i0] + (line[i1] - line[i0]) * tx).round() as i16;
            }
        }
    });
    Ok(Volume::new(new, data))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn resampling_keeps_the_body_in_its_place() {
        let spacing = DVec3::new(0.5, 1.0, 2.0);
        let grid = Grid::new([9, 7, 5], spacing, DVec3::new(3.0, -2.0, 1.0), glam::DMat3::IDENTITY).unwrap();
        let of = |p: DVec3| 100.0 * p.x - 50.0 * p.y + 20.0 * p.z;
        let data = (0..grid.len())
            .map(|n| of(grid.world(DVec3::new((n % 9) as f64, (n / 9 % 7) as f64, (n / 63) as f64))) as i16)
            .collect();
        let fine = resample(&Volume::new(grid, data), 17).unwrap();
        for (n, &v) in fine.data().iter().enumerate() {
            let at = DVec3::new((n % 17) as f64, (n / 17 % 17) as f64, (n / 289) as f64);
            assert!((f64::from(v) - of(fine.grid().world(at))).abs() <= 1.0, "{at}");
        }
        let last = fine.grid().world(DVec3::splat(16.0));
        assert!(last.distance(DVec3::new(3.0 + 4.0, -2.0 + 6.0, 1.0 + 8.0)) < 1e-9);
        // A single slice has no neighbour to interpolate with.
        let flat = Grid::new([4, 4, 1], DVec3::ONE, DVec3::ZERO, glam::DMat3::IDENTITY).unwrap();
        assert!(resample(&Volume::new(flat, vec![7; 16]), 8).is_err());
    }
}
