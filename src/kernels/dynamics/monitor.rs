//! Detects a flight that makes no progress.
//!
//! It uses only the trail and recognises hanging in place, dithering, turning back and circling (paper, sections 3.1.1
//! and 3.2). [`super::trap`] classifies the place, [`super::rescue`] decides how to recover.

use std::collections::VecDeque;

use super::settings::{not_negative, positive};
use crate::error::Result;
use glam::DVec3;

/// Thresholds for a flight that makes no progress. The defaults detect each kind of stall within two seconds at cruise speed.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MonitorSettings {
    /// Time window for measuring progress, s. Dithering is searched for over twice this time.
    pub window_s: f64,
    /// Staying within a box of this diagonal for the whole window is no progress, mm.
    pub least_progress_mm: f64,
    /// A position counts as visited if it comes within this distance of the trail, mm.
    pub visited_mm: f64,
    /// Distance over visited ground that counts as turning back (against the trail) or circling (along it), mm.
    pub revisited_mm: f64,
}

impl Default for MonitorSettings {
    fn default() -> Self {
        Self { window_s: 1.5, least_progress_mm: 6.0, visited_mm: 6.0, revisited_mm: 20.0 }
    }
}

impl MonitorSettings {
    /// Checks the settings.
    ///
    /// # Errors
    /// Returns status 2 if a setting is out of range.
    pub fn check(&self) -> Result<()> {
        positive("watch.window_s", self.window_s)?;
        positive("watch.revisited_mm", self.revisited_mm)?;
        not_negative("watch.least_progress_mm", self.least_progress_mm)?;
        not_negative("watch.visited_mm", self.visited_mm)
    }
}

/// How a flight fails to make progress.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum StallKind {
    /// It hangs in place.
    Stuck,
    /// It moves but stays in the same place: two forces or two directions take turns.
    Dithering,
    /// It flies back over its own trail.
    TurnedBack,
    /// It flies over its own trail again in the same direction.
    Circling,
}

/// A detected stall and its position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StallAlarm {
    /// The kind of stall.
    pub stall: StallKind,
    /// Where it began, world mm; for a flight that turned back, where it turned.
    pub place: DVec3,
}

/// Distance flown between two points of the trail, mm.
const TRAIL_STEP_MM: f64 = 2.0;
/// Trail closer than this along the path is where the camera has just been, not "visited ground", mm.
const RECENT_MM: f64 = 30.0;
/// Positions kept per window: less than 2 mm apart at cruise speed.
const SAMPLES: f64 = 32.0;
/// A path longer than this many times the size of its bounding box is dithering. Once there and back is 2.
const DITHER: f64 = 2.5;
/// The durations, in windows, over which dithering is measured: a wide sway takes long, and a forgiven flight needs some time.
const DITHER_WINDOWS: [f64; 2] = [0.5, 2.0];
/// In a box larger than this the flight is circling, mm.
const DITHER_MM: f64 = 18.0;

/// A recent position.
#[derive(Clone, Copy, Debug)]
struct Sample {
    time: f64,
    at: DVec3,
    path_length: f64,
}

/// The camera's trail and the stall detection based on it.
#[derive(Clone, Debug, Default)]
pub struct Monitor {
    /// Points [`TRAIL_STEP_MM`] apart along the path, world mm.
    trail: Vec<DVec3>,
    /// Positions of the last window and of the additional time that dithering needs, oldest first.
    recent: VecDeque<Sample>,
    last: Option<DVec3>,
    time: f64,
    path_length: f64,
    against: f64,
    along: f64,
}

impl Monitor {
    /// Returns the distance flown since the last [`Monitor::restart`], mm.
    pub fn way_mm(&self) -> f64 {
        self.path_length
    }

    /// Returns the trail since the last [`Monitor::restart`], world mm.
    pub fn trail(&self) -> &[DVec3] {
        &self.trail
    }

    /// Iterates over the last `mm` of the trail, latest point first; world mm.
    pub fn last_mm(&self, mm: f64) -> impl Iterator<Item = DVec3> + '_ {
        self.trail.iter().rev().take((mm / TRAIL_STEP_MM).ceil() as usize).copied()
    }

    /// Starts over, for example after a turn or operator input: the path flown so far may be flown again.
    pub fn restart(&mut self) {
        *self = Self::default();
    }

    /// Clears the counters but keeps the trail.
    pub fn forgive(&mut self) {
        self.recent.clear();
        self.against = 0.0;
        self.along = 0.0;
    }

    /// Takes the camera's position (world mm) after a step of `dt` seconds and reports a stall once it is certain.
    ///
    /// A position that is not finite is ignored.
    pub fn follow(&mut self, at: DVec3, dt: f64, settings: &MonitorSettings) -> Option<StallAlarm> {
        if !at.is_finite() {
            return None;
        }
        let moved = self.last.map_or(DVec3::ZERO, |l| at - l);
        self.last = Some(at);
        self.time += dt;
        self.path_length += moved.length();
        if self.recent.back().is_none_or(|r| self.time - r.time >= settings.window_s / SAMPLES) {
            self.recent.push_back(Sample { time: self.time, at, path_length: self.path_length });
        }
        while self.recent.len() > 1 && self.time - self.recent[1].time >= DITHER_WINDOWS[1] * settings.window_s {
            self.recent.pop_front();
        }
        if self.trail.last().is_none_or(|l| l.distance(at) >= TRAIL_STEP_MM) {
            self.trail.push(at);
        }
        self.revisit(at, moved, settings).or_else(|| self.stay(at, settings))
    }

    /// Returns the stall of a flight that stays in one place.
    fn stay(&self, at: DVec3, settings: &MonitorSettings) -> Option<StallAlarm> {
        let (mut low, mut high) = (at, at);
        let mut is_stuck = false;
        for s in self.recent.iter().rev() {
            (low, high) = (low.min(s.at), high.max(s.at));
            let (extent, path_length, time) =
                ((high - low).length(), self.path_length - s.path_length, self.time - s.time);
            let is_long =
                time >= DITHER_WINDOWS[0] * settings.window_s && path_length > 3.0 * settings.least_progress_mm;
            if is_long && path_length > DITHER * extent && extent < DITHER_MM {
                return Some(StallAlarm { stall: StallKind::Dithering, place: at });
            }
            is_stuck |= time >= settings.window_s && extent < settings.least_progress_mm;
        }
        is_stuck.then_some(StallAlarm { stall: StallKind::Stuck, place: at })
    }

    /// Adds up the distance over visited ground, against and along the trail. New ground resets it.
    fn revisit(&mut self, at: DVec3, moved: DVec3, settings: &MonitorSettings) -> Option<StallAlarm> {
        let old = self.trail.len().saturating_sub((RECENT_MM / TRAIL_STEP_MM) as usize);
        let near = (1..old).map(|i| (i, self.trail[i].distance_squared(at))).min_by(|a, b| a.1.total_cmp(&b.1));
        let Some((i, _)) = near.filter(|n| n.1 < settings.visited_mm.powi(2)) else {
            let forget = moved.length();
            self.against = (self.against - forget).max(0.0);
            self.along = (self.along - forget).max(0.0);
            return None;
        };
        let sense = (self.trail[i] - self.trail[i - 1]).normalize_or_zero();
        let signed = moved.dot(sense);
        self.against += (-signed).max(0.0);
        self.along += signed.max(0.0);
        if self.against > settings.revisited_mm {
            // There and back have the same length, so it turned in the middle of the trail since it was here.
            return Some(StallAlarm {
                stall: StallKind::TurnedBack,
                place: self.trail[(i + self.trail.len() - 1) / 2],
            });
        }
        (self.along > settings.revisited_mm).then_some(StallAlarm { stall: StallKind::Circling, place: at })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    use crate::dynamics::STEP_S as DT;

    fn fly(path: impl Fn(f64) -> DVec3, seconds: f64) -> Option<(f64, StallAlarm)> {
        let mut m = Monitor::default();
        (0..(seconds / DT) as usize).find_map(|n| {
            let t = n as f64 * DT;
            m.follow(path(t), DT, &MonitorSettings::default()).map(|v| (t, v))
        })
    }

    #[test]
    fn steady_flight_is_no_trouble() {
        assert_eq!(fly(|t| DVec3::new(30.0 * t, 10.0 * t.sin(), 0.0), 60.0), None);
        // A helix with neighbouring turns farther apart than the width of a lumen.
        assert_eq!(fly(|t| DVec3::new(20.0 * t.cos(), 20.0 * t.sin(), 3.0 * t), 60.0), None);
        // Narrow coils, and a fast one.
        for radius in [8.0, 11.0] {
            let turn = |t: f64| DVec3::new((30.0 / radius * t).cos(), (30.0 / radius * t).sin(), 0.0) * radius;
            assert_eq!(fly(|t| turn(t) + DVec3::Z * 7.0 * t, 20.0), None);
        }
        assert_eq!(fly(|t| DVec3::new(120.0 * (t - 5.0).abs(), 40.0 * (t - 5.0).tanh(), 0.0), 10.0), None);
        // A slow one.
        assert_eq!(fly(|t| DVec3::X * 6.0 * t, 60.0), None);
        // A hairpin.
        assert_eq!(fly(|t| DVec3::new(30.0 * (t - 5.0).abs(), 14.0 * (t - 5.0).tanh(), 0.0), 20.0), None);
    }

    /// Each kind of stall, at 30 mm/s, within two seconds of its start.
    #[test]
    fn each_trouble_is_told_within_two_seconds() {
        let reported = |path: &dyn Fn(f64) -> DVec3, begins: f64, stall: StallKind, place: Option<DVec3>| {
            let (t, alarm) = fly(path, 20.0).unwrap();
            assert_eq!(alarm.stall, stall);
            assert!(t > begins && t - begins <= 2.0, "{stall:?} after {} s", t - begins);
            if let Some(p) = place {
                assert!(alarm.place.distance(p) < 6.0, "{stall:?} at {}, not {p}", alarm.place);
            }
        };
        let tip = DVec3::X * 90.0;
        reported(&|t| DVec3::X * 30.0 * t.min(3.0), 3.0, StallKind::Stuck, Some(tip));
        let sway =
            |t: f64, a: f64, w: f64| DVec3::X * if t < 3.0 { 30.0 * t } else { 90.0 + a * (w * (t - 3.0)).sin() };
        reported(&|t| sway(t, 2.0, 15.0), 3.0, StallKind::Dithering, Some(tip));
        // Between two directions 14 mm apart, at full speed: it counts as a trap from the second turn on.
        reported(&|t| sway(t, 7.0, 30.0 / 7.0), 3.0, StallKind::Dithering, None);
        // Slower, between two directions nearly as far apart: it first turns after 0.45 s.
        reported(
            &|t| sway(t, 6.5, std::f64::consts::TAU / 1.8) + DVec3::Y * (t - 3.0).max(0.0),
            3.45,
            StallKind::Dithering,
            None,
        );
        reported(&|t| DVec3::X * 30.0 * (3.0 - (t - 3.0).abs()), 3.0, StallKind::TurnedBack, Some(tip));
        let round = std::f64::consts::TAU * 20.0 / 30.0;
        reported(
            &|t| DVec3::new(20.0 * (1.5 * t).cos(), 20.0 * (1.5 * t).sin(), 0.0),
            round,
            StallKind::Circling,
            None,
        );
    }

    proptest! {
        /// No input makes it panic, and a path that moves on and never comes near its own trail is no stall.
        #[test]
        fn wild_places_are_survived(v in prop::collection::vec(prop::num::f64::ANY, 3..90)) {
            let mut m = Monitor::default();
            for p in v.chunks_exact(3) {
                let _ = m.follow(DVec3::new(p[0], p[1], p[2]), DT, &MonitorSettings::default());
            }
        }

        #[test]
        fn a_straight_flight_of_any_speed_is_none(speed in 4.5f64..200.0) {
            prop_assert_eq!(fly(|t| DVec3::Y * speed * t, 8.0), None);
        }
    }

    /// After an alarm that is forgiven, as much ground as before must be flown again until the next one.
    #[test]
    fn what_is_forgiven_counts_anew() {
        let settings = MonitorSettings::default();
        let circle = |t: f64| DVec3::new(20.0 * (1.5 * t).cos(), 20.0 * (1.5 * t).sin(), 0.0);
        let back = |t: f64| DVec3::X * 30.0 * (6.0 - (t - 6.0).abs());
        for path in [&circle as &dyn Fn(f64) -> DVec3, &back] {
            let (mut m, mut alarms) = (Monitor::default(), Vec::new());
            for n in 0..(10.5 / DT) as usize {
                if m.follow(path(n as f64 * DT), DT, &settings).is_some() {
                    alarms.push(m.way_mm());
                    m.forgive();
                }
            }
            assert!(alarms.len() > 1, "{alarms:?}");
            assert!(alarms.windows(2).all(|w| w[1] - w[0] > settings.revisited_mm - 1.0), "{alarms:?}");
            assert!(!m.trail().is_empty(), "the trail stays");
        }
    }
}
