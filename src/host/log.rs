//! Writes the steps of a flight to a log file.

use std::io::Write;
use std::path::{Path, PathBuf};

use crate::components::flight::State;
use crate::components::output::LogLine;
use crate::error::Result;
use crate::output::{AtomicFile, cannot};

/// A log that is being written. The file appears once it is finished, and not at all if a line cannot be written.
pub(crate) struct Log {
    path: PathBuf,
    /// `None` after a line could not be written.
    file: Option<AtomicFile>,
    /// The newest line. It is held back until the next one arrives, because the last line carries the flight's final state.
    last: Option<LogLine>,
}

impl Log {
    /// Starts a log.
    ///
    /// # Errors
    /// Returns status 5 if it cannot be written.
    pub(crate) fn create(path: &Path) -> Result<Self> {
        Ok(Self { path: path.to_owned(), file: Some(AtomicFile::create(path)?), last: None })
    }

    /// Adds steps.
    ///
    /// # Errors
    /// Returns status 5 if they cannot be written.
    pub(crate) fn add(&mut self, lines: Vec<LogLine>) -> Result<()> {
        for line in lines {
            if let Some(before) = self.last.replace(line) {
                self.write(&before)?;
            }
        }
        Ok(())
    }

    /// Ends the log with the flight's final state.
    ///
    /// # Errors
    /// Returns status 5 if it cannot be written.
    pub(crate) fn finish(mut self, state: State) -> Result<()> {
        if let Some(mut last) = self.last.take() {
            last.state = state;
            self.write(&last)?;
        }
        self.file.map_or(Ok(()), AtomicFile::finish)
    }

    fn write(&mut self, line: &LogLine) -> Result<()> {
        let Some(file) = &mut self.file else { return Ok(()) };
        let written = serde_json::to_writer(&mut *file, line).map_err(std::io::Error::from);
        written.and_then(|()| file.write_all(b"\n")).map_err(|e| {
            self.file = None;
            cannot(&self.path, e)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(t: f64) -> LogLine {
        LogLine {
            t,
            position: [0.0; 3],
            forward: [0.0, 1.0, 0.0],
            up: [0.0, 0.0, 1.0],
            velocity: [0.0; 3],
            clearance_mm: 5.0,
            state: State::Flying,
            guide: "manual".to_owned(),
        }
    }

    #[test]
    fn the_last_line_has_the_final_state() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("f.jsonl");
        let mut log = Log::create(&path).unwrap();
        log.add(vec![line(0.0), line(1.0)]).unwrap();
        log.add(Vec::new()).unwrap();
        log.add(vec![line(2.0)]).unwrap();
        assert!(!path.exists(), "not before it is whole");
        log.finish(State::Operator).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let lines: Vec<LogLine> = text.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
        assert_eq!(lines.iter().map(|l| l.t).collect::<Vec<_>>(), [0.0, 1.0, 2.0]);
        assert_eq!(lines.iter().map(|l| l.state).collect::<Vec<_>>(), [State::Flying, State::Flying, State::Operator]);
    }
}
