//! `colvis plane`.

use std::path::Path;
use std::sync::Arc;

use crate::app::Scene;
use crate::cli::args::PlaneArgs;
use crate::cli::files::Files;
use crate::cli::messages::say;
use crate::dynamics::tentacles::TentacleSettings;
use crate::error::{Error, Result};
use crate::host::plane as headless;
#[cfg(feature = "window")]
use crate::host::window::{Display, plane as window};
use crate::output;
use crate::plane::plan::pair;
use crate::plane::{Drawing, Flight, PlaneSettings, State, shipped};
use crate::progress::Progress;
use crate::schedule::Guide;

/// Tables of a scene file that a flight through a drawing uses.
const USED: [&str; 5] = ["plugins", "body", "tentacles", "mines", "watch"];
/// Path of the picture without a display, if none was requested.
const FALLBACK: &str = "plane.png";

/// Runs the command. Fails with status 2 for invalid arguments, 3 for an unusable drawing, 4 if the flight calls the operator, 5 if
/// the picture cannot be written.
pub(crate) fn run(args: &PlaneArgs, progress: &Arc<Progress>) -> Result<()> {
    if let Some(out) = &args.out {
        headless::Film::check(out)?;
        output::check_folders(&[out])?;
    }
    match (&args.out, args.headless) {
        (None, true) => {
            return Err(Error::usage("--headless", "there is no output", "add --out F.png or F.gif"));
        }
        (Some(_), false) => return Err(Error::usage("--out", "a window writes no image", "add --headless")),
        _ => {}
    }
    let settings = args.scene.as_deref().map_or_else(|| Ok(PlaneSettings::default()), settings)?;
    let drawing = drawing(args.lumen.as_deref())?;
    let flight = Flight::new(drawing, settings)?;
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
    // The user did not name this file: it must not overwrite the drawing.
    Files::plane(args)
        .writes([FALLBACK])
        .check_apart()
        .map_err(|e| Error::usage("no display", e.to_string(), "add --headless --out F.png"))?;
    output::to_stderr(format_args!("no display: flying headless, see {FALLBACK}"));
    fly(flight, Path::new(FALLBACK), progress)
}

/// The settings of a scene file, as for a flight through a scan. Only tentacles work in a drawing, and nothing is rendered. Fails
/// with status 3 if it cannot be read, 2 if it is not a scene or not one for a drawing.
fn settings(path: &Path) -> Result<PlaneSettings> {
    let text = output::read_text(path, "give a scene file")?;
    let what = || path.display().to_string();
    let scene = Scene::read(path, &crate::app::Catalog::default())?;
    let refuse = |why: String, hint: &str| Err(Error::usage(what(), why, hint));
    if scene.guide_name() != TentacleSettings::NAME {
        let why = match scene.guide() {
            Some(guide) => format!("uses the guide {}, but only tentacles can fly through a drawing", guide.name),
            None => "names no guide: nothing would move".to_owned(),
        };
        return refuse(why, "name the plugin tentacles instead");
    }
    if scene.picture {
        return refuse("has the plugin render, but a drawing is not rendered".to_owned(), "leave that plugin out");
    }
    let table: toml::Table = text.parse().map_err(|e: toml::de::Error| {
        Error::usage(what(), e.message().to_owned(), "name known plugins and settings")
    })?;
    for name in table.keys().filter(|name| !USED.contains(&name.as_str())) {
        say(&format!("{}: [{name}] does not apply to a drawing", path.display()));
    }
    let usual = PlaneSettings::default();
    let mut tentacles = scene.guides.get::<TentacleSettings>();
    // A circle needs fewer than a sphere where the file does not say how many.
    if table.get(TentacleSettings::NAME).and_then(|t| t.get("count")).is_none() {
        tentacles.count = usual.tentacles.count;
    }
    Ok(PlaneSettings { body: scene.body, tentacles, mines: scene.mines, watch: scene.watch, ..usual })
}

/// The requested drawing: a shipped one by name, or a file.
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
        State::Arrived => output::to_stderr(format_args!("arrived at {at} after {length:.0} mm in {seconds:.1} s")),
        State::Ended => {
            output::to_stderr(format_args!("time is over at {at} after {length:.0} mm in {seconds:.1} s"));
        }
        State::Flying | State::Operator => {}
    }
    flight.outcome()
}
