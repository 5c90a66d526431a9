//! The files that a flight is repeated from: logs, and what the operator did.

use std::io::BufRead;
use std::path::Path;

use serde::de::DeserializeOwned;

use crate::components::input::Act;
use crate::components::output::LogLine;
use crate::components::play::{Direction, Playback};
use crate::error::{Error, Kind, Result};
use crate::output;

/// Reads a flight's log to be played: one [`LogLine`] a line.
pub fn read_log(path: &Path, rate: f64, direction: Direction) -> Result<Playback> {
    let mend = "give a log that --log wrote";
    let bad = |e: Error| if e.kind == Kind::Usage { e } else { Error::file(path, e.why, mend) };
    Playback::new(read_lines::<LogLine>(path, mend)?, rate, direction).map_err(bad)
}

/// Reads a file with a value on each line, as JSON; empty lines are none.
fn read_lines<T: DeserializeOwned>(path: &Path, mend: &str) -> Result<Vec<T>> {
    let unread = |e: std::io::Error| Error::file(path, format!("cannot be read ({})", output::plain(&e)), mend);
    let file = std::fs::File::open(path).map_err(unread)?;
    let mut values = Vec::new();
    for (n, line) in std::io::BufReader::new(file).lines().enumerate() {
        let line = line.map_err(unread)?;
        if !line.trim().is_empty() {
            let value = serde_json::from_str(&line);
            values.push(value.map_err(|e| Error::file(path, format!("line {}: {e}", n + 1), mend))?);
        }
    }
    Ok(values)
}

/// Reads an operator's recorded input: one [`Act`] a line.
pub fn read_acts(path: &Path) -> Result<Vec<Act>> {
    let mend = "give a file that --record-input wrote";
    let acts: Vec<Act> = read_lines(path, mend)?;
    match acts.windows(2).position(|w| w[0].tick > w[1].tick) {
        Some(n) => Err(Error::file(path, format!("line {}: goes back in time", n + 2), mend)),
        None => Ok(acts),
    }
}

/// Writes an operator's input, one [`Act`] a line.
///
/// # Errors
/// Status 5 when it cannot be written.
pub fn write_acts(path: &Path, acts: &[Act]) -> Result<()> {
    output::write_whole(path, |w| {
        for act in acts {
            serde_json::to_writer(&mut *w, act)?;
            w.write_all(b"\n")?;
        }
        Ok(())
    })
}
