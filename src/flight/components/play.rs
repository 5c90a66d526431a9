//! Replay of a flight's log.

use std::sync::Arc;

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::components::flight::State;
use crate::components::output::LogLine;
use crate::dynamics::Attitude;
use crate::error::{Error, Result};

/// The direction of playback.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// As flown.
    Forwards,
    /// From the end.
    Backwards,
}

/// A log being replayed: at any speed, forwards or backwards.
#[derive(Component, Clone, Debug)]
pub struct Playback {
    /// Lines of the log, at least one, in chronological order.
    lines: Arc<[LogLine]>,
    /// Playback speed as a multiple of the original.
    rate: f64,
    direction: Direction,
    /// Time played, in seconds of the log.
    played: f64,
}

/// An instant of a log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Played {
    /// Position, world mm.
    pub position: DVec3,
    /// View frame.
    pub attitude: Attitude,
    /// Velocity, world mm/s, scaled to the playback rate and direction.
    pub velocity: DVec3,
    /// Logged distance to the nearest wall, mm.
    pub clearance_mm: f64,
}

impl Playback {
    /// Creates a playback of a log at `rate` times its speed.
    ///
    /// # Errors
    /// Returns status 2 if the rate is not a positive number, and status 3 if the log has no lines, holds values that are
    /// not finite, or goes back in time.
    pub fn new(lines: Vec<LogLine>, rate: f64, direction: Direction) -> Result<Self> {
        if !(rate.is_finite() && rate > 0.0) {
            return Err(Error::usage("--rate", format!("{rate} is not above 0"), "give a positive number"));
        }
        let bad = |why: String| Error::input("log", why, "give a log written by --log");
        if lines.is_empty() {
            return Err(bad("has no steps".to_owned()));
        }
        for (n, l) in lines.iter().enumerate() {
            let mut numbers = l.position.iter().chain(&l.forward).chain(&l.up).chain(&l.velocity);
            if !(l.t.is_finite() && l.clearance_mm.is_finite() && numbers.all(|x| x.is_finite())) {
                return Err(bad(format!("line {}: contains a value that is not a number", n + 1)));
            }
            if n > 0 && l.t <= lines[n - 1].t {
                return Err(bad(format!("line {}: is earlier than the line before", n + 1)));
            }
        }
        Ok(Self { lines: lines.into(), rate, direction, played: 0.0 })
    }

    fn is_backwards(&self) -> bool {
        self.direction == Direction::Backwards
    }

    /// Returns the lines of the log.
    pub fn lines(&self) -> &[LogLine] {
        &self.lines
    }

    /// Returns the last state of the log, if it is played to its end.
    pub fn last_state(&self) -> State {
        if self.is_backwards() { State::Ended } else { self.lines[self.lines.len() - 1].state }
    }

    /// Returns the time from the first to the last step, s of the flight.
    pub fn seconds(&self) -> f64 {
        self.lines[self.lines.len() - 1].t - self.lines[0].t
    }

    /// Returns the time needed to play the log, s.
    pub fn takes_s(&self) -> f64 {
        self.seconds() / self.rate
    }

    /// Returns the length of the path, mm.
    pub fn length_mm(&self) -> f64 {
        let place = |l: &LogLine| DVec3::from_array(l.position);
        self.lines.windows(2).map(|w| place(&w[0]).distance(place(&w[1]))).sum()
    }

    /// Returns the first and last positions in playback order; world mm.
    pub fn ends(&self) -> [DVec3; 2] {
        let ends = [&self.lines[0], &self.lines[self.lines.len() - 1]].map(|l| DVec3::from_array(l.position));
        if self.is_backwards() { [ends[1], ends[0]] } else { ends }
    }

    /// Advances by `dt` seconds at `speed` times the rate. Returns true at the end of the log.
    pub fn go(&mut self, dt: f64, speed: f64) -> bool {
        self.played = (self.played + dt * self.rate * speed).min(self.seconds());
        self.played >= self.seconds()
    }

    /// Jumps to a `share` (0 to 1) of the time.
    pub fn seek(&mut self, share: f64) {
        self.played = self.seconds() * share.clamp(0.0, 1.0);
    }

    /// Returns the share of the time already played, 0 to 1.
    pub fn share(&self) -> f64 {
        if self.seconds() > 0.0 { self.played / self.seconds() } else { 1.0 }
    }

    /// Returns the instant being played. Positions between two steps are on the straight line that connects them.
    pub fn now(&self) -> Played {
        let first = self.lines[0].t;
        let t = if self.is_backwards() { first + self.seconds() - self.played } else { first + self.played };
        let n = self.lines.partition_point(|l| l.t <= t).clamp(1, (self.lines.len() - 1).max(1)) - 1;
        let (a, b) = (&self.lines[n], &self.lines[(n + 1).min(self.lines.len() - 1)]);
        let u = if b.t > a.t { ((t - a.t) / (b.t - a.t)).clamp(0.0, 1.0) } else { 0.0 };
        let mix = |a: [f64; 3], b: [f64; 3]| DVec3::from_array(a).lerp(DVec3::from_array(b), u);
        let sense = if self.is_backwards() { -self.rate } else { self.rate };
        Played {
            position: mix(a.position, b.position),
            attitude: Attitude::new(mix(a.forward, b.forward), mix(a.up, b.up)),
            velocity: mix(a.velocity, b.velocity) * sense,
            clearance_mm: a.clearance_mm + (b.clearance_mm - a.clearance_mm) * u,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn log() -> Vec<LogLine> {
        (1..=240)
            .map(|n| {
                let t = f64::from(n) / 120.0;
                LogLine {
                    t,
                    position: [10.0 * (3.0 * t).cos(), 10.0 * (3.0 * t).sin(), t],
                    forward: [0.0, 1.0, 0.0],
                    up: [0.0, 0.0, 1.0],
                    velocity: [1.0, 0.0, 0.0],
                    clearance_mm: 5.0,
                    state: if n == 240 { State::Arrived } else { State::Flying },
                    guide: "tentacles".to_owned(),
                }
            })
            .collect()
    }

    #[test]
    fn every_rate_follows_the_same_path_and_ends_at_its_end() {
        let lines = log();
        let path: Vec<DVec3> = lines.iter().map(|l| DVec3::from_array(l.position)).collect();
        use Direction::{Backwards, Forwards};
        for (rate, direction) in
            [(0.5, Forwards), (4.0, Forwards), (1.0, Backwards), (1e-3, Forwards), (1e6, Backwards)]
        {
            let mut p = Playback::new(lines.clone(), rate, direction).unwrap();
            let mut steps = 0;
            while !p.go(1.0 / 120.0, 1.0) && steps < 5000 {
                let at = p.now().position;
                let off = path.windows(2).map(|w| {
                    let along = w[1] - w[0];
                    let t = ((at - w[0]).dot(along) / along.length_squared()).clamp(0.0, 1.0);
                    (w[0] + along * t).distance(at)
                });
                assert!(off.fold(f64::INFINITY, f64::min) < 1e-9);
                steps += 1;
            }
            if rate >= 0.5 {
                assert_eq!(p.now().position, p.ends()[1]);
                assert!((f64::from(steps) - 239.0 / rate).abs() <= 1.0, "{steps} steps at {rate}");
            }
        }
    }

    #[test]
    fn what_is_no_log_or_no_rate_is_refused() {
        for rate in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(Playback::new(log(), rate, Direction::Forwards).is_err(), "{rate}");
        }
        assert!(Playback::new(Vec::new(), 1.0, Direction::Forwards).is_err());
        let mut back = log();
        back[7].t = 0.0;
        assert!(Playback::new(back, 1.0, Direction::Forwards).is_err());
        let mut lost = log();
        lost[3].position[1] = f64::NAN;
        assert!(Playback::new(lost, 1.0, Direction::Forwards).is_err());
        let one = Playback::new(log()[..1].to_vec(), 1.0, Direction::Forwards).unwrap();
        assert!(one.now().position.is_finite() && one.share() == 1.0);
    }
}
