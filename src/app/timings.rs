//! Run times and memory of the parts of a preparation.

use std::time::Instant;

use colvis_scan::memory;

use crate::error::Result;

/// Wall-clock times of the parts of a preparation, s. They do not overlap and are in the order of execution.
#[derive(Clone, Debug, Default)]
pub struct Timings {
    parts: Vec<(&'static str, f64)>,
    peaks: Vec<(&'static str, u64)>,
}

impl Timings {
    /// Runs a part and keeps its time under `name` (which ends in `_s`). What the part has freed goes back to the system.
    ///
    /// # Errors
    /// Returns the error of the part.
    pub fn time<T>(&mut self, name: &'static str, part: impl FnOnce() -> Result<T>) -> Result<T> {
        let begun = Instant::now();
        let result = part();
        memory::release();
        self.add(name, begun.elapsed().as_secs_f64());
        result
    }

    /// Adds the time, s, of a part that ran elsewhere, under `name`.
    pub fn add(&mut self, name: &'static str, seconds: f64) {
        self.parts.push((name, seconds.max(0.0)));
        self.peaks.extend(memory::resident_bytes("VmHWM").map(|bytes| (name, bytes)));
    }

    /// Returns the parts with their times, s.
    pub fn parts(&self) -> &[(&'static str, f64)] {
        &self.parts
    }

    /// Returns the peak of the process' resident memory when each part was noted, bytes: at its end, or later for a part that ran elsewhere.
    /// Empty if the system does not report it.
    pub fn peaks(&self) -> &[(&'static str, u64)] {
        &self.peaks
    }
}
