//! Where the pictures of a dataset are taken: a list of poses, a flight, or a flight's log.

use std::sync::Arc;

use glam::DVec3;
use sha2::{Digest, Sha256};

use super::lens;
use crate::app::{FlightApp, Scan};
use crate::cli::args::{DatasetArgs, Global, ImageSize};
use crate::cli::messages::say;
use crate::cli::render::{Poses, camera, read};
use crate::cli::{Program, fly, prepare};
use crate::components::flight::State;
use crate::components::output::LogLine;
use crate::dataset::camera::Intrinsics;
use crate::dataset::deform::Deformation;
use crate::dataset::paths::{Course, PathKind};
use crate::dynamics::STEP_HZ;
use crate::error::{Error, Result};
use crate::fields::ClearanceFinder;
use crate::fields::frames::{evenly, frames};
use crate::progress::Progress;
use crate::render::{Camera, CameraModel, View};
use crate::space;

/// A flight ends after this time, s, as `fly --headless` does.
const MOST_S: f64 = 600.0;
/// Frames a second unless asked otherwise.
const FPS: f64 = 30.0;

/// A path keeps to where the wall is at least so far from the centerline, mm.
const LEAST_ROOM_MM: f64 = 2.0;

/// A pose, and when it is taken, s.
#[derive(Clone, Copy)]
pub(super) struct Take {
    seconds: f64,
    position: DVec3,
    forward: DVec3,
    up: DVec3,
}

/// All poses of a dataset, and their camera.
pub(super) struct Takes {
    pub poses: Vec<Take>,
    pub fps: f64,
    pub camera: Intrinsics,
    pub deformation: Option<Deformation>,
    lens: Arc<dyn Camera>,
    size: ImageSize,
}

/// Refuses what a dataset has no use for. Fails with status 2.
pub(super) fn check(args: &DatasetArgs) -> Result<()> {
    if args.phantoms.is_some() && args.input.is_some() {
        return Err(Error::usage("--phantoms", "takes the place of a scan", "leave one of them out"));
    }
    if args.path.is_some() && args.poses.is_some() {
        return Err(Error::usage("--path", "takes the place of poses", "leave one of them out"));
    }
    if (args.poses.is_some() || args.path.is_some())
        && (args.play.is_some() || args.replay.is_some() || args.guide.is_some())
    {
        let (option, why) = (if args.poses.is_some() { "--poses" } else { "--path" }, "takes the place of a flight");
        return Err(Error::usage(option, why, "leave the flight's options out"));
    }
    fly::check(&args.flight())
}

impl Takes {
    /// Finds the poses of the arguments in a scan. Fails with status 2 for invalid options, 3 for an unusable file, 4 if there is no flight.
    pub(super) fn new(
        program: &Program,
        (args, global): (&DatasetArgs, &Global),
        scan: &mut Scan,
        progress: &Arc<Progress>,
    ) -> Result<Self> {
        let (poses, model) = match &args.poses {
            Some(path) => read(program, global, path)?,
            None => (Poses::default(), prepare::camera(program, global, CameraModel::default())?),
        };
        let size = args.size.map_or_else(|| prepare::usual_size(model), Ok)?;
        let fps = args.fps.unwrap_or(FPS);
        let place = args.poses.as_deref().unwrap_or(std::path::Path::new(""));
        let (lens, _) = camera(global, &poses, model, (place, size))?;
        let takes = match &args.poses {
            Some(_) => poses
                .poses
                .iter()
                .enumerate()
                .map(|(n, p)| {
                    let [position, forward, up] = [p.position, p.forward, p.up].map(DVec3::from_array);
                    Take { seconds: n as f64 / fps, position, forward, up }
                })
                .collect(),
            None => match args.path.as_deref().and_then(PathKind::named) {
                Some(kind) => made((args, global.seed), kind, scan, fps, progress)?,
                None => flown(program, (args, global), scan, fps, progress)?,
            },
        };
        if takes.is_empty() {
            return Err(Error::usage("dataset", "has no pose", "give poses, or a longer flight"));
        }
        let deformation = args.deform.map(Deformation::new).transpose()?;
        let probe = Self { poses: takes, fps, camera: Intrinsics::Panorama, lens, deformation, size };
        let camera = lens::of(&poses, model, global, (&probe.lens, size))?;
        // Every pose is one before any work is done.
        let (volume, iso) = (scan.volume(), scan.volume().transfer().iso());
        for n in 0..probe.poses.len() {
            probe.view(n)?;
            let at = probe.poses[n].position;
            if f64::from(space::value(volume, at)) >= iso {
                let why = format!("pose {n} at {:.1}, {:.1}, {:.1} is in the wall", at.x, at.y, at.z);
                return Err(Error::file(place, why, "give poses in gas"));
            }
        }
        Ok(Self { camera, ..probe })
    }

    /// Returns the camera of a frame, and when it is. Fails with status 2 for a pose that is none.
    pub(super) fn view(&self, n: usize) -> Result<(View, f64)> {
        let Take { seconds, position, forward, up } = self.poses[n];
        let (width, height) = (self.size.width, self.size.height);
        // It moves with the tissue around it, so that it stays in gas.
        let position = self.deformation.map_or(position, |d| d.place(position, seconds));
        let view = View::with_camera(position, forward, up, Arc::clone(&self.lens), width, height);
        let view = view.map_err(|mut e| {
            e.what = format!("pose {n}: {}", e.what);
            e
        })?;
        Ok((view, seconds))
    }

    /// Returns a hash of all poses.
    pub(super) fn hash(&self) -> String {
        let mut hash = Sha256::new();
        for take in &self.poses {
            for value in [take.position, take.forward, take.up].iter().flat_map(|v| v.to_array()).chain([take.seconds])
            {
                hash.update(value.to_le_bytes());
            }
        }
        hash.finalize().iter().map(|b| format!("{b:02x}")).collect()
    }
}

/// Makes a path along the centerline of a scan. Fails with status 4 if there is none, or none that is wide enough.
fn made(
    (args, seed): (&DatasetArgs, Option<u64>),
    kind: PathKind,
    scan: &mut Scan,
    fps: f64,
    progress: &Progress,
) -> Result<Vec<Take>> {
    let why = "has no centerline that a camera could follow";
    let none = || Error::incomplete("--path", why, "give --poses, or fly");
    let along = super::along(scan, progress)?.ok_or_else(none)?;
    let (points, _) = evenly(&along.only_line().ok_or_else(none)?.points);
    let iso = scan.volume().transfer().iso() as f32;
    let clearance = ClearanceFinder::new(scan.volume().shared_voxels(), iso, 40.0);
    let room: Vec<f64> = points.iter().map(|p| clearance.at(*p).mm).collect();
    // The longest part without anything that is collapsed.
    let (mut best, mut first) = (0..0, 0);
    for n in 0..=room.len() {
        if room.get(n).is_none_or(|mm| *mm < LEAST_ROOM_MM) {
            if n - first > best.len() {
                best = first..n;
            }
            first = n + 1;
        }
    }
    let course = Course { frames: frames(&points[best.clone()]), room_mm: room[best].to_vec() };
    let path = course.path(kind, fps, args.noise_seed.or(seed).unwrap_or(1));
    let most = args.seconds.map_or(path.len(), |s| (s * fps).ceil() as usize);
    let take =
        |(n, [position, forward, up]): (usize, [DVec3; 3])| Take { seconds: n as f64 / fps, position, forward, up };
    Ok(path.into_iter().take(most).enumerate().map(take).collect())
}

/// Flies, and returns where the camera is at each frame.
fn flown(
    program: &Program,
    (args, global): (&DatasetArgs, &Global),
    scan: &mut Scan,
    fps: f64,
    progress: &Arc<Progress>,
) -> Result<Vec<Take>> {
    let mut scene = fly::scene(program, &args.flight(), global, fly::Screen::None)?;
    scene.log = true;
    scan.cleanse_for(&scene)?;
    let commands = args.replay.as_deref().map(fly::read_commands).transpose()?;
    let mut flight = fly::flight(&args.flight(), scan, scene)?;
    if let Some(commands) = commands {
        flight.commands.replay(commands);
    }
    let most = flight.setup().scene.play().map_or(MOST_S, |p| p.takes_s() + 1.0);
    let seconds = args.seconds.unwrap_or(most);
    progress.stage("flying", 0);
    let mut log: Vec<LogLine> = Vec::new();
    // A rest that is less than half a step is none.
    while ((seconds - flight.clock().seconds()) * f64::from(STEP_HZ)).round() >= 1.0 {
        progress.check()?;
        let left = seconds - flight.clock().seconds();
        let state = flight.fly(left.min(1.0))?;
        log.extend(flight.take_log());
        if state != State::Flying {
            tell(&flight, state);
            break;
        }
    }
    let every = f64::from(STEP_HZ) / fps;
    let count = (log.len() as f64 / every).floor() as usize;
    Ok((0..count)
        .map(|n| {
            let line = &log[((n as f64 * every).round() as usize).min(log.len() - 1)];
            let [position, forward, up] = [line.position, line.forward, line.up].map(DVec3::from_array);
            Take { seconds: n as f64 / fps, position, forward, up }
        })
        .collect())
}

/// Tells why a flight ended before its goal.
fn tell(flight: &FlightApp, state: State) {
    if state == State::Operator {
        let reason = flight.flight().reason;
        say(&format!("the flight ends at {:.1}: {reason}", flight.pose().position));
    }
}
