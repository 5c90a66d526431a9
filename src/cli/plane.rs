//! `colvis plane`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::cli::args::PlaneArgs;
use crate::cli::prepare::say;
use crate::error::{Error, Result};
use crate::host::plane as headless;
#[cfg(feature = "window")]
use crate::host::window::{Display, plane as window};
use crate::output;
use crate::plane::plan::pair;
use crate::plane::{Drawing, Flight, PlaneSettings, State, shipped};
use crate::progress::Progress;

/// Where the picture goes where there is no display and nothing was asked for.
const FALLBACK: &str = "plane.png";

/// Runs the command.
///
/// # Errors
/// Status 2 for wrong usage, 3 for a drawing that cannot be used, 4 where the flight calls the operator, 5 where the
/// picture cannot be written.
pub fn run(args: &PlaneArgs, progress: &Arc<Progress>) -> Result<()> {
    let named: Vec<&Path> = args.lumen.iter().map(PathBuf::as_path).collect();
    if let Some(out) = &args.out {
        headless::Film::check(out)?;
        output::check_targets(&named, &[out])?;
    }
    match (&args.out, args.headless) {
        (None, true) => {
            return Err(Error::usage("--headless", "nothing is to be written", "add --out F.png or F.gif"));
        }
        (Some(_), false) => return Err(Error::usage("--out", "a window writes no picture", "add --headless")),
        _ => {}
    }
    let drawing = drawing(args.lumen.as_deref())?;
    let flight = Flight::new(drawing, PlaneSettings::default())?;
    for note in &flight.plan().notes {
        say(note);
    }
    if let Some(out) = &args.out {
        return fly(flight, out, progress);
    }
    #[cfg(feature = "window")]
    if let Some(display) = Display::open() {
        return window::run(display, flight, progress);
    }
    // Nobody named this file: it must not take the drawing's place.
    output::check_apart(&named, &[Path::new(FALLBACK)])
        .map_err(|e| Error::usage("no display", e.to_string(), "add --headless --out F.png"))?;
    eprintln!("no display: flying headless, see {FALLBACK}");
    fly(flight, Path::new(FALLBACK), progress)
}

/// The drawing that was asked for: a shipped one by its name, or a file.
fn drawing(lumen: Option<&Path>) -> Result<Drawing> {
    let Some(path) = lumen else { return Drawing::decode(shipped::DRAWINGS[0].0, shipped::DRAWINGS[0].1) };
    // A file of that name would have an ending.
    match path.to_str().and_then(shipped::named) {
        Some(drawing) => drawing,
        None => Drawing::read(path),
    }
}

fn fly(mut flight: Flight, out: &Path, progress: &Progress) -> Result<()> {
    headless::fly(&mut flight, out, progress)?;
    let at = pair(flight.position());
    let (length, seconds) = (flight.length_mm(), flight.seconds());
    match flight.state() {
        State::Arrived => eprintln!("arrived at {at} after {length:.0} mm in {seconds:.1} s"),
        State::Ended => eprintln!("the time is over at {at} after {length:.0} mm in {seconds:.1} s"),
        State::Flying | State::Operator => {}
    }
    flight.outcome()
}
