//! What threads give: a frame of a flight, and the jobs before a flight, on 1, 2, 4, … of them.

use std::sync::Mutex;
use std::time::{Duration, Instant};

use rayon::ThreadPool;

use crate::app::{FlightRequest, Scan, Scene};
use crate::error::{Error, Result};
use crate::fields::centerline::{self, End};
use crate::fields::{Through, WallDistance, cleanse, lumen};
use crate::polyps::Wall;
use crate::progress::Progress;
use crate::render::awake::awake;
use crate::render::{Frame, Preset, Renderer, Reuse, Settings, View, renderer};
use crate::report::page::Page;
use crate::report::table::table;
use crate::report::{Effort, median, quantile};
use crate::space::PreparedVolume;

/// Steps of the flight between two frames.
const STEPS: usize = 2;
/// Frames that one pool renders before the next has its turn: the second and later ones are in flight.
const TURN: usize = 10;
/// Names of the jobs, in the order of [`jobs`].
const JOBS: [&str; 5] = ["lumen", "distance", "centerline", "wall", "cleansing"];

/// The measurements with a number of threads.
struct Row {
    threads: usize,
    /// Times of the frames, ms.
    ms: Vec<f64>,
    /// Times of the jobs, s, in the order of [`JOBS`].
    jobs: [Vec<f64>; JOBS.len()],
    /// Until the last thread has begun with a loop, µs: after a rest, and kept awake.
    late_us: [Vec<f64>; 2],
}

struct Runner {
    row: Row,
    pool: ThreadPool,
    renderer: Box<dyn Renderer>,
}

/// Measures on `volume`, and adds a section to the page. Returns the finding, one sentence.
pub(super) fn section(volume: &PreparedVolume, effort: Effort, page: &mut Page, progress: &Progress) -> Result<String> {
    let (frames, side, repeats) = effort.choose((20, 256, 1), (300, 1024, 3));
    let views = views(volume, frames, side, progress)?;
    let mut runners =
        counts(rayon::current_num_threads()).map(|n| Runner::new(n, volume)).collect::<Result<Vec<_>>>()?;
    let mut frame = Frame::new(side, side);
    progress.stage("measuring threads", (views.len() / TURN * runners.len()) as u64);
    for (turn, views) in views.chunks(TURN).enumerate() {
        for n in 0..runners.len() {
            let n = (turn + n) % runners.len();
            runners[n].frames(views, &mut frame);
            progress.advance(1)?;
        }
    }
    progress.stage("measuring jobs", (repeats * runners.len()) as u64);
    for n in 0..repeats * runners.len() {
        let which = n % runners.len();
        runners[which].jobs(volume, progress)?;
        progress.advance(1)?;
    }
    let rows: Vec<Row> = runners.into_iter().map(|r| r.row).collect();
    write(&rows, side, page)
}

/// Returns 1, 2, 4, …, and the number that there are.
fn counts(all: usize) -> impl Iterator<Item = usize> {
    let powers = std::iter::successors(Some(1), |n| Some(n * 2)).take_while(move |&n| n < all);
    powers.chain([all])
}

/// Returns views of a flight, one for each of its frames.
fn views(volume: &PreparedVolume, frames: usize, side: usize, progress: &Progress) -> Result<Vec<View>> {
    let mut scan = Scan::prepared(volume.clone(), std::sync::Arc::new(progress.clone()));
    let mut flight = scan.flight(Scene::default(), &FlightRequest::default())?;
    let view = |_| {
        for _ in 0..STEPS {
            flight.step()?;
        }
        let pose = flight.pose();
        View::new(pose.position, pose.attitude.forward, pose.attitude.up, 90.0, side, side)
    };
    (0..frames).map(view).collect()
}

impl Runner {
    fn new(threads: usize, volume: &PreparedVolume) -> Result<Self> {
        let built = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let pool = built.map_err(|e| Error::fault("threads", e.to_string(), "try fewer").caused_by(e))?;
        let renderer = pool.install(|| renderer(volume, Settings::default(), Preset::default(), Reuse::Allowed));
        let row = Row { threads, ms: Vec::new(), jobs: Default::default(), late_us: Default::default() };
        Ok(Self { row, pool, renderer })
    }

    /// Renders consecutive frames, with a rest between them as a window's event loop makes.
    fn frames(&mut self, views: &[View], frame: &mut Frame) {
        let Self { row, pool, renderer } = self;
        pool.install(|| {
            for (n, view) in views.iter().enumerate() {
                let begun = Instant::now();
                awake(|| renderer.render(view, frame));
                if n > 0 {
                    row.ms.push(begun.elapsed().as_secs_f64() * 1e3);
                }
                std::thread::sleep(Duration::from_millis(1));
            }
            for (k, late) in row.late_us.iter_mut().enumerate() {
                std::thread::sleep(Duration::from_millis(1));
                late.push(if k == 0 { latest() } else { awake(|| (latest(), latest()).1) });
            }
        });
    }

    fn jobs(&mut self, volume: &PreparedVolume, progress: &Progress) -> Result<()> {
        let Self { row, pool, .. } = self;
        let times = pool.install(|| jobs(volume, progress))?;
        row.jobs.iter_mut().zip(times).for_each(|(all, s)| all.push(s));
        Ok(())
    }
}

/// Runs the jobs of [`JOBS`]. Returns the seconds that each took.
fn jobs(volume: &PreparedVolume, progress: &Progress) -> Result<[f64; JOBS.len()]> {
    let mut times = [0.0; JOBS.len()];
    let mut begun = Instant::now();
    let mut next = 0;
    let mut done = || {
        times[next] = begun.elapsed().as_secs_f64();
        (next, begun) = (next + 1, Instant::now());
    };
    let voxels = volume.voxels();
    let lumen = lumen::find(voxels, progress)?;
    done();
    let walls = WallDistance::of_lumen(voxels, &lumen, Through::GasAndFluid, progress)?;
    done();
    let largest = lumen
        .largest()
        .ok_or_else(|| Error::incomplete("scan", "no gas of a colon was found in it", "report on another scan"))?;
    let [from, to] = lumen.segments[largest].ends.map(End::Tip);
    centerline::between(&walls, from, to, &[], progress)?;
    done();
    Wall::new(voxels, &lumen, volume.transfer().iso(), progress)?;
    done();
    cleanse::cleanse(voxels, &lumen, progress)?;
    done();
    Ok(times)
}

/// Returns how long it takes until every thread of this pool has begun with a loop's part, µs.
fn latest() -> f64 {
    let begun = Instant::now();
    let last = Mutex::new(0.0f64);
    rayon::broadcast(|_| {
        let us = begun.elapsed().as_secs_f64() * 1e6;
        if let Ok(mut last) = last.lock() {
            *last = last.max(us);
        }
    });
    last.into_inner().unwrap_or(f64::NAN)
}

fn write(rows: &[Row], side: usize, page: &mut Page) -> Result<String> {
    let one = &rows[0];
    page.section("Threads");
    page.text(&format!(
        "Frames of {side} × {side} pixels of a flight, in the default quality, with 1 ms of rest between them; the gain is over one thread. A loop begins late because threads sleep \
         when they find no work: the time until the last of them has begun, after a rest and while a frame keeps them awake."
    ));
    let table = table!(for r in rows;
        "threads" => r.threads,
        "frame / ms" => (median(&r.ms), 2),
        "99 % / ms" => (quantile(&r.ms, 0.99), 2),
        "gain" => (median(&one.ms) / median(&r.ms), 2),
        "a loop begins after a rest / µs" => (median(&r.late_us[0]), 0),
        "99 % / µs" => (quantile(&r.late_us[0], 0.99), 0),
        "awake / µs" => (median(&r.late_us[1]), 0),
        "awake, 99 % / µs" => (quantile(&r.late_us[1], 0.99), 0),
    );
    page.table("threads", &table)?;
    let lines = rows.iter().flat_map(|r| JOBS.iter().enumerate().map(move |(n, job)| (r, n, job)));
    let table = table!(for (r, n, job) in lines;
        let s = median(&r.jobs[n]);
        "job" => *job,
        "threads" => r.threads,
        "time / s" => (s, 3),
        "gain" => (median(&one.jobs[n]) / s, 2),
    );
    page.table("jobs", &table)?;
    let last = &rows[rows.len() - 1];
    Ok(format!(
        "{} threads render a frame of {side} × {side} pixels {:.1} times as fast as one, and make the jobs before a flight {} times as fast.",
        last.threads,
        median(&one.ms) / median(&last.ms),
        JOBS.iter()
            .enumerate()
            .map(|(n, job)| format!("{:.1} ({job})", median(&one.jobs[n]) / median(&last.jobs[n])))
            .collect::<Vec<_>>()
            .join(", ")
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_double_up_to_all() {
        let of = |n| counts(n).collect::<Vec<_>>();
        assert_eq!([of(1), of(2), of(6), of(16)], [vec![1], vec![1, 2], vec![1, 2, 4, 6], vec![1, 2, 4, 8, 16]]);
    }
}
