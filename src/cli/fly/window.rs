//! The flight in a window.

use std::cell::Cell;
use std::path::PathBuf;
use std::rc::Rc;
use std::sync::{Arc, Mutex, PoisonError};

use serde_json::json;

use super::covering::Covering;
use super::files::read_commands;
use super::{Screen, ask_plugins, leave, leave_unflown, overlays, request, say, scene, stats};
use crate::app::{FlightApp, FlightRequest, Place, Scan, Scene, Timings};
use crate::cli::Program;
use crate::cli::args::{CaseArgs, FlyArgs, Global, SeriesChoice};
use crate::cli::case;
use crate::cli::pair::Pair;
use crate::cli::prepare;
use crate::cli::values::Point;
use crate::components::input::{HandCommand, TimedCommand};
use crate::error::{Error, Kind, Result};
use crate::host::frames::FrameStats;
use crate::host::settings;
use crate::host::window::{self, Asked, ReportOrder, Resume};
use crate::memory;
use crate::polyps::detectors;
use crate::progress::Progress;
use crate::render::CameraModel;
use crate::volume::io;

/// Flies in a window.
pub(crate) fn fly(
    program: &Program,
    args: &FlyArgs,
    global: &Global,
    progress: &Arc<Progress>,
    display: window::Display,
) -> Result<()> {
    if args.record.is_some() {
        return Err(Error::usage("--record", "a window does not record", "add --headless"));
    }
    let scene = scene(program, args, global, Screen::Window)?;
    let overlays = settings::of_user(overlays(program, args, &scene)?);
    let guides = scene.guides.clone();
    let timings = Arc::new(Mutex::new(Timings::default()));
    let flown = Rc::new(Cell::new(false));
    let first = opening(program, args, global, scene, false, &timings, Rc::clone(&flown))?;
    let (own_timings, own_flown) = (Arc::clone(&timings), Rc::clone(&flown));
    let is_forced = args.force;
    let (own_program, own_args, own_global) = (program.clone(), args.clone(), global.clone());
    let open = move |asked: Asked| {
        let Asked { input, series, is_flying, is_whole, beside } = asked;
        // The files that were asked for are those of the first scan that is flown.
        let is_first = !is_flying && !own_flown.get();
        let args = for_another(own_args.clone(), input, is_first);
        let mut global = Global { series: series.map(SeriesChoice::Number), ..own_global.clone() };
        let pair = beside.zip(args.input.clone()).map(|(first, second)| Pair { first, second });
        if let (Some(pair), None) = (&pair, series) {
            global.series = pair.paired(&global)?.map(SeriesChoice::Number);
        }
        let scene = super::scene(&own_program, &args, &global, Screen::Window)?;
        let mut opening = match is_first {
            true => opening(&own_program, &args, &global, scene, is_whole, &own_timings, Rc::clone(&own_flown)),
            false => opening(&own_program, &args, &global, scene, is_whole, &Arc::default(), Rc::default()),
        }?;
        if let Some(pair) = pair.filter(|_| !is_forced) {
            let prepare = opening.prepare;
            opening.prepare = Box::new(move |progress| {
                pair.check(&global, progress)?;
                prepare(progress)
            });
        }
        Ok(opening)
    };
    let launch = window::Launch {
        first,
        second: args.second.clone().map(|path| Asked {
            input: Some(path),
            series: None,
            is_flying: true,
            is_whole: false,
            beside: None,
        }),
        open: Box::new(open),
        size: args.size,
        overlays,
        guides,
        detector: program.catalog.find_detector(args.detector.as_deref().unwrap_or(detectors::BUILT_IN[0].name))?,
        panels: program.all_panels(),
        actions: program.actions.clone(),
        report: report(global),
        layout: args.layout.clone().or_else(|| args.second.as_ref().map(|_| "both".to_owned())),
    };
    let ended = window::run(display, launch, progress).and_then(|()| all_written(args, flown.get()));
    ended.inspect_err(|e| {
        if !flown.get() {
            leave_unflown(args, &timings.lock().unwrap_or_else(PoisonError::into_inner), e);
        }
    })
}

/// Makes the report of a reading with the options of the window's scan.
fn report(global: &Global) -> window::MakeReport {
    let global = global.clone();
    Arc::new(move |order: &ReportOrder, progress: &Arc<Progress>| {
        let ReportOrder { input, series, second, findings, out, for_archive } = order.clone();
        let global = Global { series: series.map(SeriesChoice::Number), ..global.clone() };
        if for_archive && io::identity(&input, &prepare::load_options(&global), progress)?.is_none() {
            let why = "does not tell whose scan it is, so an archive could not file its report";
            return Err(Error::file(&input, why, "send the report of a DICOM study"));
        }
        let args = CaseArgs {
            dicom: for_archive,
            identity: for_archive,
            second,
            force: true,
            ..CaseArgs::new(input, findings, out)
        };
        case::run(&args, &global, progress)
    })
}

/// The guide that reads the whole colon.
const WHOLE: &str = "path";
/// The speed at which it is read, mm/s: slow enough to look at every fold, as readers fly it.
const READING_MM_S: f64 = 20.0;

/// A flight through a scan: how it is steered, between which places, and whether the scan is cleansed first.
#[derive(Clone)]
struct Way {
    scene: Scene,
    request: FlightRequest,
    cleanse: bool,
    /// The speed at which it begins, mm/s; the cruise speed of the scene if `None`.
    mm_s: Option<f64>,
}

impl Way {
    /// The flight that the arguments request, with their scene.
    fn asked(args: &FlyArgs, global: &Global, scene: Scene) -> Self {
        Self { scene, request: request(args), cleanse: global.cleanse, mm_s: None }
    }

    /// The flight through the whole colon: from the rectum along the centerline, cleansed. Fails with status 2 for invalid
    /// arguments.
    fn whole(program: &Program, args: &FlyArgs, global: &Global) -> Result<Self> {
        let args = FlyArgs { guide: Some(WHOLE.to_owned()), from: Some(Point::Rectum), ..args.clone() };
        let scene = scene(program, &args, global, Screen::Window)?;
        Ok(Self { cleanse: true, mm_s: Some(READING_MM_S), ..Self::asked(&args, global, scene) })
    }
}

/// Checks that a flight has written the files that were asked for. Fails with status 4 if there was none.
fn all_written(args: &FlyArgs, is_flown: bool) -> Result<()> {
    let asked = [&args.log, &args.stats, &args.coverage_mesh, &args.record_input].into_iter().flatten().next();
    match asked.filter(|_| !is_flown) {
        Some(file) => {
            let why = "was not written: no scan was flown";
            Err(Error::incomplete(file.display().to_string(), why, "open a scan that can be flown"))
        }
        None => Ok(()),
    }
}

/// The arguments for another scan. Files and length belong to one flight and stay with the first one that is flown. Start, goal and
/// answers belong to one scan and stay with it.
fn for_another(args: FlyArgs, input: Option<PathBuf>, is_first: bool) -> FlyArgs {
    if is_first {
        let own = FlyArgs { from: None, to: None, reverse: false, answers: None, ..args };
        return FlyArgs { input, replay: None, play: None, rate: None, ..own };
    }

    // Every option is named, so that a new one cannot be forgotten here.
    let FlyArgs {
        input: _,
        second: _,
        force: _,
        headless,
        guide,
        from: _,
        to: _,
        reverse: _,
        seconds: _,
        fps,
        size,
        quality,
        preset,
        record,
        log: _,
        stats: _,
        coverage: _,
        review: _,
        answers: _,
        coverage_mesh: _,
        record_input: _,
        replay: _,
        play: _,
        rate: _,
        scene,
        layout,
        detector,
        overlay,
    } = args;
    FlyArgs {
        input,
        headless,
        guide,
        fps,
        size,
        quality,
        preset,
        record,
        scene,
        layout,
        detector,
        overlay,
        ..FlyArgs::default()
    }
}

/// Coverage is evaluated when a flight ends, if something receives it: a file, or the message of a review.
fn covering(args: &FlyArgs, global: &Global, camera: CameraModel) -> Result<Option<Covering>> {
    let is_told = args.stats.is_some() || args.coverage_mesh.is_some() || args.review;
    Ok(Covering::asked(args, global, camera)?.filter(|_| is_told))
}

/// How to open a scan; sets `flown` once it was flown.
fn opening(
    program: &Program,
    args: &FlyArgs,
    global: &Global,
    scene: Scene,
    is_whole: bool,
    timings: &Arc<Mutex<Timings>>,
    flown: Rc<Cell<bool>>,
) -> Result<window::Opening> {
    let resume = if is_whole { Resume::Nothing } else { resume(args) };
    let camera = scene.image.camera;
    let asked = Way::asked(args, global, scene);
    // Where the command line says nothing, the settings and the previous session decide.
    let is_open = resume == Resume::Everything && args.seconds.is_none();
    let whole = if is_whole || is_open { Some(Way::whole(program, args, global)?) } else { None };
    let commands = args.replay.as_deref().map(read_commands).transpose()?;
    let (kept, prepare_args) = (Arc::clone(timings), args.clone());
    let prepare_global = Global { cleanse: false, ..global.clone() };
    let prepare: window::Prepare = Box::new(move |progress| {
        let args = prepare_args;
        let open = || {
            let mut scan =
                prepare::open_unsaid(args.input.as_deref(), &prepare_global, asked.scene.image.preset, progress)?;
            let notes = told_notes(&mut scan);
            // The case is that of the scan as scanned, whether or not it is cleansed.
            let session = window::SessionFile::of(scan.volume().voxels());
            if resume != Resume::Never {
                scan.tell(session.told());
            }
            Ok((scan, notes, session))
        };
        let (mut scan, mut notes, mut session) = open()?;
        let was_whole = session.was_whole();
        if let Some(way) = whole.filter(|_| is_whole || was_whole || window::opens_whole()) {
            let (args, timings) = (args.clone(), Arc::clone(&kept));
            let departure = Departure { scan, session, args, way, commands: None, notes, timings };
            match departure.depart(progress) {
                Ok(ready) if ready.unflown.is_none() => {
                    return Ok(ready.whole(was_whole));
                }
                Err(e) if e.kind != Kind::Incomplete || progress.is_cancelled() => return Err(e),
                Ok(_) | Err(_) => say("the whole colon cannot be read in one flight"),
            }
            (scan, notes, session) = open()?;
            notes.push("The whole colon cannot be read in one flight: fly its segments one by one.".to_owned());
        }
        Departure { scan, session, args, way: asked, commands, notes, timings: kept }.depart(progress)
    });
    let (finish_args, finish_timings) = (args.clone(), Arc::clone(timings));
    let covering = covering(args, global, camera)?;
    let finish = Box::new(move |flight: &FlightApp, frames: &[FrameStats], shown: &window::Shown| {
        flown.set(true);
        let timings = finish_timings.lock().unwrap_or_else(PoisonError::into_inner);
        let covered = covering.as_ref().map(|c| c.flown(flight)).transpose()?;
        let mut stats = stats(flight, &timings, frames, covered.as_ref());
        if let (serde_json::Value::Object(shown), Some(stats)) = (json!(shown), stats.as_object_mut()) {
            stats.extend(shown);
        }
        if let Err(e) = ask_plugins(&finish_args, flight, &mut stats) {
            say(&format!("{}: {}; its statistics are left out", e.what, e.why));
        }
        leave(&finish_args, flight, &stats)
    });
    Ok(window::Opening {
        input: args.input.clone(),
        series: global.series_number(),
        prepare,
        finish,
        resume,
        log: args.log.clone(),
        seconds: args.seconds,
    })
}

/// Takes the notes of a scan and prints them. The window also shows them until they are dismissed.
fn told_notes(scan: &mut Scan) -> Vec<String> {
    let notes = scan.take_notes();
    notes.iter().for_each(|note| say(note));
    notes
}

/// An open scan, with everything that a flight through it needs.
#[derive(Clone)]
struct Departure {
    scan: Scan,
    session: window::SessionFile,
    args: FlyArgs,
    way: Way,
    /// Input to be replayed.
    commands: Option<Vec<TimedCommand>>,
    /// Notes about the scan.
    notes: Vec<String>,
    /// Receives how long the preparation took.
    timings: Arc<Mutex<Timings>>,
}

impl Departure {
    /// Prepares the requested flight. If that is impossible, a reader may still look at the scan's slices and start elsewhere.
    /// Returns the error of the flight if it repeats another one, or if its length was given: those run unattended.
    fn depart(mut self, progress: &Arc<Progress>) -> Result<window::Ready> {
        let told = self.scan.told().to_vec();
        let mut made = self.fly();
        if let Err(e) = &made
            && !self.scan.told().is_empty()
            && e.kind == Kind::Incomplete
            && !progress.is_cancelled()
        {
            say(&format!("ignoring your kinds of gas: no flight is possible with them: {e}"));
            self.scan.tell(Vec::new());
            made = self.fly();
        }
        *self.timings.lock().unwrap_or_else(PoisonError::into_inner) = self.scan.timings().clone();
        let mut flight = match made {
            Ok(flight) => flight,
            Err(why) if why.kind == Kind::Incomplete && self.is_read() && !progress.is_cancelled() => {
                // They are those of the case, and stay in its file.
                self.scan.tell(told);
                return self.look(why);
            }
            Err(e) => return Err(e),
        };
        // What prepared the flight takes blocks of all sizes again and again, and is faster if it gets them back. What follows goes on for
        // hours.
        memory::return_large_blocks();
        flight.setup().scene.image.settings.light.prepare(&flight.setup().volume);
        if let Some(mm_s) = self.way.mm_s {
            let cruise = flight.setup().scene.cruise_mm_s();
            // To nine digits, as the operator's input is recorded.
            let speed = (mm_s / cruise.max(1e-3) * 1e9).round() / 1e9;
            flight.act(HandCommand::Speed(speed.min(1.0)))?;
        }
        if let Some(commands) = self.commands {
            flight.commands.replay(commands);
        }
        if self.args.record_input.is_some() {
            flight.commands.start();
        }
        Ok(self.session.ready(flight, self.notes))
    }

    fn fly(&mut self) -> Result<FlightApp> {
        let Way { scene, request, cleanse, .. } = self.way.clone();
        if cleanse {
            let taken = self.scan.cleanse()?.to_string();
            if !self.notes.contains(&taken) {
                say(&taken);
                self.notes.push(taken);
            }
        }
        let made = self.scan.cleanse_for(&scene).and_then(|()| self.scan.flight(scene, &request));
        self.notes.extend(told_notes(&mut self.scan));
        made
    }

    /// True if a user sits in front of the window.
    fn is_read(&self) -> bool {
        resume(&self.args) != Resume::Never && self.args.seconds.is_none()
    }

    /// Shows the scan without a flight. One may begin elsewhere.
    fn look(mut self, why: Error) -> Result<window::Ready> {
        let at_rest = self.scan.at_rest(self.way.scene.clone())?;
        self.notes.extend(told_notes(&mut self.scan));
        let (session, notes, anew) = (self.session.clone(), self.notes.clone(), self);
        let start_at = Box::new(move |place| {
            let mut anew = anew.clone();
            let prepare: window::Prepare = Box::new(move |progress: &Arc<Progress>| {
                anew.scan.report_to(progress);
                // The user may have set kinds meanwhile.
                anew.scan.tell(anew.session.told());
                anew.way.request = FlightRequest { from: Some(Place::World(place)), ..FlightRequest::default() };
                anew.depart(progress)
            });
            prepare
        });
        Ok(session.unflown(at_rest, notes, why, start_at))
    }
}

/// What a flight in a window resumes from the last time its scan was open.
fn resume(args: &FlyArgs) -> Resume {
    let repeats = args.replay.is_some() || args.record_input.is_some() || args.play.is_some();
    let placed = args.from.is_some() || args.to.is_some() || args.reverse;
    match (repeats, placed, args.guide.is_some() || args.scene.is_some()) {
        (true, ..) => Resume::Never,
        (_, true, _) => Resume::Nothing,
        (.., true) => Resume::Place,
        _ => Resume::Everything,
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::cli::files::Files;
    use crate::components::input::Hand;
    use crate::phantom::PhantomSettings;
    use crate::shared::shared;
    use crate::volume::{Grid, Volume, io};

    #[test]
    fn another_scan_has_no_files_and_no_review_of_the_one_before() {
        let line = "colvis a.nii --guide path --from rectum --to cecum --seconds 5 --size 64x48 --log l.jsonl --stats s.json \
                    --coverage --review --answers a.json --coverage-mesh m.ply --record-input i --replay r --scene s.toml \
                    --reverse --layout slices --detector shape --overlay mines";
        let before = Program::default().parse(line.split_whitespace()).unwrap().fly;
        let args = for_another(before.clone(), Some(PathBuf::from("b.nii")), false);
        assert!(args.input == Some(PathBuf::from("b.nii")) && args.scene == before.scene && !args.reverse);
        // Of all files, only the scene is read, and none is written.
        let none = FlyArgs { input: args.input.clone(), scene: args.scene.clone(), ..FlyArgs::default() };
        assert_eq!(format!("{:?}", Files::fly(&args)), format!("{:?}", Files::fly(&none)));
        assert!(!args.review && !args.coverage && args.from.is_none() && args.to.is_none() && args.seconds.is_none());
        assert_eq!((args.guide, args.size, args.layout), (before.guide.clone(), before.size, before.layout.clone()));
        assert_eq!((args.detector, args.overlay), (before.detector.clone(), before.overlay.clone()));
        assert!(
            covering(&for_another(before, None, false), &Global::default(), CameraModel::default()).unwrap().is_none()
        );
    }

    #[test]
    fn what_was_seen_is_looked_at_if_something_receives_it() {
        let is_looked_at =
            |args: &FlyArgs| covering(args, &Global::default(), CameraModel::default()).unwrap().is_some();
        let coverage = FlyArgs { coverage: true, ..FlyArgs::default() };
        assert!(!is_looked_at(&FlyArgs::default()) && !is_looked_at(&coverage));
        for told in [
            FlyArgs { stats: Some(PathBuf::from("s.json")), ..coverage },
            FlyArgs { coverage_mesh: Some(PathBuf::from("m.ply")), ..FlyArgs::default() },
            FlyArgs { review: true, ..FlyArgs::default() },
        ] {
            assert!(is_looked_at(&told), "{told:?}");
        }
    }

    #[test]
    fn only_a_flight_of_its_own_takes_up_the_last_one() {
        let file = Some(PathBuf::from("f"));
        let args = FlyArgs::default();
        assert_eq!(resume(&args), Resume::Everything);
        assert_eq!(resume(&FlyArgs { guide: Some("path".to_owned()), ..args.clone() }), Resume::Place);
        assert_eq!(resume(&FlyArgs { reverse: true, ..args.clone() }), Resume::Nothing);
        for reverse in [false, true] {
            let args = FlyArgs { reverse, ..args.clone() };
            assert_eq!(resume(&FlyArgs { play: file.clone(), ..args.clone() }), Resume::Never);
            assert_eq!(resume(&FlyArgs { replay: file.clone(), ..args.clone() }), Resume::Never);
            assert_eq!(resume(&FlyArgs { record_input: file.clone(), ..args }), Resume::Never);
        }
    }

    #[test]
    fn the_files_that_were_asked_for_are_those_of_the_first_scan_that_is_flown() {
        let before = FlyArgs {
            log: Some(PathBuf::from("l.jsonl")),
            stats: Some(PathBuf::from("s.json")),
            answers: Some(PathBuf::from("a.json")),
            ..FlyArgs::default()
        };
        let args = for_another(before.clone(), Some(PathBuf::from("b.nii")), true);
        assert!(args.log == before.log && args.stats == before.stats && args.answers.is_none());
        assert_eq!(args.input, Some(PathBuf::from("b.nii")));
        assert!(all_written(&before, true).is_ok() && all_written(&FlyArgs::default(), false).is_ok());
        let e = all_written(&before, false).unwrap_err();
        assert!(e.kind == Kind::Incomplete && e.what == "l.jsonl", "{e}");
    }
    /// Opens a scan in a window, as far as that goes without one.
    fn opened(args: &FlyArgs) -> Result<window::Ready> {
        let (program, global) = (Program::default(), Global::default());
        let scene = scene(&program, args, &global, Screen::Window).unwrap();
        let opening = opening(&program, args, &global, scene, false, &Arc::default(), Rc::default()).unwrap();
        (opening.prepare)(&Arc::new(Progress::new()))
    }

    /// The case stays the same: only the flight through it is another.
    #[test]
    fn the_whole_colon_is_read_from_the_rectum_without_tag_at_the_speed_of_reading() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("tagged.nii");
        let (_, volume) = shared(&PhantomSettings { fluid: true, ..PhantomSettings::embedded(1) });
        io::save(&file, &volume, &Progress::new()).unwrap();
        let args = FlyArgs { input: Some(file), ..FlyArgs::default() };
        let open = |is_whole: bool| {
            let (program, global) = (Program::default(), Global::default());
            let scene = scene(&program, &args, &global, Screen::Window).unwrap();
            let opening = opening(&program, &args, &global, scene, is_whole, &Arc::default(), Rc::default()).unwrap();
            assert_eq!(opening.resume == Resume::Nothing, is_whole);
            (opening.prepare)(&Arc::new(Progress::new())).unwrap()
        };
        let (usual, whole) = (open(false), open(true));
        assert_eq!(
            (usual.flight.setup().scene.guide_name(), usual.flight.setup().cleansed.is_some()),
            ("tentacles", false)
        );
        let setup = whole.flight.setup();
        assert!(setup.scene.guide_name() == WHOLE && setup.cleansed.as_ref().is_some_and(|c| !c.changes.is_empty()));
        assert_eq!(usual.session_file(), whole.session_file());
        assert!(whole.notes.iter().any(|n| n.starts_with("removed ")), "{:?}", whole.notes);
        let mut flight = whole.flight;
        assert!(!flight.setup().is_reversed());
        flight.step().unwrap();
        let speed = flight.camera::<Hand>().unwrap().speed * flight.setup().scene.cruise_mm_s();
        assert!((speed - READING_MM_S).abs() < 1e-6, "{speed} mm/s");
    }

    #[test]
    fn a_scan_without_a_colon_is_looked_at_and_flown_from_where_the_reader_starts() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("tissue.nii");
        let bubble = DVec3::new(30.0, 24.0, 20.0);
        let grid = Grid::new([48, 48, 40], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let at = |n: usize| DVec3::new((n % 48) as f64, (n / 48 % 48) as f64, (n / (48 * 48)) as f64);
        let data = (0..48 * 48 * 40).map(|n| if at(n).distance(bubble) < 6.0 { -1000 } else { 40 }).collect();
        io::save(&file, &Volume::new(grid, data), &Progress::new()).unwrap();
        let args = FlyArgs { input: Some(file), ..FlyArgs::default() };
        let shown = opened(&args).unwrap();
        assert!(!shown.flight.setup().scene.moves());
        let unflown = shown.unflown.unwrap();
        assert_eq!(unflown.why.kind, Kind::Incomplete);
        // Unattended flights fail as they do without a window.
        let timed = opened(&FlyArgs { seconds: Some(1.0), ..args }).map(drop).unwrap_err();
        assert_eq!(timed.to_string(), unflown.why.to_string());
        // In gas a flight starts there, and elsewhere the slices stay.
        let begin = |place| (unflown.start_at)(place)(&Arc::new(Progress::new())).unwrap();
        let flown = begin(bubble);
        assert!(flown.unflown.is_none() && flown.flight.setup().scene.moves());
        assert!(flown.flight.pose().position.distance(bubble) < 1.0);
        let again = begin(DVec3::splat(5.0));
        assert!(again.unflown.is_some_and(|u| u.why.why.contains("no lumen within")));
    }
}
