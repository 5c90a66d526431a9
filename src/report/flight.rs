//! Poses at which methods are compared: along a real flight, and after sudden turns and jumps.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::{DQuat, DVec3};

use crate::app::{FlightRequest, Scan, Scene};
use crate::components::flight::State;
use crate::components::output::LogLine;
use crate::error::{Error, Result};
use crate::math::hash;
use crate::progress::Progress;
use crate::render::View;
use crate::space::PreparedVolume;

/// Maximum duration of a flight, simulated seconds.
const SECONDS: f64 = 600.0;
/// Frames per simulated second.
const FPS: f64 = 30.0;

/// Position and orientation of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Position, world mm.
    pub position: DVec3,
    /// Forward direction, world.
    pub forward: DVec3,
    /// Up direction, world.
    pub up: DVec3,
}

impl Pose {
    fn of(line: &LogLine) -> Self {
        let [position, forward, up] = [line.position, line.forward, line.up].map(DVec3::from_array);
        Self { position, forward, up }
    }

    /// Returns a square view from this pose.
    ///
    /// # Errors
    /// Never returns an error for a pose from a flight's log.
    pub fn view(&self, fov_degrees: f64, pixels: usize) -> Result<View> {
        View::new(self.position, self.forward, self.up, fov_degrees, pixels, pixels)
    }
}

/// A measured pose.
#[derive(Clone, Debug, PartialEq)]
pub struct Stop {
    /// True if the camera reaches it by a jump or a sudden turn.
    pub jump: bool,
    /// The measured frame.
    pub pose: Pose,
    /// The preceding frames, oldest first: those of the flight, or, after a jump, the frame of the previous pose.
    pub lead: Vec<Pose>,
}

/// A completed flight.
#[derive(Clone, Debug)]
pub struct Flown {
    /// Its log, one line per step.
    pub log: Vec<LogLine>,
    /// Steps per second.
    pub hz: f64,
    /// Its final state.
    pub state: State,
}

/// Flies through the largest segment of the colon in `volume`, like `colvis fly --headless`.
///
/// # Errors
/// Returns status 4 if there is no colon to fly, or if interrupted.
pub fn fly(volume: &PreparedVolume, progress: &Progress) -> Result<Flown> {
    let scene = Scene { log: true, ..Scene::default() };
    let mut scan = Scan::prepared(volume.clone(), Arc::new(progress.clone()));
    let mut flight = scan.flight(scene, &FlightRequest::default())?;
    let hz = f64::from(flight.clock().hz);
    progress.stage("flying", (flight.setup().plan.length_mm / flight.setup().scene.cruise_mm_s() * hz * 1.3) as u64);
    let mut log = Vec::new();
    while flight.flight().state == State::Flying && flight.clock().seconds() < SECONDS {
        flight.step()?;
        log.append(&mut flight.take_log());
        progress.advance(1)?;
    }
    if log.is_empty() {
        return Err(Error::incomplete("flight", "has no step", "give a scan with a colon"));
    }
    Ok(Flown { log, hz, state: flight.flight().state })
}

impl Flown {
    /// Returns `along` poses spread evenly over the flight, each after `lead` frames of it, with `jumps` jumps to other positions
    /// among them. Their order and turns are random but reproducible.
    pub fn stops(&self, along: usize, jumps: usize, lead: usize) -> Vec<Stop> {
        let last = self.log.len() - 1;
        let at = |n: usize| Pose::of(&self.log[n.min(last)]);
        let frame = (self.hz / FPS).round().max(1.0) as usize;
        let mut stops: Vec<Stop> = (0..along)
            .map(|n| {
                let here = (last as f64 * (n as f64 + 0.5) / along as f64).round() as usize;
                let lead = (1..=lead).rev().map(|k| at(here.saturating_sub(k * frame))).collect();
                Stop { jump: false, pose: at(here), lead }
            })
            .collect();
        for n in 0..jumps {
            let u = |k: u64| hash::uniform(0x7EA0 + n as u64, k);
            let pose = at((u(0) * last as f64) as usize);
            let pose = turned(pose, n, u(1));
            let place = ((n + 1) * stops.len() / (jumps + 1) + n).min(stops.len());
            let before = place.checked_sub(1).map(|n| stops[n].pose);
            stops.insert(place, Stop { jump: true, pose, lead: before.into_iter().collect() });
        }
        stops
    }

    /// Returns `frames` poses of the flight, sixty per second from a quarter of it onwards, and whether the camera turned
    /// suddenly to each. It turns once every `every` frames, and looks there for half of them.
    pub fn moving(&self, frames: usize, every: usize) -> Vec<(Pose, bool)> {
        let last = self.log.len() - 1;
        let step = (self.hz / 60.0).round().max(1.0) as usize;
        let every = every.max(2);
        (0..frames)
            .map(|n| {
                // Back and forth if the flight is shorter.
                let way = (last / 4 + n * step) % (2 * last).max(1);
                let pose = Pose::of(&self.log[if way > last { 2 * last - way } else { way }]);
                let (turn, within) = (n / every, n % every);
                if within < every / 2 {
                    (pose, n > 0 && within == 0)
                } else {
                    (turned(pose, turn, hash::uniform(0x7EA1, turn as u64)), within == every / 2)
                }
            })
            .collect()
    }
}

/// Turns a pose right round, aside, upwards or about the view direction, depending on `n`, and by up to 20° more.
fn turned(pose: Pose, n: usize, more: f64) -> Pose {
    let right = pose.forward.cross(pose.up).normalize_or(DVec3::X);
    let (axis, angle) = match n % 4 {
        0 => (pose.up, PI),
        1 => (pose.up, 0.5 * PI),
        2 => (right, 0.5 * PI),
        _ => (pose.forward, 0.75 * PI),
    };
    let turn = DQuat::from_axis_angle(axis.normalize_or(DVec3::Z), angle + (more - 0.5) * 0.7);
    Pose { forward: turn * pose.forward, up: turn * pose.up, ..pose }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flown(n: usize) -> Flown {
        let line = |k: usize| LogLine {
            t: k as f64 / f64::from(crate::dynamics::STEP_HZ),
            position: [k as f64 * 0.25, 0.0, 0.0],
            forward: [1.0, 0.0, 0.0],
            up: [0.0, 0.0, 1.0],
            velocity: [30.0, 0.0, 0.0],
            clearance_mm: 5.0,
            state: State::Flying,
            guide: "tentacles".to_owned(),
        };
        Flown { log: (0..n).map(line).collect(), hz: f64::from(crate::dynamics::STEP_HZ), state: State::Arrived }
    }

    #[test]
    fn stops_are_spread_and_follow_frames_of_the_flight() {
        let stops = flown(1201).stops(6, 2, 3);
        assert_eq!(stops.len(), 8);
        let (jumps, along): (Vec<_>, Vec<_>) = stops.iter().partition(|s| s.jump);
        assert_eq!((jumps.len(), along.len()), (2, 6));
        for (n, s) in along.iter().enumerate() {
            assert!((s.pose.position.x - (25.0 + 50.0 * n as f64)).abs() < 1e-9);
            let gaps = s.lead.iter().chain([&s.pose]).map(|p| p.position.x).collect::<Vec<_>>();
            assert!(gaps.len() == 4 && gaps.windows(2).all(|w| (w[1] - w[0] - 1.0).abs() < 1e-9), "1 mm a frame");
        }
        assert!(!stops[0].jump && !stops[7].jump, "jumps lie within the flight");
        for (n, s) in stops.iter().enumerate().filter(|(_, s)| s.jump) {
            assert!(s.lead == [stops[n - 1].pose] && s.pose.forward.x < 0.8);
            assert!((s.pose.forward.length() - 1.0).abs() < 1e-9 && s.pose.forward.dot(s.pose.up).abs() < 1e-9);
        }
        assert_eq!(stops, flown(1201).stops(6, 2, 3));
        assert_eq!(flown(1).stops(3, 1, 2).len(), 4, "a flight of one step still has poses");
    }

    #[test]
    fn a_moving_camera_turns_suddenly_and_back() {
        let poses = flown(1201).moving(100, 20);
        assert_eq!(poses.iter().filter(|p| p.1).count(), 9);
        for w in poses.windows(2) {
            let turned = w[0].0.forward.angle_between(w[1].0.forward) > 0.5;
            // After a roll about the view direction, the camera looks in the same direction.
            let rolled = w[0].0.up.angle_between(w[1].0.up) > 0.5;
            assert_eq!(turned || rolled, w[1].1);
            assert!((w[1].0.position - w[0].0.position).length() < 0.6);
        }
        assert_eq!(flown(1).moving(5, 2).len(), 5);
        assert_eq!(flown(40).moving(200, 20).len(), 200, "a short flight is flown to and fro");
    }
}
