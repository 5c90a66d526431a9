//! What each event of a flight resets, and what it keeps, in each state of the flight.

use std::sync::{Arc, OnceLock};

use bevy_ecs::prelude::*;
use colvis::app::explain::explain;
use colvis::app::plan::{self, Plan};
use colvis::app::{FlightApp, ImageSettings, Scene, Steering};
use colvis::components::camera::{Heading, Pose, Velocity};
use colvis::components::flight::{Flight, Flown, State, Watch};
use colvis::components::guide::{MineField, Planned};
use colvis::components::input::{Command, FlightCommand, Hand, HandCommand};
use colvis::components::output::{Follows, LogLine, Picture};
use colvis::components::play::{Direction, Playback};
use colvis::components::trail::Trail;
use colvis::dynamics::mines::MineSettings;
use colvis::dynamics::monitor::MonitorSettings;
use colvis::dynamics::rescue::{Rescue, RescueAction};
use colvis::dynamics::trap::TentacleReading;
use colvis::fields::{Lumen, lumen};
use colvis::host::headless::{self, Outputs};
use colvis::progress::Progress;
use colvis::render::presets::BUILT_IN;
use colvis::render::{Light, PreparedVolume, Preset, Quality, Settings, TransferFunction, psnr};
use colvis::schedule::{App, FlightSystems, LeftOut, Main};
use colvis::volume::{Grid, Volume};
use glam::{DMat3, DVec3};

/// Creates a square tube of 20 mm along y, with its lumen of one segment.
fn tube() -> (PreparedVolume, Arc<Lumen>) {
    static TUBE: OnceLock<(PreparedVolume, Arc<Lumen>)> = OnceLock::new();
    let made = TUBE.get_or_init(|| {
        let grid = Grid::new([32, 80, 32], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let inside =
            |n: usize| [(n % 32, 6..26), (n / 32 % 80, 4..76), (n / 2560, 6..26)].iter().all(|(i, r)| r.contains(i));
        let data = (0..grid.len()).map(|n| if inside(n) { -1000 } else { 40 }).collect();
        let volume = Arc::new(Volume::new(grid, data));
        let lumen = Arc::new(lumen::find(&volume, &Progress::new()).unwrap());
        assert_eq!(lumen.segments.len(), 1);
        (PreparedVolume::new(volume, TransferFunction::default()), lumen)
    });
    made.clone()
}

/// Creates a flight from y = 14 to y = 70 mm in the tube, on a path that counts as 60 mm long.
fn set_out(scene: Scene) -> FlightApp {
    let [start, goal, end] = [14.0, 70.0, 8.0].map(|y| DVec3::new(16.0, y, 16.0));
    let mut plan = Plan { begin: end, segment: Some(0), ..Plan::between(start, goal, 60.0) };
    plan.ends[0].at = end;
    let (volume, lumen) = tube();
    FlightApp::new(volume, lumen, plan, scene).unwrap()
}

fn scene(guide: &'static str) -> Scene {
    let image = ImageSettings { width: 16, height: 12, ..ImageSettings::default() };
    Scene { operator: true, log: true, picture: true, image, ..Scene::guided_by(guide) }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    Flying,
    Arrived,
    /// The operator was called, after an attempt at recovery.
    Called,
    Ended,
    Paused,
    /// The guide looks for another direction to leave a trap.
    Escaping,
}

const STAGES: [Stage; 6] = [Stage::Flying, Stage::Arrived, Stage::Called, Stage::Paused, Stage::Ended, Stage::Escaping];

/// Everything that an event may reset.
#[derive(Clone, Debug, PartialEq)]
struct All {
    state: State,
    reason: String,
    place: DVec3,
    length_mm: f64,
    turns: u32,
    escapes: u32,
    /// True while a recovery is under way, and how often the flight turned round because it had set out wrongly.
    rescue: (bool, u32),
    mines: Vec<DVec3>,
    share: f64,
    calls: Vec<f64>,
    heading: DVec3,
    velocity: DVec3,
    done: Vec<usize>,
    jumps: Option<u32>,
    paused: bool,
    fov_degrees: f64,
    left_out: Vec<LeftOut>,
}

fn all(f: &FlightApp) -> All {
    let Flight { state, reason, place, length_mm, turns, escapes } = f.flight();
    let (trail, rescue) = (f.survey().trail().unwrap(), &f.camera::<Watch>().unwrap().rescue);
    All {
        state,
        reason,
        place,
        length_mm,
        turns,
        escapes,
        rescue: (rescue.is_escaping(), rescue.turns()),
        mines: f.camera::<MineField>().map_or_else(Vec::new, |m| m.mines.iter().collect()),
        share: trail.share(),
        calls: trail.calls().to_vec(),
        heading: f.camera::<Heading>().unwrap().0,
        velocity: f.camera::<Velocity>().unwrap().0,
        done: f.camera::<Flown>().unwrap().done.clone(),
        jumps: f.camera::<Planned>().map(|p| p.jumps),
        paused: f.camera::<Hand>().unwrap().paused,
        fov_degrees: f.camera::<Picture>().unwrap().fov_degrees,
        left_out: explain(f).left_out,
    }
}

/// Returns a recovery that has just begun to look for another direction, after a flight along +x.
fn escaping() -> Rescue {
    let directions = [DVec3::X, DVec3::Y, DVec3::NEG_Y, DVec3::NEG_X];
    let lengths = [80.0, 10.0, 10.0, 90.0];
    let reading = TentacleReading { directions: &directions, lengths: &lengths, heading: DVec3::X, radius_mm: 1.5 };
    let mut r = Rescue::default();
    let began = (0..600).any(|n| {
        let at = DVec3::X * 30.0 * (f64::from(n) / 120.0).min(3.0);
        r.follow(at, 1.0 / 120.0, Some(&reading), None, &MonitorSettings::default()) != RescueAction::GoOn
    });
    assert!(began && r.is_escaping());
    r
}

/// Brings a flight into a state, after it has flown for a second, turned, escaped, called and laid mines.
fn bring(guide: &'static str, stage: Stage) -> FlightApp {
    let mut f = set_out(scene(guide));
    for _ in 0..120 {
        f.step().unwrap();
    }
    if stage == Stage::Paused {
        f.act(HandCommand::Pause(true)).unwrap();
        f.step().unwrap();
    }
    let (state, reason) = match stage {
        Stage::Flying | Stage::Paused | Stage::Escaping => (State::Flying, ""),
        Stage::Arrived => (State::Arrived, ""),
        Stage::Called => (State::Operator, "the guide is confused"),
        Stage::Ended => (State::Ended, ""),
    };
    let mut flight = f.camera_mut::<Flight>().unwrap();
    assert_eq!(flight.state, State::Flying);
    *flight = Flight { state, reason: reason.to_owned(), place: DVec3::ONE, turns: 1, escapes: 2, ..flight.clone() };
    if matches!(stage, Stage::Called | Stage::Escaping) {
        f.camera_mut::<Watch>().unwrap().rescue = escaping();
    }
    let at = f.pose().position;
    if let Some(mut field) = f.camera_mut::<MineField>() {
        field.mines.lay_behind(at, DVec3::Y, &MineSettings::default());
    }
    let mut trail = f.camera_mut::<Trail>().unwrap();
    trail.call();
    assert!(trail.share() > 0.2 && trail.share() < 0.8, "{}", trail.share());
    f
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Change {
    Guide,
    Reverse,
    Segment,
    OtherEnd,
    Seek,
    Go,
    ViewAngle,
    Pause,
    Continue,
    Push,
    Resume,
    EndOfTime,
}

use Change::{Continue, EndOfTime, Go, Guide, OtherEnd, Pause, Push, Resume, Reverse, Seek, Segment, ViewAngle};

const EVENTS: [Change; 12] =
    [Guide, Reverse, Segment, OtherEnd, Seek, Go, ViewAngle, Pause, Continue, Push, Resume, EndOfTime];

/// The share of the path that [`Change::Seek`] goes to.
const SOUGHT: f64 = 0.1;
const THERE: DVec3 = DVec3::new(15.0, 22.0, 17.0);

fn other(guide: &str) -> &'static str {
    if guide == "path" { "tentacles" } else { "path" }
}

fn command(event: Change, guide: &str) -> Option<Command> {
    let [to, forward, up] = [THERE, DVec3::new(0.0, -2.0, 0.0), DVec3::Z].map(|v| v.to_array());
    Some(match event {
        Guide => FlightCommand::Guide(other(guide).to_owned()).into(),
        Reverse => FlightCommand::Reverse.into(),
        Segment => FlightCommand::Segment(0).into(),
        OtherEnd => FlightCommand::OtherEnd.into(),
        Seek => FlightCommand::Seek(SOUGHT).into(),
        Go => FlightCommand::Go { to, forward, up }.into(),
        ViewAngle => FlightCommand::ViewAngle(40.0).into(),
        Pause => HandCommand::Pause(true).into(),
        Continue => HandCommand::Pause(false).into(),
        Push => HandCommand::Push([0.0, 1.0, 0.0]).into(),
        Resume => HandCommand::Resume.into(),
        EndOfTime => return None,
    })
}

/// Lets an event happen. One of the operator's hand takes effect in a step, and so does the end of time.
fn happen(f: &mut FlightApp, event: Change, guide: &str) {
    match command(event, guide) {
        None => headless::fly(f, 1.0 / 120.0, &Outputs::default(), &Arc::new(Progress::new())).1.unwrap(),
        Some(command) => {
            let hand = matches!(command, Command::Hand(_));
            f.act(command).unwrap();
            if hand {
                f.step().unwrap();
            }
        }
    }
}

/// The table: what is left after an event, given what was before it in that state, and a fresh flight of each guide.
///
/// What is not named here stays. `after` tells only the pose, what one step has moved, and what is measured, which the
/// test checks separately.
fn left(event: Change, stage: Stage, before: &All, after: &All, f: &FlightApp, fresh: &All) -> All {
    // A flight that has arrived counts its segment as flown, once.
    let done = if stage == Stage::Arrived { vec![0] } else { vec![] };
    let stays = All { done, ..before.clone() };
    // Whoever moves the camera or changes the way flies on.
    let free = All { state: State::Flying, reason: String::new(), ..stays.clone() };
    // A guide that is plugged in anew knows nothing of the way so far. Its number of turns and escapes is the flight's.
    let anew =
        All { rescue: (false, 0), mines: vec![], jumps: fresh.jumps, left_out: fresh.left_out.clone(), ..free.clone() };
    // The operator has taken over: mines and recovery no longer apply, but that the flight had turned round does.
    let taken = |s: All| All { rescue: (false, before.rescue.1), mines: vec![], ..s };
    // A step has moved the body.
    let moved = |s: All| All {
        length_mm: after.length_mm,
        share: after.share,
        heading: after.heading,
        velocity: after.velocity,
        ..s
    };
    let forward = f.pose().attitude.forward;
    let placed =
        All { heading: forward, velocity: DVec3::ZERO, jumps: before.jumps.map(|n| n + 1), ..taken(free.clone()) };
    // Help that was called for has come.
    let answered = if stage == Stage::Called { free } else { stays.clone() };
    match event {
        Guide => anew,
        Reverse => All {
            share: 1.0 - before.share,
            calls: before.calls.iter().map(|c| 1.0 - c).collect(),
            heading: -before.heading,
            ..anew
        },
        Segment | OtherEnd => All {
            place: DVec3::ZERO,
            length_mm: 0.0,
            turns: 0,
            escapes: 0,
            share: 0.0,
            calls: vec![],
            heading: forward,
            velocity: DVec3::ZERO,
            ..anew
        },
        Seek => All { share: SOUGHT, ..placed },
        Go => All { share: after.share, ..placed },
        ViewAngle => All { fov_degrees: 40.0, ..before.clone() },
        Pause => moved(All { paused: true, ..taken(answered) }),
        Continue => moved(All { paused: false, ..taken(answered) }),
        Push | Resume => moved(taken(answered)),
        EndOfTime => {
            let ends = before.state == State::Flying;
            let (state, place) = if ends { (State::Ended, f.pose().position) } else { (before.state, before.place) };
            // While it is paused, nothing is watched.
            let rescue = if stage == Stage::Paused { (false, before.rescue.1) } else { before.rescue };
            moved(All { state, place, rescue, ..stays })
        }
    }
}

/// Checks what the table leaves to the position of the camera.
fn check_place(event: Change, guide: &str, before: &All, from: Pose, f: &FlightApp, name: &str) {
    let (after, pose) = (all(f), f.pose());
    let near = |a: f64, b: f64, by: f64| assert!((a - b).abs() <= by, "{name}: {a}, not {b}");
    match event {
        Guide | Reverse | ViewAngle => assert_eq!(pose, from, "{name}"),
        Segment | OtherEnd => {
            assert_eq!(pose.position, f.setup().plan.start, "{name}");
            // The segment's cecal end, and the end where the flight had set out.
            let goal = f.setup().plan.goal().at.y;
            let ends = f.setup().lumen.segments[0].ends;
            let to = if event == Segment { ends[1].y } else { 14.0 };
            near(goal, to, 12.0);
        }
        Seek => {
            let y = match f.camera::<Planned>() {
                Some(p) => p.route.place(SOUGHT * p.route.length_mm()).y,
                None => 14.0 + 60.0 * SOUGHT,
            };
            near(pose.position.y, y, 1.5);
        }
        Go => {
            assert_eq!((pose.position, pose.attitude.forward), (THERE, DVec3::NEG_Y), "{name}");
            let share = match f.camera::<Planned>() {
                Some(p) => p.route.nearest(THERE)[0] / p.route.length_mm(),
                None => (THERE.y - 14.0) / 60.0,
            };
            near(after.share, share, 2.0 / 60.0);
        }
        Pause | Continue | Push | Resume | EndOfTime => {
            near(after.length_mm - before.length_mm, pose.position.distance(from.position), 1e-9);
            assert!(pose.position.distance(from.position) < 0.5, "{name}");
            if before.state == State::Arrived {
                assert_eq!(after.share, 1.0, "{name}");
            } else {
                near(after.share, before.share, 0.02);
            }
            if event == Push {
                assert!(after.heading.dot(from.attitude.up) > 0.9, "{name}: it goes where it is pushed");
            } else {
                assert!(after.heading.dot(before.heading) > 0.99, "{name}");
            }
        }
    }
    if let Some(p) = f.camera::<Planned>().filter(|_| guide == "path") {
        assert!(p.s_mm >= 0.0 && p.s_mm <= p.route.length_mm(), "{name}");
    }
}

#[test]
#[ignore = "slow: every event in every state, for two guides"]
fn each_event_resets_in_each_state_what_it_should_and_nothing_else() {
    let stages: [(&str, &[Stage]); 2] = [("tentacles", &STAGES), ("path", &STAGES[..4])];
    std::thread::scope(|threads| {
        for (guide, stages) in stages {
            threads.spawn(move || check_table(guide, stages));
        }
    });
}

/// Checks every row of the table for flights by a guide.
fn check_table(guide: &'static str, stages: &[Stage]) {
    let fresh = [guide, other(guide)].map(|g| all(&set_out(scene(g))));
    for &stage in stages {
        for event in EVENTS {
            let name = format!("{event:?} while {stage:?} by {guide}");
            let mut f = bring(guide, stage);
            let (before, from) = (all(&f), f.pose());
            assert_eq!((before.calls.len(), before.paused), (1, stage == Stage::Paused), "{name}");
            happen(&mut f, event, guide);
            let after = all(&f);
            let fresh = &fresh[usize::from(event == Guide)];
            assert_eq!(after, left(event, stage, &before, &after, &f, fresh), "{name}");
            check_place(event, guide, &before, from, &f, &name);
            // It goes on from there: the plan, if there is one, is where the camera is.
            f.step().unwrap();
            let after = all(&f);
            assert_eq!(after.paused, if event == Continue { false } else { event == Pause || before.paused }, "{name}");
            if let Some(p) = f.camera::<Planned>() {
                let off = p.route.place(p.s_mm).distance(f.pose().position);
                assert!(off < 3.0, "{name}: the plan is {off} mm off");
                let share = if after.state == State::Arrived { 1.0 } else { p.s_mm / p.route.length_mm() };
                assert!((after.share - share).abs() < 1e-9, "{name}: {} {share}", after.share);
            }
        }
    }
}

/// A log is shown to its end. Only its position, its pace and the view can be changed.
#[test]
fn a_log_that_is_played_keeps_its_way() {
    let line = |n: i32| LogLine {
        t: f64::from(n) / 120.0,
        position: [16.0, 14.0 + 0.25 * f64::from(n), 16.0],
        forward: [0.0, 1.0, 0.0],
        up: [0.0, 0.0, 1.0],
        velocity: [0.0, 30.0, 0.0],
        clearance_mm: 5.0,
        state: if n == 200 { State::Arrived } else { State::Flying },
        guide: "path".to_owned(),
    };
    let play = Playback::new((0..=200).map(line).collect(), 1.0, Direction::Forwards).unwrap();
    let (volume, lumen) = tube();
    let logged = plan::as_logged(&play);
    let scene = Scene { steering: Steering::Log(play), ..scene("tentacles") };
    let begin = || {
        let mut f = FlightApp::new(volume.clone(), Arc::clone(&lumen), logged.clone(), scene.clone()).unwrap();
        for _ in 0..40 {
            f.step().unwrap();
        }
        f
    };
    // Position, share of the log, length flown, state, reason.
    let told = |f: &FlightApp| {
        let (p, l) = (f.pose().position, f.flight());
        (p, f.camera::<Playback>().unwrap().share(), l.length_mm, l.state, l.reason, explain(f).left_out)
    };
    let left_out = told(&begin()).5;
    for event in EVENTS {
        for state in [State::Flying, State::Arrived, State::Ended] {
            let name = format!("{event:?} while a log is {state:?}");
            let mut f = begin();
            let before = told(&f);
            assert!((before.0.y - 24.0).abs() < 1e-9 && (before.1 - 0.2).abs() < 1e-9 && before.3 == State::Flying);
            f.camera_mut::<Flight>().unwrap().state = state;
            match event {
                Guide | Reverse | Segment | OtherEnd | Go => {
                    let e = f.act(command(event, "path").unwrap()).unwrap_err().to_string();
                    assert!(e.contains("replays a log"), "{name}: {e}");
                    assert_eq!(
                        told(&f),
                        (before.0, before.1, before.2, state, String::new(), left_out.clone()),
                        "{name}"
                    );
                }
                Seek => {
                    happen(&mut f, event, "path");
                    let there = told(&f);
                    assert!((there.0.y - 19.0).abs() < 1e-9 && (there.1 - SOUGHT).abs() < 1e-9, "{name}: {there:?}");
                    assert_eq!((there.2, there.3), (before.2, State::Flying), "{name}: it plays on");
                    f.step().unwrap();
                    assert!((f.pose().position.y - 19.25).abs() < 1e-9, "{name}");
                }
                _ => {
                    happen(&mut f, event, "path");
                    let after = told(&f);
                    let moves = state == State::Flying && !matches!(event, Pause | ViewAngle);
                    let y = if moves { 24.25 } else { 24.0 };
                    assert!((after.0.y - y).abs() < 1e-9, "{name}: {after:?}");
                    let ends = event == EndOfTime && state == State::Flying;
                    assert_eq!(after.3, if ends { State::Ended } else { state }, "{name}");
                    assert_eq!((f.camera::<Picture>().unwrap().fov_degrees == 40.0), event == ViewAngle, "{name}");
                    assert!(after.5 == left_out, "{name}");
                }
            }
        }
    }
    let mut f = begin();
    for _ in 0..200 {
        f.step().unwrap();
    }
    assert_eq!((f.flight().state, f.flight().place), (State::Arrived, DVec3::new(16.0, 64.0, 16.0)));
}

/// Returns the picture from a pose with settings that were always those.
fn fresh_picture(image: ImageSettings, pose: &Pose) -> colvis::render::Frame {
    let mut f = set_out(Scene { image, ..scene("tentacles") });
    assert!(f.place(pose.position, pose.attitude.forward, pose.attitude.up));
    f.frame().unwrap();
    f.camera::<Picture>().unwrap().frame.clone()
}

#[test]
fn settings_that_change_in_flight_make_the_pictures_of_a_fresh_flight() {
    let usual = ImageSettings { width: 32, height: 24, ..ImageSettings::default() };
    let mut f = set_out(Scene { image: usual.clone(), ..scene("tentacles") });
    let settings = |quality| Settings::new(quality);
    let light = Settings { light: Light::ENDOSCOPE, ..settings(Quality::High) };
    let mut all: Vec<(ImageSettings, bool)> =
        BUILT_IN.map(|preset| (ImageSettings { preset, ..usual.clone() }, preset != usual.preset)).to_vec();
    for settings in [settings(Quality::Low), settings(Quality::Reference), light] {
        all.push((ImageSettings { settings, ..usual.clone() }, true));
    }
    // The renderer stays, and may go on from what it has seen.
    all.push((usual.clone(), true));
    all.push((ImageSettings { width: 20, height: 28, ..usual }, false));
    all.push((ImageSettings { fov_degrees: 50.0, ..usual }, false));
    all.push((usual, false));
    for (image, same) in all {
        for _ in 0..6 {
            f.step().unwrap();
        }
        f.frame().unwrap();
        f.act(FlightCommand::ViewAngle(image.fov_degrees)).unwrap();
        let mut picture = f.camera_mut::<Picture>().unwrap();
        (picture.preset, picture.settings) = (image.preset, image.settings);
        picture.frame.resize(image.width, image.height);
        // Without being asked for: what has changed is traced.
        f.views().render_due().unwrap();
        let picture = f.camera::<Picture>().unwrap();
        let fresh = fresh_picture(image.clone(), &f.pose());
        assert!(picture.frame == fresh || !same && psnr(&picture.frame, &fresh) > 45.0, "{image:?}");
    }
    assert_eq!(f.camera::<Picture>().unwrap().preset, Preset::default());
}

#[test]
fn a_speed_or_a_guide_that_changes_in_flight_makes_the_steps_of_a_fresh_flight() {
    let place = |f: &mut FlightApp| {
        let [to, forward, up] = [THERE, DVec3::Y, DVec3::Z].map(|v| v.to_array());
        f.act(FlightCommand::Go { to, forward, up }).unwrap();
        f.take_log();
    };
    let steps = |f: &mut FlightApp| {
        place(f);
        (0..120).for_each(|_| f.step().unwrap());
        let lines = f.take_log().into_iter();
        lines.map(|l| (l.position, l.forward, l.velocity, l.clearance_mm, l.state, l.guide)).collect::<Vec<_>>()
    };
    let all = ["tentacles", "potential", "path", "manual"];
    for (guide, then) in all.into_iter().zip(all.into_iter().cycle().skip(1)) {
        let ends = [1.0, 2.0].map(|speed| {
            let mut changed = set_out(scene(guide));
            (0..60).for_each(|_| changed.step().unwrap());
            changed.act(HandCommand::Speed(speed)).unwrap();
            changed.act(FlightCommand::Guide(then.to_owned())).unwrap();
            let mut fresh = set_out(scene(then));
            fresh.act(HandCommand::Speed(speed)).unwrap();
            let (changed, fresh) = (steps(&mut changed), steps(&mut fresh));
            assert_eq!(changed.len(), 120);
            let first = changed.iter().zip(&fresh).position(|(a, b)| a != b);
            assert_eq!(first, None, "{guide} to {then} at {speed}: {:?}", first.map(|n| (&changed[n], &fresh[n])));
            changed[119].0[1] - THERE.y
        });
        assert!(then == "manual" || ends[0] > 2.0 && ends[1] > ends[0] + 1.0, "{then}: {ends:?}");
    }
}

/// The last valid pose is that after the jump, not the one before.
#[test]
fn a_camera_that_is_lost_after_a_jump_is_put_back_where_it_had_jumped_to() {
    #[derive(Resource)]
    struct Lose(bool);
    let loses = |app: &mut App| {
        app.world.insert_resource(Lose(false));
        app.add_systems(FlightSystems::Clock, |lose: Res<Lose>, mut pose: Single<&mut Pose, With<Main>>| {
            if lose.0 {
                pose.position = DVec3::NAN;
            }
        });
        Ok(())
    };
    for event in [Seek, Go, Segment, OtherEnd] {
        let mut f = set_out(scene("tentacles").plug(("loses", loses)).unwrap());
        for _ in 0..120 {
            f.step().unwrap();
        }
        happen(&mut f, event, "tentacles");
        let there = f.pose();
        f.app_mut().world.insert_resource(Lose(true));
        f.step().unwrap();
        assert_eq!(f.pose(), there, "{event:?}");
    }
}

/// A window asks before each frame which of the views beside its own would change.
#[test]
fn views_are_marked_that_would_change_and_no_others() {
    let mut f = set_out(scene("manual"));
    let camera = f.app().camera_id();
    let sharp = || {
        let mut picture = Picture::new(12, 8);
        picture.settings.adaptive = false;
        picture
    };
    let here = f.pose();
    let still = f.views().add((sharp(), here)).unwrap();
    let rear = f.views().add((sharp(), Follows { whom: Some(camera), ..Follows::rear() })).unwrap();
    let unnamed = f.views().add((sharp(), Follows::rear())).unwrap();
    let of_other = f.views().add((sharp(), Follows { whom: Some(still), ..Follows::rear() })).unwrap();
    let views = [still, rear, unnamed, of_other];
    let due = |f: &FlightApp, e: Entity| f.app().world.get::<Picture>(e).unwrap().due;
    /// Marks, checks which are marked, and renders them.
    fn marks(f: &mut FlightApp, views: [Entity; 4], expected: [bool; 4], what: &str) {
        assert_eq!(f.views().mark_unfinished(), expected.contains(&true), "{what}");
        let marked = views.map(|e| f.app().world.get::<Picture>(e).unwrap().due);
        assert_eq!(marked, expected, "{what}");
        f.views().render_due().unwrap();
    }
    f.frame().unwrap();
    // What another entity does is not known here, so whatever follows it is rendered again.
    marks(&mut f, views, [false, false, false, true], "nothing has changed");
    assert!(f.place(THERE, DVec3::Y, DVec3::Z));
    marks(&mut f, views, [false, true, true, true], "the camera has moved");
    assert!(f.place(THERE, DVec3::X, DVec3::Z));
    marks(&mut f, views, [false, true, true, true], "the camera has turned");
    assert!(!due(&f, camera), "the camera's own is marked by the window");
    f.app_mut().world.get_mut::<Pose>(still).unwrap().position.x += 1.0;
    marks(&mut f, views, [true, false, false, true], "a view has moved");
    f.app_mut().world.get_mut::<Picture>(rear).unwrap().fov_degrees = 60.0;
    marks(&mut f, views, [false, true, false, true], "a view's angle has changed");
    f.app_mut().world.get_mut::<Picture>(unnamed).unwrap().settings = Settings::new(Quality::Low);
    marks(&mut f, views, [false, false, true, true], "a view's quality has changed");
    f.app_mut().world.get_mut::<Picture>(still).unwrap().preset = Preset::named("lean").unwrap();
    marks(&mut f, views, [true, false, false, true], "a view's preset has changed");
    f.app_mut().world.get_mut::<Picture>(still).unwrap().frame.resize(9, 9);
    marks(&mut f, views, [true, false, false, true], "a view's size has changed");
    f.app_mut().world.entity_mut(of_other).despawn();
    assert!(!f.views().mark_unfinished(), "nothing is left to do");
}
