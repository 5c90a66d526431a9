//! Files that replay a flight: logs and recorded operator input.

use std::io::BufRead;
use std::path::Path;

use serde::de::DeserializeOwned;

use crate::components::input::TimedCommand;
use crate::components::output::LogLine;
use crate::components::play::{Direction, Playback};
use crate::error::{Error, Kind, Result};
use crate::output;

/// Reads a flight's log for replay: one [`LogLine`] per line.
pub(crate) fn read_log(path: &Path, rate: f64, direction: Direction) -> Result<Playback> {
    let hint = "give a log written by --log";
    let bad = |e: Error| if e.kind == Kind::Usage { e } else { Error::file(path, e.why, hint) };
    Playback::new(read_lines::<LogLine>(path, hint)?, rate, direction).map_err(bad)
}

/// Reads a file with one JSON value per line; skips empty lines.
fn read_lines<T: DeserializeOwned>(path: &Path, hint: &str) -> Result<Vec<T>> {
    let unread =
        |e: std::io::Error| Error::file(path, format!("cannot be read ({})", output::plain(&e)), hint).caused_by(e);
    let file = std::fs::File::open(path).map_err(unread)?;
    let mut values = Vec::new();
    for (n, line) in std::io::BufReader::new(file).lines().enumerate() {
        let line = line.map_err(unread)?;
        if !line.trim().is_empty() {
            let value = serde_json::from_str(&line);
            let invalid = |e| Error::file(path, format!("line {}: {e}", n + 1), hint).caused_by(e);
            values.push(value.map_err(invalid)?);
        }
    }
    Ok(values)
}

/// Reads recorded operator input: one [`TimedCommand`] per line.
pub(crate) fn read_commands(path: &Path) -> Result<Vec<TimedCommand>> {
    let hint = "give a file written by --record-input";
    let commands: Vec<TimedCommand> = read_lines(path, hint)?;
    match commands.windows(2).position(|w| w[0].tick > w[1].tick) {
        Some(n) => Err(Error::file(path, format!("line {}: is earlier than the line before", n + 2), hint)),
        None => Ok(commands),
    }
}

/// Writes operator input, one [`TimedCommand`] per line. Fails with status 5 if it cannot be written.
pub(crate) fn write_commands(path: &Path, commands: &[TimedCommand]) -> Result<()> {
    output::write_whole(path, |w| {
        for act in commands {
            serde_json::to_writer(&mut *w, act)?;
            w.write_all(b"\n")?;
        }
        Ok(())
    })
}
