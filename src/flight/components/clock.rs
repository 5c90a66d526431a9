//! Simulated time.

use std::time::Duration;

use bevy_ecs::prelude::*;

use crate::dynamics::STEP_HZ;

/// The clock with the fixed time step of the simulation.
///
/// A second is a whole number of steps, so time is counted and never summed up.
#[derive(Resource, Clone, Copy, Debug)]
pub struct Clock {
    /// Number of completed steps.
    pub tick: u64,
    /// Steps per simulated second.
    pub hz: u32,
}

impl Default for Clock {
    fn default() -> Self {
        Self { tick: 0, hz: STEP_HZ }
    }
}

impl Clock {
    /// Returns the length of a step, s.
    pub fn dt(&self) -> f64 {
        1.0 / f64::from(self.hz)
    }

    /// Returns the simulated time, s.
    pub fn seconds(&self) -> f64 {
        self.tick as f64 / f64::from(self.hz)
    }
}

/// Converts elapsed real time into whole steps and keeps the remainder (Fiedler, *Fix your timestep*, 2004).
#[derive(Clone, Copy, Debug, Default)]
pub struct Accumulator {
    rest: Duration,
}

impl Accumulator {
    /// Returns the number of whole steps of `1/hz` s in the kept remainder plus `elapsed`, at most `most`.
    ///
    /// If the limit is reached, the remainder is dropped, so a slow machine flies slower instead of falling ever further behind.
    pub fn take(&mut self, elapsed: Duration, hz: u32, most: u32) -> u32 {
        self.rest += elapsed;
        let step = Duration::from_nanos(1_000_000_000 / u64::from(hz.max(1)));
        let mut n = 0;
        while self.rest >= step && n < most {
            self.rest -= step;
            n += 1;
        }
        if self.rest >= step {
            self.rest = Duration::ZERO;
        }
        n
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_steps_and_the_rest_kept() {
        let mut a = Accumulator::default();
        let n: u32 = (0..100).map(|_| a.take(Duration::from_micros(12_345), 120, 100)).sum();
        assert_eq!(n, (1.2345 * 120.0) as u32);
        assert_eq!(a.take(Duration::from_secs(60), 120, 8), 8);
        assert_eq!(a.take(Duration::ZERO, 120, 8), 0, "no avalanche after a pause");
    }
}
