//! Run times of the parts of a preparation.

use std::time::Instant;

use crate::error::Result;

/// Wall-clock times of the parts of a preparation, s. They do not overlap and are in the order of execution.
#[derive(Clone, Debug, Default)]
pub struct Timings(Vec<(&'static str, f64)>);

impl Timings {
    /// Runs a part and keeps its time under `name` (which ends in `_s`).
    ///
    /// # Errors
    /// Returns the error of the part.
    pub fn time<T>(&mut self, name: &'static str, part: impl FnOnce() -> Result<T>) -> Result<T> {
        let begun = Instant::now();
        let result = part();
        self.add(name, begun.elapsed().as_secs_f64());
        result
    }

    /// Adds the time, s, of a part that ran elsewhere, under `name`.
    pub fn add(&mut self, name: &'static str, seconds: f64) {
        self.0.push((name, seconds.max(0.0)));
    }

    /// Returns the parts with their times, s.
    pub fn parts(&self) -> &[(&'static str, f64)] {
        &self.0
    }
}
