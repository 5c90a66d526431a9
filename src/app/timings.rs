//! How long the parts of a preparation took.

use std::time::Instant;

use crate::error::Result;

/// Wall clock of the parts of a preparation, s, disjoint, in the order they were done.
#[derive(Clone, Debug, Default)]
pub struct Timings(Vec<(&'static str, f64)>);

impl Timings {
    /// Does a part and keeps how long it took, under `name` (ends in `_s`).
    ///
    /// # Errors
    /// What the part fails with.
    pub fn time<T>(&mut self, name: &'static str, part: impl FnOnce() -> Result<T>) -> Result<T> {
        let begun = Instant::now();
        let result = part();
        self.add(name, begun.elapsed().as_secs_f64());
        result
    }

    /// Keeps how long a part took that was done elsewhere, under `name`.
    pub fn add(&mut self, name: &'static str, seconds: f64) {
        self.0.push((name, seconds.max(0.0)));
    }

    /// The parts with their seconds.
    pub fn parts(&self) -> &[(&'static str, f64)] {
        &self.0
    }
}
