//! `colvis fly`, and `colvis` without a command.

mod covering;
mod files;
#[cfg(feature = "window")]
mod window;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde_json::json;

use crate::app::overlays::gaps;
use crate::app::plan::triple;
use crate::app::{Catalog, FlightApp, FlightRequest, ImageSettings, Overlay, Place, Scan, Scene, Steering, Timings};
use crate::cli::Program;
use crate::cli::args::{FlyArgs, Global, Point};
use crate::cli::files::Files;
use crate::cli::messages::say;
use crate::cli::prepare;
use crate::cli::shared::Use;
use crate::components::flight::State;
use crate::components::play::Direction;
use crate::dynamics::STEP_HZ;
use crate::error::{Error, Kind, Result, program_name};
use crate::host::frames::FrameStats;
use crate::host::headless::{self, Outputs};
use crate::host::terminal::Bar;
use crate::output;
use crate::progress::Progress;
use crate::render::{CameraModel, Light, Settings};
use crate::surface::MeshFormat;
use covering::Covering;
pub(crate) use files::read_commands;
use files::{read_log, write_commands};

/// Limit of a headless flight in simulated seconds, without `--seconds`.
const HEADLESS_SECONDS: f64 = 600.0;
/// Files that a flight writes without a display if no output was requested, and their folder.
const SHORT_FILM: &str = "flight/flight.gif";
const SHORT_LOG: &str = "flight/flight.jsonl";
const SHORT_FOLDER: &str = "flight";

/// Runs the command. Fails with status 2 for invalid options, 3 for an unusable input, 4 if the flight cannot be completed, 5 if an
/// output cannot be written.
pub(crate) fn run(program: &Program, args: &FlyArgs, global: &Global, progress: &Arc<Progress>) -> Result<()> {
    check(args)?;
    check_files(args)?;
    if args.headless {
        return fly_with(program, args, global, progress, Extent::Asked);
    }
    #[cfg(feature = "window")]
    {
        if let Some(display) = crate::host::window::Display::open() {
            return window::fly(program, args, global, progress, display);
        }
        output::to_stderr(format_args!("no display: flying headless"));
    }
    #[cfg(not(feature = "window"))]
    output::to_stderr(format_args!("built without a window: flying headless"));
    let mut args = args.clone();
    if args.record.is_none() && args.log.is_none() {
        args.record = Some(SHORT_FILM.to_owned());
        args.log = Some(PathBuf::from(SHORT_LOG));
        // The user did not name these outputs: they must not overwrite an input.
        Files::fly(&args).check_apart()?;
        return fly_with(program, &args, global, progress, Extent::Short);
    }
    fly_with(program, &args, global, progress, Extent::Asked)
}

/// Refuses invalid combinations before anything is read. Fails with status 2.
pub(crate) fn check(args: &FlyArgs) -> Result<()> {
    for (name, value) in [("--seconds", args.seconds), ("--fps", args.fps), ("--rate", args.rate)] {
        if let Some(v) = value.filter(|v| !(v.is_finite() && *v > 0.0)) {
            return Err(Error::usage(name, format!("{v} is not above 0"), "give a positive number"));
        }
    }
    if args.headless && args.second.is_some() {
        let hint = "leave --headless out; `match` finds the places that belong together";
        return Err(Error::usage("--second", "two positions are read side by side in a window", hint));
    }
    if args.rate.is_some() && args.play.is_none() {
        return Err(Error::usage("--rate", "needs --play and a log", "add them, or leave --rate out"));
    }
    let film = args.record.as_ref().is_some_and(|r| r.to_lowercase().ends_with(".gif"));
    if film && args.fps.is_some_and(|f| f > 50.0) {
        return Err(Error::usage("--fps", "a GIF shows at most 50 images a second", "record a folder/ or an .mp4"));
    }
    if args.fps.is_some_and(|f| f > f64::from(STEP_HZ)) {
        let why = format!("there are {STEP_HZ} simulation steps a second");
        return Err(Error::usage("--fps", why, format!("give at most {STEP_HZ}")));
    }
    if args.play.is_some() {
        for (name, given) in [
            ("--review", args.review),
            ("--guide", args.guide.is_some()),
            ("--from", args.from.is_some()),
            ("--to", args.to.is_some()),
            ("--replay", args.replay.is_some()),
            ("--record-input", args.record_input.is_some()),
        ] {
            if given {
                let why = "does not apply to a replayed flight";
                return Err(Error::usage(name, why, "leave it out, or fly without --play"));
            }
        }
    }
    Ok(())
}

/// Refuses a missing input and impossible outputs before any work is done.
fn check_files(args: &FlyArgs) -> Result<()> {
    if let Some(input) = [&args.input, &args.second].into_iter().flatten().find(|i| !i.exists()) {
        return Err(Error::file(
            input,
            "does not exist",
            format!("check the name, or see {} --help for the commands", program_name()),
        ));
    }
    if let Some(mesh) = &args.coverage_mesh
        && MeshFormat::of(mesh).ok() != Some(MeshFormat::Ply)
    {
        let why = "a number on each face needs a .ply";
        return Err(Error::usage(mesh.display().to_string(), why, "end it in .ply"));
    }
    // A missing folder for images is created.
    let film = args.record.as_ref().filter(|r| !r.ends_with('/')).map(PathBuf::from);
    let outputs = [&args.log, &args.stats, &args.record_input, &args.coverage_mesh, &film]
        .into_iter()
        .filter_map(|f| f.as_deref());
    output::check_folders(&outputs.collect::<Vec<_>>())
}

/// Where a flight is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Screen {
    /// In a window.
    Window,
    /// Not shown; its pictures may be recorded.
    None,
}

/// The scene of the arguments; options override the scene file. Fails with status 2 for an invalid scene.
pub(crate) fn scene(program: &Program, args: &FlyArgs, global: &Global, screen: Screen) -> Result<Scene> {
    let mut scene = match args.scene.as_deref() {
        Some(file) => Scene::read(file, &program.catalog)?,
        None => {
            let Catalog { guides, plugins, .. } = program.catalog.clone();
            Scene { guides, plugins, ..Scene::default() }
        }
    };
    if let Some(name) = &args.guide {
        scene.steering = Steering::Guide(scene.find(name)?.name);
    }
    if let Some(path) = &args.play {
        let direction = if args.reverse { Direction::Backwards } else { Direction::Forwards };
        scene.steering = Steering::Log(read_log(path, args.rate.unwrap_or(1.0), direction)?);
    }
    let windowed = screen == Screen::Window;
    scene.picture |= windowed || args.record.is_some();
    scene.presented = windowed || args.record.is_some();
    scene.image.preset = prepare::preset(program, args.preset.as_deref(), scene.image.preset)?;
    scene.image.settings.options = scene.options.of(scene.image.preset.name);
    scene.log = args.log.is_some();
    scene.coverage |= args.coverage || args.coverage_mesh.is_some() || args.review;
    scene.operator = windowed || args.replay.is_some() || args.record_input.is_some();
    if scene.picture {
        scene.image = image_settings(program, args, global, &scene, screen)?;
    } else if scene.coverage {
        // Nothing is rendered, but the coverage is that of pictures.
        (scene.image.camera, scene.image.fov_degrees) = camera(program, global, &scene)?;
    }
    scene.check()?;
    overlays(program, args, &scene)?;
    Ok(scene)
}

/// The program's overlays with the scene's settings; those of `--overlay` are visible from the start. Fails with status 2 for an
/// unknown overlay or one that cannot be drawn.
fn overlays(program: &Program, args: &FlyArgs, scene: &Scene) -> Result<Vec<Overlay>> {
    for name in &args.overlay {
        program.catalog.find_overlay(name)?;
        if cfg!(not(feature = "window")) {
            let why = "this build has no window and cannot draw text";
            return Err(Error::usage("--overlay", why, "build with the feature window"));
        }
    }
    let all = program.catalog.overlays.iter().map(|&o| {
        let shown = o.shown || args.overlay.iter().any(|n| n == o.name);
        scene.options.overlay(Overlay { shown, ..o })
    });
    Ok(all.collect())
}

/// Start and goal of the arguments.
pub(crate) fn request(args: &FlyArgs) -> FlightRequest {
    let place = |p: Point| match p {
        Point::Rectum => Place::Rectum,
        Point::Cecum => Place::Cecum,
        Point::World(w) => Place::World(w),
    };
    FlightRequest { from: args.from.map(place), to: args.to.map(place), reverse: args.reverse }
}

/// The camera model, with its settings, and the view angle, degrees. Fails with status 2 for an invalid one.
fn camera(program: &Program, global: &Global, scene: &Scene) -> Result<(CameraModel, f64)> {
    let camera = prepare::camera(program, global, scene.image.camera)?;
    let camera = CameraModel { options: scene.options.of(camera.name), ..camera };
    let fov_degrees = match global.fov {
        None if camera == scene.image.camera => scene.image.fov_degrees,
        _ => prepare::fov(global, camera)?,
    };
    Ok((camera, fov_degrees))
}

/// Image settings. A window always adapts its detail, whatever the quality, because an operator cannot steer by late pictures.
/// Fails with status 2 for an invalid view angle.
fn image_settings(
    program: &Program,
    args: &FlyArgs,
    global: &Global,
    scene: &Scene,
    screen: Screen,
) -> Result<ImageSettings> {
    let quality = prepare::quality(args.quality);
    let (camera, fov_degrees) = camera(program, global, scene)?;
    let size = args.size.map_or_else(|| prepare::usual_size(camera), Ok)?;
    if screen == Screen::Window && camera.camera(90.0, 1.0).is_ok_and(|c| c.aspect().is_some()) {
        let why = "its pictures have one shape, and those of a window any";
        let hint = "add --headless and --record OUT, or use colvis render";
        return Err(Error::usage(format!("--camera {}", camera.name), why, hint));
    }
    let preset = scene.image.preset;
    let adaptive = screen == Screen::Window || quality.adaptive;
    let light = if screen == Screen::Window { Light::ENDOSCOPE } else { Light::HEADLIGHT };
    let quality = Settings { adaptive, light, options: scene.options.of(preset.name), ..quality };
    Ok(ImageSettings {
        camera,
        width: size.width,
        height: size.height,
        fov_degrees,
        settings: scene.render.apply(quality),
        preset,
    })
}

/// Opens the scan for a scene. Fails with status 2 for invalid options, 3 if it cannot be read, 4 if interrupted.
pub(crate) fn open(args: &FlyArgs, global: &Global, scene: &Scene, progress: &Arc<Progress>) -> Result<Scan> {
    let preset = scene.image.preset;
    // Missed patches are reported with their distances along the colon.
    let measures = args.coverage || args.coverage_mesh.is_some() || args.review;
    let is_changed = scene.play().is_none() && scene.needs().fluid_as_gas;
    let purpose = if is_changed { Use::Change } else { Use::Look };
    prepare::open_to_fly(args.input.as_deref(), global, preset, measures, purpose, progress)
}

/// Prepares the flight through a scan and prints notes.
pub(crate) fn flight(args: &FlyArgs, scan: &mut Scan, scene: Scene) -> Result<FlightApp> {
    let made = scan.flight(scene, &request(args));
    scan.take_notes().iter().for_each(|note| say(note));
    made
}

/// Writes stats and operator input of a flight, successful or not.
fn leave(args: &FlyArgs, flight: &FlightApp, stats: &serde_json::Value) -> Result<()> {
    if let Some(path) = &args.stats {
        output::write_json(path, stats)?;
    }
    if let Some(path) = &args.record_input {
        write_commands(path, flight.commands.recorded())?;
    }
    Ok(())
}

/// Writes an empty log and stats with the reason for a flight that could not start. A failed write is only noted, because the
/// reason for the missing flight matters more.
fn leave_unflown(args: &FlyArgs, timings: &Timings, why: &Error) {
    if why.kind == Kind::Incomplete
        && let Err(e) = write_unflown(args, timings, why)
    {
        say(&e.to_string());
    }
}

fn write_unflown(args: &FlyArgs, timings: &Timings, why: &Error) -> Result<()> {
    if let Some(path) = &args.log {
        output::write_whole(path, |_| Ok(()))?;
    }
    if let Some(path) = &args.stats {
        let mut m = prepare::stats_head(timings);
        m.insert("frames".to_owned(), json!([]));
        m.insert("state".to_owned(), json!(State::Operator));
        m.insert("reason".to_owned(), json!(format!("{}: {}", why.what, why.why)));
        m.insert("length_mm".to_owned(), json!(0.0));
        output::write_json(path, &m)?;
    }
    Ok(())
}

/// How much of a flight to record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Extent {
    /// According to the options.
    Asked,
    /// A small, quick film of the whole flight.
    Short,
}

fn fly_with(
    program: &Program,
    args: &FlyArgs,
    global: &Global,
    progress: &Arc<Progress>,
    extent: Extent,
) -> Result<()> {
    let mut scene = scene(program, args, global, Screen::None)?;
    let overlays = overlays(program, args, &scene)?.into_iter().filter(|o| args.overlay.iter().any(|n| n == o.name));
    let overlays: Vec<Overlay> = overlays.collect();
    let covering = Covering::asked(args, global, scene.image.camera)?;
    let commands = args.replay.as_deref().map(read_commands).transpose()?;
    if extent == Extent::Short && args.size.is_none() {
        (scene.image.width, scene.image.height) = (320 * scene.image.width / scene.image.height.max(1), 320);
    }
    let bar = Bar::show(progress);
    let mut timings = Timings::default();
    let made = open(args, global, &scene, progress).and_then(|mut scan| {
        let made = scan.cleanse_for(&scene).and_then(|()| flight(args, &mut scan, scene));
        timings = scan.timings().clone();
        made
    });
    let mut flight = match made {
        Ok(flight) => flight,
        Err(e) => {
            drop(bar);
            // Only now is it known that there was a scan to fly. A refused command must leave no folder.
            if extent == Extent::Short && e.kind == Kind::Incomplete {
                output::make_folder(Path::new(SHORT_FOLDER)).unwrap_or_else(|e| say(&e.to_string()));
            }
            leave_unflown(args, &timings, &e);
            return Err(e);
        }
    };
    if args.stats.is_some()
        || flight.setup().plan.goal().missed.is_some()
        || overlays.iter().any(|o| o.name == gaps::OVERLAY.name)
    {
        timings.time("connection_s", || tell_connection(&flight))?;
    }
    let short = extent == Extent::Short;
    if !flight.setup().scene.moves() {
        say("nothing in the scene moves the camera, so it stays in place");
    }
    if short {
        output::make_folder(Path::new(SHORT_FOLDER))?;
    }
    if let Some(commands) = commands {
        flight.commands.replay(commands);
    }
    if args.record_input.is_some() {
        flight.commands.start();
    }
    // One image for every half second of the flight, shown at twelve a second, makes a short film of the whole flight.
    let outputs = Outputs {
        record: args.record.clone(),
        fps: if short { args.fps.unwrap_or(2.5) } else { args.fps.unwrap_or(30.0) },
        shown_fps: short.then_some(12.0),
        log: args.log.clone(),
        overlays,
    };
    // A log is played to its end, however slowly.
    let most = flight.setup().scene.play().map_or(HEADLESS_SECONDS, |p| p.takes_s() + 1.0);
    let mut seen = None;
    let mut onward = |flight: &mut FlightApp| match &covering {
        Some(covering) => covering.onward(flight, &mut seen, progress),
        None => Ok(None),
    };
    let seconds = args.seconds.unwrap_or(most);
    let (frames, flown) = headless::fly_on(&mut flight, seconds, &outputs, progress, &mut onward);
    flight.take_notes().iter().for_each(|note| say(note));
    let covered = match (&covering, seen) {
        (Some(covering), Some(seen)) if flown.is_ok() => Some(covering.stats(seen)),
        _ => None,
    };
    let mut stats = stats(&flight, &timings, &frames, covered.as_ref());
    let asked = ask_plugins(args, &flight, &mut stats);
    drop(bar);
    let left = leave(args, &flight, &stats);
    flown.and(left).and(asked)?;
    report(&flight);
    if short {
        output::to_stderr(format_args!("see {SHORT_FILM} and {SHORT_LOG}"));
    }
    headless::outcome(&flight)
}

/// Prints how the colon leads from one end of the flight to the other, if that is not one segment of gas.
fn tell_connection(flight: &FlightApp) -> Result<()> {
    if let Some(way) = flight.connection()? {
        let [from, to] = flight.setup().plan.asked.places();
        output::to_stderr(format_args!("from {from} to {to}: {way}"));
    }
    Ok(())
}

/// Prints how the flight ended.
fn report(flight: &FlightApp) {
    let f = flight.flight();
    let s = flight.clock().seconds();
    match f.state {
        State::Arrived => {
            output::to_stderr(format_args!("arrived at {} after {:.0} mm in {s:.1} s", triple(f.place), f.length_mm));
        }
        State::Ended => output::to_stderr(format_args!("time is over after {:.0} mm in {s:.1} s", f.length_mm)),
        State::Flying | State::Operator => {}
    }
    if let Some(text) = headless::unflown_text(flight) {
        output::to_stderr(format_args!("{text}"));
    }
}

/// Stats of a flight.
fn stats(
    flight: &FlightApp,
    timings: &Timings,
    frames: &[FrameStats],
    covered: Option<&covering::Stats>,
) -> serde_json::Value {
    let mut m = prepare::stats_head(timings);
    m.insert("frames".to_owned(), json!(frames));
    match covered {
        Some(covered) => {
            if let (Some([planned_s, distance_s]), Some(prepare)) = (covered.took, m.get_mut("prepare")) {
                (prepare["review_s"], prepare["review_distance_s"]) = (json!(planned_s), json!(distance_s));
            }
            m.insert("coverage_s".to_owned(), json!(covered.covered_s));
            m.extend(covered.flight.clone().into_iter().chain(covered.wall.clone()));
        }
        None => m.extend(flight_stats(flight)),
    }
    m.into()
}

/// Adds the statistics of plug-ins to the stats, under `plugins` and their names, if stats are written. Fails with status 1 and the
/// name of the first that panics. Those of the others are still added.
fn ask_plugins(args: &FlyArgs, flight: &FlightApp, stats: &mut serde_json::Value) -> Result<()> {
    if args.stats.is_none() {
        return Ok(());
    }
    let (plugins, outcome) = flight.plugin_stats();
    if let Some(stats) = stats.as_object_mut().filter(|_| !plugins.is_empty()) {
        stats.insert("plugins".to_owned(), plugins.into());
    }
    outcome
}

/// The outcome of a flight.
fn flight_stats(flight: &FlightApp) -> serde_json::Map<String, serde_json::Value> {
    let f = flight.flight();
    let mut m = serde_json::Map::new();
    m.insert("state".to_owned(), json!(f.state));
    m.insert("reason".to_owned(), json!(f.reason));
    m.insert("place_mm".to_owned(), json!(flight.pose().position.to_array()));
    m.insert("length_mm".to_owned(), json!(f.length_mm));
    m.insert("seconds".to_owned(), json!(flight.clock().seconds()));
    m.insert("turns".to_owned(), json!(f.turns));
    m.insert("escapes".to_owned(), json!(f.escapes));
    let unflown: Vec<_> = flight
        .survey()
        .unflown()
        .into_iter()
        .map(|(n, ml)| json!({ "ml": ml, "ends_mm": flight.setup().lumen.segments[n].ends }))
        .collect();
    m.insert("unflown".to_owned(), json!(unflown));
    if let Some(way) = flight.found_connection() {
        m.insert("connection".to_owned(), json!(way));
    }
    let setup = flight.setup();
    if let Some(lying) = setup.lumen.lying {
        m.insert("position".to_owned(), json!(lying));
    }
    if let Some(route) = setup.fields.route() {
        m.insert("names".to_owned(), json!(setup.lumen.names().on(route.points())));
    }
    m
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::app::Plan;
    use crate::components::output::LogLine;
    use crate::components::still::{StillView, StillViews};
    use crate::coverage::LiveCoverage;
    use crate::dynamics::Attitude;
    use crate::fields::lumen;
    use crate::render::presets::standard;
    use crate::render::{Options, Preset};
    use crate::testing::Room;
    use crate::volume::io;

    /// Reads the arguments of `colvis`.
    fn parsed(arguments: &[&str]) -> (FlyArgs, Global) {
        let args = Program::default().parse(["colvis"].iter().chain(arguments).copied()).unwrap();
        (args.fly, args.global)
    }

    #[test]
    fn only_a_gif_is_limited_to_fifty_images_a_second() {
        let refused = |arguments: &[&str]| check(&parsed(arguments).0).err().map(|e| e.what);
        for allowed in [
            &["--record", "a.gif"][..],
            &["--record", "a.GIF", "--fps", "50"],
            &["--record", "a.mp4", "--fps", "60"],
            &["--record", "gif/", "--fps", "120"],
            &["--fps", "60"],
        ] {
            assert_eq!(refused(allowed), None, "{allowed:?}");
        }
        for wrong in [
            &["--record", "a.gif", "--fps", "51"][..],
            &["--record", "a.GIF", "--fps", "60"],
            &["--record", "gif/", "--fps", "121"],
            &["--fps", "0"],
        ] {
            assert_eq!(refused(wrong).as_deref(), Some("--fps"), "{wrong:?}");
        }
    }

    #[test]
    fn a_window_adapts_its_detail_and_a_recording_only_if_asked() {
        let settings = |arguments: &[&str], screen| {
            let (args, global) = parsed(arguments);
            scene(&Program::default(), &args, &global, screen).unwrap().image.settings
        };
        let of_a_window = |arguments| settings(arguments, Screen::Window);
        let of_a_film = |quality| settings(&["--record", "a.gif", "--quality", quality], Screen::None);
        for arguments in [&[][..], &["--quality", "high"], &["--quality", "low"], &["--quality", "adaptive"]] {
            let settings = of_a_window(arguments);
            assert!(settings.adaptive && settings.light == Light::ENDOSCOPE, "{arguments:?}");
        }
        for (quality, adaptive) in [("high", false), ("low", false), ("adaptive", true)] {
            let settings = of_a_film(quality);
            assert!(settings.adaptive == adaptive && settings.light == Light::HEADLIGHT, "{quality}");
        }
    }

    #[test]
    fn the_settings_of_a_preset_in_a_scene_file_reach_its_pictures() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("scene.toml").to_string_lossy().into_owned();
        std::fs::write(&file, "plugins = [\"render\"]\n[render]\npreset = \"tinted\"\n[tinted]\nred = 7\n").unwrap();
        let tinted = Preset { name: "tinted", check: |_| Ok(()), ..standard::PRESET };
        let program = Program::default().preset(tinted);
        let (args, global) = parsed(&["--scene", &file]);
        for screen in [Screen::Window, Screen::None] {
            let image = scene(&program, &args, &global, screen).unwrap().image;
            assert_eq!(image.preset.name, "tinted");
            assert_eq!(image.settings.options, Options::new("red = 7".parse().unwrap()), "{screen:?}");
        }
    }

    #[test]
    fn a_log_is_played_to_its_end_however_slowly() {
        let dir = tempfile::tempdir().unwrap();
        let [scan, log, stats] =
            ["room.nii", "log.jsonl", "stats.json"].map(|n| dir.path().join(n).to_string_lossy().into_owned());
        io::save(Path::new(&scan), Room::new([20, 40, 20]).scan().voxels(), &Progress::new()).unwrap();
        let line = |n: u32| LogLine {
            t: f64::from(n),
            position: [10.0, 10.0 + 2.0 * f64::from(n), 10.0],
            forward: [0.0, 1.0, 0.0],
            up: [0.0, 0.0, 1.0],
            velocity: [0.0, 2.0, 0.0],
            clearance_mm: 10.0,
            state: if n == 3 { State::Arrived } else { State::Flying },
            guide: "manual".to_owned(),
        };
        let lines: Vec<String> = (0..=3).map(|n| serde_json::to_string(&line(n)).unwrap()).collect();
        std::fs::write(&log, lines.join("\n")).unwrap();
        // Three seconds at half and at twice the speed.
        for (rate, seconds) in [("0.5", 6.0), ("2", 1.5)] {
            let (args, global) = parsed(&[&scan, "--headless", "--play", &log, "--rate", rate, "--stats", &stats]);
            run(&Program::default(), &args, &global, &Arc::new(Progress::new())).unwrap();
            let flown: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&stats).unwrap()).unwrap();
            assert_eq!(flown["state"], json!(State::Arrived), "{rate}");
            assert!((flown["place_mm"][1].as_f64().unwrap() - 16.0).abs() < 1e-6, "{rate}: {flown}");
            assert!((flown["seconds"].as_f64().unwrap() - seconds).abs() < 0.05, "{rate}: {flown}");
        }
    }

    #[test]
    fn the_coverage_in_the_stats_is_that_of_the_view_angle() {
        let volume = Room::new([20, 60, 20]).scan();
        let [start, goal] = [10.0, 50.0].map(|y| DVec3::new(10.0, y, 10.0));
        let lumen = lumen::gas_at(volume.voxels(), start, &Progress::new()).unwrap().unwrap();
        let plan = Plan::between(start, goal, 40.0);
        let mut flight = FlightApp::new(volume, Arc::new(lumen), plan, Scene::default()).unwrap();
        flight.fly(0.2).unwrap();
        let covered = |degrees: f64| {
            let covering = Covering { fov_degrees: degrees, ..Covering::default() };
            let stats = stats(&flight, &Timings::default(), &[], Some(&covering.flown(&flight).unwrap()));
            [&stats["coverage"], &stats["coverage_both_ways"]].map(|c| c.as_f64().unwrap())
        };
        let [ahead, both_ways] = covered(90.0);
        // At 45° to the axis, the view meets the walls 10 mm ahead: it sees 40 of 60 mm of them, and the end. Both ways, it sees
        // the other end, too.
        assert!((0.5..0.8).contains(&ahead) && both_ways > ahead, "{ahead} {both_ways}");
        assert!(covered(2.0)[0] < 0.05, "hardly more than the middle of the end");
        let without = stats(&flight, &Timings::default(), &[], None);
        assert!(without.get("coverage").is_none());
    }

    /// Fails if what was looked at beside the flight counts: it depends on when the window was closed.
    #[test]
    fn the_stats_of_a_window_are_of_the_flight_alone() {
        let volume = Room::new([20, 60, 20]).scan();
        let [start, goal] = [10.0, 50.0].map(|y| DVec3::new(10.0, y, 10.0));
        let lumen = lumen::gas_at(volume.voxels(), start, &Progress::new()).unwrap().unwrap();
        let scene = Scene { coverage: true, ..Scene::default() };
        let mut flight = FlightApp::new(volume, Arc::new(lumen), Plan::between(start, goal, 40.0), scene).unwrap();
        flight.fly(0.2).unwrap();
        let told = |flight: &FlightApp| {
            let covering = Covering { fov_degrees: 90.0, ..Covering::default() };
            let stats = covering.flown(flight).unwrap();
            serde_json::to_string(&stats.wall).unwrap()
        };
        let before = told(&flight);
        assert!(before.contains("coverage_live"), "{before}");
        let back = Attitude::new(-DVec3::Y, DVec3::Z);
        let view = StillView { position: goal, attitude: back, fov_degrees: 120.0 };
        let still: StillViews = [view].into_iter().collect();
        flight.app_mut().camera().insert(still);
        let volume = flight.setup().volume.clone();
        let mut live = flight.camera_mut::<LiveCoverage>().unwrap();
        let share = live.share();
        live.look(&volume, &[view], 0.0);
        assert!(live.share() > share + 0.05);
        assert_eq!(told(&flight), before);
    }

    #[test]
    fn the_ends_of_a_flight_are_those_of_the_arguments() {
        let asked = |arguments: &[&str]| request(&parsed(arguments).0);
        let to = asked(&["--from", "1,2,-3", "--to", "cecum"]);
        assert!(matches!(to.from, Some(Place::World(w)) if w == DVec3::new(1.0, 2.0, -3.0)));
        assert!(matches!(to.to, Some(Place::Cecum)) && !to.reverse);
        let back = asked(&["--from", "rectum", "--reverse"]);
        assert!(matches!(back.from, Some(Place::Rectum)) && back.to.is_none() && back.reverse);
    }

    #[test]
    fn outputs_must_not_overwrite_an_input_or_each_other() {
        let refused = |arguments: &[&str]| Files::fly(&parsed(arguments).0).check_apart().is_err();
        assert!(refused(&["--log", "a.jsonl", "--stats", "a.jsonl"]));
        assert!(refused(&["scan.nii", "--log", "scan.nii"]));
        assert!(refused(&["--play", "a.jsonl", "--log", "a.jsonl"]));
        assert!(refused(&["--review", "--answers", "a.json", "--stats", "a.json"]));
        assert!(!refused(&["scan.nii", "--log", "a.jsonl", "--stats", "b.json", "--record", "c.gif"]));
    }

    #[cfg(feature = "window")]
    #[test]
    fn the_overlays_that_are_asked_for_are_shown_and_no_others() {
        let shown = |arguments: &[&str]| {
            let all = overlays(&Program::default(), &parsed(arguments).0, &Scene::default()).unwrap();
            all.into_iter().filter(|o| o.shown).map(|o| o.name).collect::<Vec<_>>()
        };
        assert!(shown(&[]).is_empty());
        assert_eq!(shown(&["--overlay", "mines"]), ["mines"]);
        assert_eq!(shown(&["--overlay", "tentacles", "--overlay", "forces"]), ["tentacles", "forces"]);
    }
}
