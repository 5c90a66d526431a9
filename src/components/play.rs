//! A flight's log that is flown again.

use std::sync::Arc;

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::components::flight::State;
use crate::components::output::LogLine;
use crate::dynamics::Attitude;
use crate::error::{Error, Result};

/// Which way a log is played.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// As it was flown.
    Forwards,
    /// From its end.
    Backwards,
}

/// A log as it is played: at any speed, forwards or backwards.
#[derive(Component, Clone, Debug)]
pub struct Playback {
    /// The log's lines, at least one, in the order of time.
    lines: Arc<[LogLine]>,
    /// Times the flight's own speed.
    rate: f64,
    direction: Direction,
    /// Time played, in the log's own seconds.
    played: f64,
}

/// A moment of a log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Played {
    /// World, mm.
    pub position: DVec3,
    /// View.
    pub attitude: Attitude,
    /// World mm/s, as it was flown then.
    pub velocity: DVec3,
    /// To the nearest wall, mm, as it was logged.
    pub clearance_mm: f64,
}

impl Playback {
    /// A log to be played at `rate` times its speed.
    ///
    /// # Errors
    /// Status 2 for a rate that is not a positive number; status 3 for a log without lines, with places that are no
    /// numbers, or that goes back in time.
    pub fn new(lines: Vec<LogLine>, rate: f64, direction: Direction) -> Result<Self> {
        if !(rate.is_finite() && rate > 0.0) {
            return Err(Error::usage("--rate", format!("{rate} is not above 0"), "give a positive number"));
        }
        let bad = |why: String| Error::input("log", why, "give a log that --log wrote");
        if lines.is_empty() {
            return Err(bad("has no steps".to_owned()));
        }
        for (n, l) in lines.iter().enumerate() {
            let mut numbers = l.position.iter().chain(&l.forward).chain(&l.up).chain(&l.velocity);
            if !(l.t.is_finite() && l.clearance_mm.is_finite() && numbers.all(|x| x.is_finite())) {
                return Err(bad(format!("line {}: contains a value that is not a number", n + 1)));
            }
            if n > 0 && l.t <= lines[n - 1].t {
                return Err(bad(format!("line {}: goes back in time", n + 1)));
            }
        }
        Ok(Self { lines: lines.into(), rate, direction, played: 0.0 })
    }

    fn is_backwards(&self) -> bool {
        self.direction == Direction::Backwards
    }

    /// The log's lines.
    pub fn lines(&self) -> &[LogLine] {
        &self.lines
    }

    /// The log's last state, if the log is played to its end.
    pub fn last_state(&self) -> State {
        if self.is_backwards() { State::Ended } else { self.lines[self.lines.len() - 1].state }
    }

    /// From the first to the last step, s of the flight.
    pub fn seconds(&self) -> f64 {
        self.lines[self.lines.len() - 1].t - self.lines[0].t
    }

    /// How long it takes to play, s.
    pub fn takes_s(&self) -> f64 {
        self.seconds() / self.rate
    }

    /// Length of its path, mm.
    pub fn length_mm(&self) -> f64 {
        let place = |l: &LogLine| DVec3::from_array(l.position);
        self.lines.windows(2).map(|w| place(&w[0]).distance(place(&w[1]))).sum()
    }

    /// The first and last place, in the order they are played; world mm.
    pub fn ends(&self) -> [DVec3; 2] {
        let ends = [&self.lines[0], &self.lines[self.lines.len() - 1]].map(|l| DVec3::from_array(l.position));
        if self.is_backwards() { [ends[1], ends[0]] } else { ends }
    }

    /// Goes on by `dt` seconds at `speed` times the rate; whether that was the end.
    pub fn go(&mut self, dt: f64, speed: f64) -> bool {
        self.played = (self.played + dt * self.rate * speed).min(self.seconds());
        self.played >= self.seconds()
    }

    /// Goes to where `share` (0 to 1) of the time is played.
    pub fn seek(&mut self, share: f64) {
        self.played = self.seconds() * share.clamp(0.0, 1.0);
    }

    /// Share of the time that is played, 0 to 1.
    pub fn share(&self) -> f64 {
        if self.seconds() > 0.0 { self.played / self.seconds() } else { 1.0 }
    }

    /// The moment that is played now; between two steps the straight line between them, on which every step's own place
    /// lies.
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
