//! `colvis explain`.

use std::sync::Arc;

use crate::app::explain::explain;
use crate::app::{FlightApp, plan};
use crate::cli::args::{ExplainArgs, Global};
use crate::cli::prepare::{self, Timings};
use crate::cli::{fly, print};
use crate::components::output::FrameCache;
use crate::error::{Error, Result};
use crate::progress::Progress;

/// Builds the flight that `fly` would fly with the same options and says what it is made of.
///
/// # Errors
/// As `fly`'s preparation.
pub fn run(args: &ExplainArgs, global: &Global, progress: &Arc<Progress>) -> Result<()> {
    fly::check(&args.fly)?;
    let scene = fly::scene(&args.fly, !args.fly.headless && cfg!(feature = "window"))?;
    let image = scene.picture.then(|| fly::image_settings(&args.fly, global, &scene)).transpose()?;
    let mut timings = Timings::default();
    let space = {
        let preset = prepare::preset(args.fly.preset, scene.render.preset);
        prepare::space(args.fly.input.as_deref(), global, preset, &mut timings, progress)?
    };
    let lumen = Arc::new(prepare::lumen(space.volume(), &mut timings, progress)?);
    let plan = plan::plan(&space, &lumen, &fly::wish(&args.fly), scene.body.radius_mm, progress)?;
    let mut flight = FlightApp::new(space, lumen, plan, scene, image)?;
    if flight.camera::<FrameCache>().is_some() {
        // Only frames fill it: the last one's and the one before's memory is used in turn.
        flight.frame();
        flight.frame();
    }
    let explanation = explain(&flight);
    let text = if args.json {
        serde_json::to_string_pretty(&explanation).map_err(|e| Error::fault("explain", e.to_string(), "report it"))?
    } else {
        explanation.text()
    };
    print(|out| writeln!(out, "{}", text.trim_end()))
}
