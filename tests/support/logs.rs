//! Logs of flights.

use std::path::Path;

use colvis::components::output::LogLine;
use glam::DVec3;

/// Reads the lines of a complete log.
pub(crate) fn read_log(path: &Path) -> Vec<LogLine> {
    let text = std::fs::read_to_string(path).unwrap();
    assert!(text.ends_with('\n'), "a whole last line");
    text.lines().map(|l| serde_json::from_str(l).unwrap()).collect()
}

/// Returns the camera's position, mm.
pub(crate) fn place(line: &LogLine) -> DVec3 {
    DVec3::from_array(line.position)
}
