//! Paths that are made for a dataset: the camera of a hand, and what an examination does.
//!
//! A path follows the centerline at a speed. Beside it, and in its gaze, it sways by sums of sines whose frequencies and phases are drawn
//! from a seed: smooth, bounded, and the same each time.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3};

use crate::fields::frames::Frame;
use crate::math::hash::Stream;

/// What a path does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PathKind {
    /// To the cecum with an unsteady hand.
    Jitter,
    /// To the cecum, looking at the wall that is passed, all around in turn.
    Wall,
    /// From the cecum, looking back to it: a withdrawal.
    Retreat,
    /// To the cecum and back, going over parts again on both ways.
    Again,
}

impl PathKind {
    /// Every kind.
    pub const ALL: [Self; 4] = [Self::Jitter, Self::Wall, Self::Retreat, Self::Again];

    /// Returns its name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Jitter => "jitter",
            Self::Wall => "wall",
            Self::Retreat => "retreat",
            Self::Again => "again",
        }
    }

    /// Returns the kind of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|k| k.name() == name)
    }
}

/// The line that a path follows: points 2 mm apart with frames that do not turn about it, and how far the wall is from each, mm.
#[derive(Clone, Debug)]
pub struct Course {
    /// Frames of the points; their tangents are towards the cecum.
    pub frames: Vec<Frame>,
    /// Distance of each point from the wall, mm.
    pub room_mm: Vec<f64>,
}

/// Distance between the points of a course, mm.
const STEP_MM: f64 = crate::fields::frames::STEP_MM;
/// Speed along the line, mm/s.
const SPEED: f64 = 20.0;
/// A path keeps so far from both ends of the line, mm.
const ENDS_MM: f64 = 8.0;
/// Share of the room that a path sways by at most.
const SWAY: f64 = 0.4;
/// The gaze sways by at most so much about each axis, radians.
const UNSTEADY: f64 = 0.22;
/// Angle between the line and the gaze at the wall, radians, and how far the camera goes while it looks around once, mm.
const ASIDE: f64 = 1.0;
const ROUND_MM: f64 = 60.0;
/// Going over a part again: forward, then back, mm.
const FORTH_AND_BACK_MM: [f64; 2] = [80.0, 35.0];

/// A pose of a path: position (world, mm), forward and up.
pub type PathPose = [DVec3; 3];

impl Course {
    /// Returns the poses of a path at `fps` frames a second; none if the line is too short.
    pub fn path(&self, kind: PathKind, fps: f64, seed: u64) -> Vec<PathPose> {
        let last = (self.frames.len().saturating_sub(1)) as f64 * STEP_MM - ENDS_MM;
        if last <= ENDS_MM || !(fps.is_finite() && fps > 0.0) {
            return Vec::new();
        }
        let draw = |n| Sway::new(seed, n);
        let (across, up, [yaw, pitch, roll]) = (draw(0), draw(1), [draw(2), draw(3), draw(4)]);
        let each = SPEED / fps;
        let pose = |n: usize, (mm, is_back): (f64, bool)| {
            let seconds = n as f64 / fps;
            let (frame, room) = self.at(mm);
            let binormal = frame.tangent.cross(frame.normal);
            let side = frame.normal * across.at(seconds) + binormal * up.at(seconds);
            let position = frame.at + side * (SWAY * room * std::f64::consts::FRAC_1_SQRT_2);
            let ahead = if is_back { -frame.tangent } else { frame.tangent };
            let gaze = match kind {
                PathKind::Wall => DQuat::from_axis_angle(frame.direction(TAU * mm / ROUND_MM), ASIDE) * ahead,
                _ => ahead,
            };
            let unsteady = |axis: DVec3, by: &Sway| DQuat::from_axis_angle(axis, UNSTEADY * by.at(seconds));
            let turn = unsteady(frame.normal, &yaw) * unsteady(binormal, &pitch);
            let top = unsteady(ahead, &roll) * binormal;
            [position, turn * gaze, turn * top]
        };
        self.ways(kind, last, each).into_iter().enumerate().map(|(n, at)| pose(n, at)).collect()
    }

    /// Returns the distance along the line at each frame, mm, and whether the gaze is towards the rectum.
    fn ways(&self, kind: PathKind, last: f64, each: f64) -> Vec<(f64, bool)> {
        let count = ((last - ENDS_MM) / each).floor() as usize + 1;
        let forth = || (0..count).map(move |n| ENDS_MM + n as f64 * each);
        match kind {
            PathKind::Jitter | PathKind::Wall => forth().map(|mm| (mm, false)).collect(),
            PathKind::Retreat => forth().rev().map(|mm| (mm, false)).collect(),
            PathKind::Again => {
                let [forward, back] = FORTH_AND_BACK_MM;
                let (mut out, mut mm, mut turned, mut is_back) = (Vec::new(), ENDS_MM, ENDS_MM, false);
                while mm < last {
                    out.push(mm);
                    if is_back {
                        mm -= each;
                        if mm <= turned - back || mm <= ENDS_MM {
                            (is_back, turned) = (false, mm.max(ENDS_MM));
                            mm = turned;
                        }
                    } else {
                        mm += each;
                        if mm >= turned + forward {
                            (is_back, turned) = (true, mm);
                        }
                    }
                }
                // In and out; out it looks to the rectum.
                let way_out: Vec<f64> = out.iter().rev().copied().collect();
                out.into_iter().map(|mm| (mm, false)).chain(way_out.into_iter().map(|mm| (mm, true))).collect()
            }
        }
    }

    /// Returns the frame at a distance along the line, mm, and the room there.
    fn at(&self, mm: f64) -> (Frame, f64) {
        let at = (mm / STEP_MM).clamp(0.0, (self.frames.len() - 1) as f64);
        let (low, high, share) = (at.floor() as usize, at.ceil() as usize, at - at.floor());
        let room = self.room_mm[low].min(self.room_mm[high]);
        (self.frames[low].to(&self.frames[high], share), room)
    }
}

/// A number from −1 to 1 that changes smoothly with time.
struct Sway([[f64; 2]; 4]);

impl Sway {
    fn new(seed: u64, n: u64) -> Self {
        let mut draw = Stream::new(seed, n);
        // From slow drifts to the tremor of a hand, Hz.
        Self([0.05, 0.13, 0.31, 0.9].map(|hz| [hz * draw.within(0.7, 1.3), draw.within(0.0, TAU)]))
    }

    fn at(&self, seconds: f64) -> f64 {
        let weights = [0.45, 0.3, 0.18, 0.07];
        self.0.iter().zip(weights).map(|([hz, phase], w)| w * (TAU * hz * seconds + phase).sin()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn course(count: usize) -> Course {
        let point = |n: usize| {
            let angle = n as f64 * STEP_MM / 60.0;
            DVec3::new(60.0 * angle.cos(), 60.0 * angle.sin(), 0.2 * n as f64)
        };
        let points: Vec<DVec3> = (0..count).map(point).collect();
        Course { frames: crate::fields::frames::frames(&points), room_mm: vec![12.0; count] }
    }

    #[test]
    fn paths_are_smooth_and_keep_to_their_room() {
        assert!(course(3).path(PathKind::Jitter, 30.0, 1).is_empty());
        let course = course(400);
        for kind in PathKind::ALL {
            assert_eq!(PathKind::named(kind.name()), Some(kind));
            let path = course.path(kind, 30.0, 3);
            assert_eq!(path, course.path(kind, 30.0, 3));
            assert_ne!(path, course.path(kind, 30.0, 4), "{kind:?}");
            let length: f64 = path.windows(2).map(|w| w[0][0].distance(w[1][0])).sum();
            assert!(length > if kind == PathKind::Again { 1500.0 } else { 700.0 }, "{kind:?}: {length}");
            for pair in path.windows(2) {
                // At the cecum the gaze of the one that goes back turns round between two frames.
                let moved = pair[0][0].distance(pair[1][0]);
                assert!(moved < 1.6, "{kind:?}: {moved} mm between frames");
            }
            for [position, forward, up] in &path {
                let away = course.frames.iter().map(|f| f.at.distance(*position)).fold(f64::INFINITY, f64::min);
                assert!(away < 0.5 * 12.0, "{kind:?}: {away}");
                assert!((forward.length() - 1.0).abs() < 1e-9 && forward.cross(*up).length() > 0.3, "{kind:?}");
            }
        }
        let ahead = |kind| {
            let path = course.path(kind, 30.0, 3);
            let along = path[200][0] - path[199][0];
            along.normalize().dot(path[200][1])
        };
        assert!(ahead(PathKind::Jitter) > 0.7 && ahead(PathKind::Retreat) < -0.7);
        assert!(course.path(PathKind::Jitter, f64::NAN, 1).is_empty());
    }
}
