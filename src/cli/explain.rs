//! `colvis explain`.

use std::sync::Arc;

#[cfg(feature = "window")]
use crate::app::FlightApp;
use crate::app::explain::explain;
use crate::cli::args::{ExplainArgs, Global};
use crate::cli::messages::print;
#[cfg(feature = "window")]
use crate::cli::messages::say;
use crate::cli::{Program, fly};
use crate::components::output::FrameCache;
#[cfg(feature = "window")]
use crate::components::slices::SliceView;
use crate::error::{Error, Result};
use crate::progress::Progress;

/// Simulated seconds that a flight with plug-ins is flown to measure their time.
const TRIAL_S: f64 = 0.25;
/// Size of explained slices, pixels: about that of a tile in a window of the usual size.
#[cfg(feature = "window")]
const SLICE: [usize; 2] = [400, 300];

/// Builds the flight that `fly` would fly with the same options and prints its parts.
pub(crate) fn run(program: &Program, args: &ExplainArgs, global: &Global, progress: &Arc<Progress>) -> Result<()> {
    fly::check(&args.fly)?;
    let windowed = !args.fly.headless && cfg!(feature = "window");
    let screen = if windowed { fly::Screen::Window } else { fly::Screen::None };
    let scene = fly::scene(program, &args.fly, global, screen)?;
    let mut scan = fly::open(&args.fly, global, &scene, progress)?;
    scan.cleanse_for(&scene)?;
    let mut flight = fly::flight(&args.fly, &mut scan, scene)?;
    #[cfg(feature = "window")]
    if let Some(layout) = args.fly.layout.as_deref().filter(|_| windowed) {
        for orientation in crate::host::window::slices_of(layout) {
            flight.views().add_slice(SliceView::new(orientation, SLICE))?;
        }
    }
    if flight.camera::<FrameCache>().is_some() {
        // Only frames fill it: the last one's and the one before's memory is used in turn.
        flight.frame()?;
        flight.frame()?;
    }
    if !flight.app().inspect().plugin_times().is_empty() {
        // The time that plug-ins take is reported as measured.
        flight.fly(TRIAL_S)?;
        flight.frame()?;
    }
    let mut explanation = explain(&flight);
    if let Some(taken) = &mut explanation.cleansed {
        let parts = ["cleanse_s", "cleansed_flags_s", "cleansed_lumen_s"];
        let seconds = scan.timings().parts().iter().filter(|p| parts.contains(&p.0)).map(|p| p.1).sum();
        taken.seconds = Some(seconds);
    }
    let text = if args.json {
        serde_json::to_string_pretty(&explanation).map_err(|e| Error::fault("explain", e.to_string(), "report it"))?
    } else {
        explanation.text()
    };
    print(|out| writeln!(out, "{}", text.trim_end()))?;
    #[cfg(feature = "window")]
    if windowed && !args.json {
        print_window(program, &flight)?;
    }
    Ok(())
}

/// Prints the actions of the window and the path of its settings.
#[cfg(feature = "window")]
fn print_window(program: &Program, flight: &FlightApp) -> Result<()> {
    let (actions, unsettled) = program.action_list(&flight.setup().scene.guides)?;
    let wide = |n: usize| actions.iter().map(|a| a[n].chars().count()).max().unwrap_or(0);
    let (ids, keys) = (wide(0), wide(1));
    let rows: String = actions.iter().map(|[id, key, text]| format!("  {id:ids$}  {key:keys$}  {text}\n")).collect();
    print(|out| write!(out, "actions of the window (use their ids in the settings, under [keys]):\n{rows}"))?;
    if let Some(file) = crate::host::window::settings_file() {
        print(|out| writeln!(out, "settings of the window:\n  {}", file.display()))?;
    }
    if let Some(e) = unsettled {
        say(&e.to_string());
    }
    Ok(())
}
