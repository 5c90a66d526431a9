//! Writes a dataset into a folder that is whole or not there.
//!
//! Frames are written into a folder beside it, `NAME.part`, by threads of their own while the next ones are measured, each file whole or
//! not at all. When all are there, the lists, the README and the checksums are added, and the folder gets its name. A run that was cut
//! short goes on where it was: frames whose files are there are not measured again. Nothing depends on when, so the bytes are the same.

mod exr;
mod moments;
mod part;
mod points;
mod readme;
mod shots;
mod wall;

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use glam::DVec3;

pub use part::Part;

use super::camera::{Intrinsics, VisionPose};
use super::deform::Deformation;
use super::layout::{Entry, Index, Layout};
use super::look::{Look, Painter};
use super::truth::{Kind, Labels, Neighbour, Rings, Subject, Times, Truth};
use crate::error::Result;
use crate::progress::Progress;
use crate::render::View;
use crate::render::leap::Crossings;
use crate::space::PreparedVolume;
use crate::surface::LumenMesh;
use moments::Moments;
use shots::{Taken, is_there, kept};
use wall::Seen;

/// Threads that write files.
const WRITERS: usize = 2;

/// What a dataset is made of.
pub struct Source<'a> {
    /// The scan.
    pub volume: &'a PreparedVolume,
    /// How it is deformed.
    pub deformation: Option<Deformation>,
    /// The cameras, and when each takes its picture, s.
    pub views: &'a (dyn Fn(usize) -> Result<(View, f64)> + Sync),
    /// Number of frames.
    pub count: usize,
    /// Frames a second.
    pub fps: f64,
    /// The camera.
    pub camera: Intrinsics,
    /// The line of the colon.
    pub rings: Option<Rings>,
    /// The wall.
    pub wall: Option<LumenMesh>,
    /// What the wall belongs to.
    pub labels: Option<&'a Labels<'a>>,
    /// The names of the labels' numbers, and those of the parts.
    pub names: [Vec<String>; 2],
    /// Which ground truth.
    pub kinds: Vec<Kind>,
    /// How the pictures look.
    pub look: Look,
    /// Chooses the noise and the mucosa's colour.
    pub seed: u64,
    /// What identifies the dataset beside the above: the command, the version, and the scan's hash.
    pub told: serde_json::Value,
}

/// What was written, and the time that it took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Written {
    /// Frames measured now. The others were there.
    pub measured: usize,
    /// Frames in all.
    pub frames: usize,
    /// Time of the truth's parts, all frames together.
    pub truth: Times,
    /// Time of the pictures.
    pub look: Duration,
    /// Time that files took, on their own threads.
    pub files: Duration,
    /// Time from the first frame to the last file.
    pub whole: Duration,
}

/// Writes a dataset to `folder`. Returns what was done.
///
/// # Errors
/// Returns status 2 if the folder is there and holds something else, 4 if interrupted, 5 if a file cannot be written.
pub fn write(source: &Source<'_>, layout: &dyn Layout, folder: &Path, progress: &Progress) -> Result<Written> {
    let begun = Instant::now();
    let Some(part) = Part::begin(folder, &source.identity())? else {
        return Ok(Written { frames: source.count, ..Written::default() });
    };
    let rays = Crossings::new(source.volume, progress)?;
    progress.stage("measuring frames", source.count as u64);
    let mut written = Written { frames: source.count, ..Written::default() };
    let files = Mutex::new(Ok(Duration::ZERO));
    let (send, receive) = sync_channel::<Taken>(WRITERS);
    let (give_back, used) = channel();
    let receive = Mutex::new(receive);
    let mut seen = source.wall.as_ref().map(|mesh| Seen::new(source, mesh));
    let shot = std::thread::scope(|scope| {
        for _ in 0..WRITERS {
            let give_back = give_back.clone();
            scope.spawn(|| save((&receive, give_back), part.path(), layout, &files));
        }
        let taken = take_all(
            (source, &rays),
            (layout, part.path()),
            &files,
            (&send, &used),
            (&mut written, &mut seen),
            progress,
        );
        // The threads end when there is no sender left.
        drop(send);
        taken
    });
    written.files = files.into_inner().unwrap_or_else(PoisonError::into_inner)?;
    shot?;
    progress.stage("finishing", 0);
    let frames = (0..source.count).map(|n| source.entry(n)).collect::<Result<Vec<Entry>>>()?;
    let points = points::find((source, &rays), layout, part.path(), progress)?;
    let size = if source.count > 0 { (source.views)(0)?.0 } else { return Ok(written) };
    let index = Index {
        camera: &source.camera,
        size: [size.width(), size.height()],
        fps: source.fps,
        kinds: &source.kinds,
        frames: &frames,
        points: &points,
    };
    if let Some(mut seen) = seen {
        if source.deformation.is_none() {
            seen.look_at_all(&rays, progress)?;
        }
        seen.write(part.path(), progress)?;
    }
    part.finish(source, layout, &index, progress)?;
    written.whole = begun.elapsed();
    Ok(written)
}

impl Source<'_> {
    /// Returns what makes two datasets the same.
    fn identity(&self) -> serde_json::Value {
        serde_json::json!({
            "frames": self.count, "fps": self.fps, "camera": self.camera, "truth": self.kinds, "look": self.look, "seed": self.seed,
            "labels": self.names[0], "deformation": self.deformation, "parts": self.names[1], "source": self.told,
        })
    }

    fn entry(&self, n: usize) -> Result<Entry> {
        let (view, seconds) = (self.views)(n)?;
        Ok(Entry { n, seconds, pose: VisionPose::of(&view) })
    }
}

/// Measures the frames that are not there, in order, and hands them to those who write.
fn take_all(
    (source, rays): (&Source<'_>, &Crossings),
    (layout, folder): (&dyn Layout, &Path),
    files: &Mutex<Result<Duration>>,
    (send, used): (&SyncSender<Taken>, &Receiver<Truth>),
    (written, seen): (&mut Written, &mut Option<Seen<'_>>),
    progress: &Progress,
) -> Result<()> {
    let painter = Painter::new(&source.look, source.seed);
    let mut moments = Moments::new(source, rays);
    for n in 0..source.count {
        progress.check()?;
        if files.lock().unwrap_or_else(PoisonError::into_inner).is_err() {
            return Ok(());
        }
        let (view, seconds) = (source.views)(n)?;
        // What is deformed is only now as this frame sees it. Otherwise all frames are looked at together.
        if let Some(seen) = seen.as_mut().filter(|seen| source.deformation.is_some() && seen.wants(n)) {
            seen.look_at(n, &moments.at(seconds, progress)?.rays, progress)?;
        }
        if !is_there(folder, layout, source, (n, seconds)) {
            let near = |n: usize| (source.views)(n);
            let around =
                [n.checked_sub(1).map(near).transpose()?, (n + 1 < source.count).then(|| near(n + 1)).transpose()?];
            let now = moments.at(seconds, progress)?;
            let tissue = |place: DVec3| source.deformation.map_or(place, |d| d.tissue(place, seconds));
            let then = [0, 1].map(|k| around[k].as_ref().map(|a| moments.at(a.1, progress)));
            let [before, after] = then.map(Option::transpose);
            let then = [before?, after?];
            let to = |k: usize| {
                let other = around[k].as_ref().map_or(0.0, |a| a.1);
                move |place: DVec3| source.deformation.map_or(place, |d| d.place(d.tissue(place, seconds), other))
            };
            let moved = [to(0), to(1)];
            let is_deformed = source.deformation.is_some();
            let neighbour = |k: usize| {
                let (rays, view) = (&then[k].as_ref()?.rays, &around[k].as_ref()?.0);
                let moved: &(dyn Fn(DVec3) -> DVec3 + Sync) = &moved[k];
                Some(Neighbour { rays, view, moved: is_deformed.then_some(moved) })
            };
            let subject = Subject {
                volume: &now.volume,
                rays: &now.rays,
                view: &view,
                tissue: if is_deformed { Some(&tissue) } else { None },
                neighbours: [neighbour(0), neighbour(1)],
                rings: source.rings.as_ref(),
                labels: source.labels,
            };
            // Memory that was used before needs no clearing.
            let mut truth = used.try_recv().unwrap_or_default();
            truth.measure(subject, &source.kinds, progress)?;
            let begun = Instant::now();
            let picture = painter.draw(&now.volume, &view, &truth.crossings, n as u64);
            written.look += begun.elapsed();
            written.truth += truth.times;
            written.measured += 1;
            let kept = kept(&source.look, n);
            if send.send(Taken { n, seconds, view, truth, picture, kept }).is_err() {
                return Ok(());
            }
        }
        progress.advance(1)?;
    }
    Ok(())
}

/// Writes frames until there are no more, or one cannot be written, and gives the memory of their truth back.
fn save(
    (frames, give_back): (&Mutex<Receiver<Taken>>, Sender<Truth>),
    folder: &Path,
    layout: &dyn Layout,
    files: &Mutex<Result<Duration>>,
) {
    loop {
        let next = frames.lock().unwrap_or_else(PoisonError::into_inner).recv();
        let Ok(taken) = next else { return };
        let begun = Instant::now();
        let saved = taken.save(folder, layout);
        // Nobody wants it once all frames are measured.
        let _ = give_back.send(taken.truth);
        let mut files = files.lock().unwrap_or_else(PoisonError::into_inner);
        match (&mut *files, saved) {
            (Ok(time), Ok(())) => *time += begun.elapsed(),
            // The first failure is told. The others are taken and dropped, so that nobody waits.
            (Ok(_), Err(e)) => *files = Err(e),
            (Err(_), _) => {}
        }
    }
}

impl std::ops::AddAssign for Times {
    fn add_assign(&mut self, o: Self) {
        self.crossings += o.crossings;
        self.flow += o.flow;
        self.anatomy += o.anatomy;
    }
}

/// Returns the path of a file of a dataset.
pub(crate) fn path(folder: &Path, name: &str) -> PathBuf {
    name.split('/').fold(folder.to_owned(), |path, part| path.join(part))
}
