//! Operator changes during a flight: its direction, its guide, the camera's place on the path; and the points between
//! which it is flown.

use std::sync::Arc;

use colvis::app::plan::{self, FlightRequest, Place, Plan};
use colvis::app::{FlightApp, ImageSettings, Scene, Steering};
use colvis::components::camera::Pose;
use colvis::components::flight::State;
use colvis::components::input::{FlightCommand, HandCommand};
use colvis::components::output::{LogLine, Picture};
use colvis::components::play::{Direction, Playback};
use colvis::error::Result;
use colvis::fields::{Lumen, lumen};
use colvis::phantom::{PhantomSettings, Size};
use colvis::progress::Progress;
use colvis::render::presets::BUILT_IN;
use colvis::render::{PreparedVolume, TransferFunction, psnr};
use colvis::volume::{Grid, Volume};
use glam::{DMat3, DVec3};

use crate::support::checks::cases;
use crate::support::flights::{fly, jerk};
use crate::support::logs::place;
use crate::support::phantom::phantom;
use crate::support::run::run;

fn scene(guide: &'static str) -> Scene {
    Scene { log: true, operator: true, ..Scene::guided_by(guide) }
}

/// Returns the small phantom with a plan from end to end.
fn small() -> (PreparedVolume, Lumen, Plan) {
    let (volume, _) = phantom(&PhantomSettings { size: Size::Small, seed: 1, ..PhantomSettings::default() });
    let progress = Progress::new();
    let volume = PreparedVolume::new(Arc::new(volume), TransferFunction::default());
    let lumen = lumen::find(volume.voxels(), &progress).unwrap();
    let plan =
        plan::plan(&volume, &lumen, &FlightRequest::default(), Scene::default().body.radius_mm, &progress).unwrap();
    (volume, lumen, plan)
}

/// A goal beyond the gas calls for the operator at the end of the gas, while the end where the flight began is simply
/// reached. In both cases the segment counts as flown, whatever the operator does next.
#[test]
#[ignore = "slow: a whole flight"]
fn a_flight_turned_round_arrives_and_its_segment_counts_as_flown() {
    let (volume, mut lumen, mut plan) = small();
    let again = lumen.segments[0].clone();
    lumen.segments.push(again);
    plan.ends[1].missed = Some("the cecum lies elsewhere".to_owned());
    let lumen = Arc::new(lumen);
    for goal_missed in [true, false] {
        let (volume, lumen, plan) = (volume.clone(), Arc::clone(&lumen), plan.clone());
        let mut f = FlightApp::new(volume, lumen, plan, scene("path")).unwrap();
        if goal_missed {
            f.act(FlightCommand::Seek(0.97)).unwrap();
            fly(&mut f, 20.0);
            assert_eq!(f.flight().state, State::Operator);
            assert!(f.flight().reason.contains("the cecum lies elsewhere"), "{}", f.flight().reason);
        } else {
            f.act(FlightCommand::Reverse).unwrap();
            f.act(FlightCommand::Seek(0.97)).unwrap();
            fly(&mut f, 20.0);
            assert_eq!(f.flight().state, State::Arrived, "{}", f.flight().reason);
            f.act(FlightCommand::Reverse).unwrap();
            assert!(f.setup().plan.goal().missed.is_some());
        }
        f.act(FlightCommand::Seek(0.5)).unwrap();
        f.act(FlightCommand::Segment(1)).unwrap();
        assert!(f.survey().unflown().is_empty(), "{goal_missed}: {:?}", f.survey().unflown());
    }
}

/// Without a plan the path bar counts the distance flown, reversed after the flight was turned round.
#[test]
#[ignore = "slow: most of a flight"]
fn seeking_without_a_plan_goes_where_the_bar_shows() {
    let (volume, lumen, plan) = small();
    let length = plan.length_mm;
    let mut f = FlightApp::new(volume, Arc::new(lumen), plan, scene("tentacles")).unwrap();
    let mut places = Vec::new();
    while f.flight().length_mm < 0.9 * length {
        f.step().unwrap();
        assert_eq!(f.flight().state, State::Flying, "{}", f.flight().reason);
        places.push((f.flight().length_mm / length, f.pose().position));
    }
    let there = |share: f64| places[places.partition_point(|p| p.0 < share)].1;
    f.act(FlightCommand::Reverse).unwrap();
    for share in [0.2, 0.6, 0.9] {
        f.act(FlightCommand::Seek(share)).unwrap();
        let off = f.pose().position.distance(there(1.0 - share));
        assert!(off < 0.9, "{share}: {off} mm off");
    }
    // The flight continues from there. On a leg that overlaps the previous one, the last leg counts.
    for _ in 0..120 {
        f.step().unwrap();
    }
    assert!(f.act(FlightCommand::Seek(0.05)).is_err(), "the flight was turned round before it came there");
    f.act(FlightCommand::Reverse).unwrap();
    f.act(FlightCommand::Seek(0.5)).unwrap();
    assert!(f.pose().position.distance(there(0.5)) < 0.9);
    // A new path begins at its own start.
    f.act(FlightCommand::OtherEnd).unwrap();
    let start = f.pose().position;
    assert!(f.act(FlightCommand::Seek(0.5)).is_err());
    for _ in 0..360 {
        f.step().unwrap();
    }
    f.act(FlightCommand::Seek(0.0)).unwrap();
    assert!(f.pose().position.distance(start) < 0.012);
}

/// The plan is joined smoothly whatever the body's motion: in flight, after a jump, and after turning round.
#[test]
fn a_plan_is_taken_up_without_a_jolt() {
    let (volume, lumen, plan) = small();
    let mut f = FlightApp::new(volume, Arc::new(lumen), plan, scene("tentacles")).unwrap();
    let go = |f: &mut FlightApp, command: Option<FlightCommand>, steps: usize| {
        command.into_iter().for_each(|c| f.act(c).unwrap());
        f.take_log();
        (0..steps).for_each(|_| f.step().unwrap());
        f.take_log()
    };
    go(&mut f, None, 360);
    let mut before = go(&mut f, None, 3);
    let after = go(&mut f, Some(FlightCommand::Guide("path".to_owned())), 240);
    before.extend(after);
    let changed = jerk(&before);
    // At cruise speed, where a velocity difference to a body at rest would be an acceleration of thousands.
    let sought = jerk(&go(&mut f, Some(FlightCommand::Seek(0.5)), 240));
    let mut before = go(&mut f, None, 3);
    before.extend(go(&mut f, Some(FlightCommand::Reverse), 240));
    let turned = jerk(&before);
    println!("jerk: guide changed {changed:.0}, sought {sought:.0}, turned round {turned:.0} mm/s³");
    assert!(changed < 6000.0 && sought < 300.0 && turned < 4600.0, "{changed} {sought} {turned}");
}

/// Creates gas in tissue, with the colon elsewhere.
fn elsewhere(gas: impl Fn(DVec3) -> bool) -> (PreparedVolume, Lumen) {
    let grid = Grid::new([80, 40, 40], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
    let place = |n: usize| DVec3::new((n % 80) as f64, (n / 80 % 40) as f64, (n / 3200) as f64);
    let data = (0..grid.len()).map(|n| if gas(place(n)) { -1000 } else { 40 }).collect();
    let volume = PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default());
    let none = Lumen::none(volume.voxels().grid());
    (volume, none)
}

/// Plans through that gas from one end.
fn between(volume: &PreparedVolume, colon: &Lumen, to: DVec3) -> Result<Plan> {
    let from = DVec3::new(15.0, 20.0, 20.0);
    let request =
        FlightRequest { from: Some(Place::World(from)), to: Some(Place::World(to)), ..FlightRequest::default() };
    plan::plan(volume, colon, &request, 1.5, &Progress::new())
}

/// If the path to the goal is too narrow for the camera, the user is told before it gets stuck.
#[test]
fn a_way_that_is_too_narrow_is_told_of() {
    for (narrow, said) in [(2.0, 1), (7.0, 0)] {
        let (volume, colon) = elsewhere(|p| {
            let radius = if (33.0..37.0).contains(&p.x) { narrow } else { 7.0 };
            p.x > 10.0 && p.x < 60.0 && (p.y - 20.0).hypot(p.z - 20.0) < radius
        });
        let plan = between(&volume, &colon, DVec3::new(55.0, 20.0, 20.0)).unwrap();
        let mut f = FlightApp::new(volume, Arc::new(colon), plan, scene("potential")).unwrap();
        let notes = f.take_notes();
        println!("{notes:?}");
        assert_eq!(notes.len(), said, "{notes:?}");
        assert!(f.take_notes().is_empty(), "once");
    }
}

/// A goal is moved into gas that is not part of the colon within 5 mm, and refused beyond that.
#[test]
fn a_goal_in_tissue_is_refused_in_gas_of_any_kind() {
    let gas = |p: DVec3| p.x > 10.0 && p.x < 60.0 && (p.y - 20.0).hypot(p.z - 20.0) < 7.0;
    let (volume, colon) = elsewhere(gas);
    let plan = |to: DVec3| between(&volume, &colon, to);
    let inside = DVec3::new(50.3, 21.0, 19.0);
    let p = plan(inside).unwrap();
    assert!(p.gas.is_some() && p.goal().at == inside && p.notes.is_empty(), "{:?}", p.notes);
    let p = plan(DVec3::new(62.0, 20.0, 20.0)).unwrap();
    assert!(gas(p.goal().at) && p.notes.len() == 1 && p.goal().missed.is_none(), "{:?} {:?}", p.goal().at, p.notes);
    for to in [DVec3::new(70.0, 20.0, 20.0), DVec3::new(30.0, 35.0, 20.0), DVec3::splat(1e4), DVec3::NAN] {
        let e = plan(to).unwrap_err();
        assert!(e.kind as i32 == 4 && e.to_string().contains("--to"), "{to}: {e}");
    }
}

/// A log follows its own path. It cannot be turned round, but you can look around while it plays and while it is
/// paused.
#[test]
fn a_log_that_is_played_is_looked_around_in() {
    let (volume, _, plan) = small();
    let line = |n: i32| LogLine {
        t: f64::from(n) / 120.0,
        position: plan.start.to_array(),
        forward: [0.0, 1.0, 0.0],
        up: [0.0, 0.0, 1.0],
        velocity: [0.0; 3],
        clearance_mm: 5.0,
        state: State::Flying,
        guide: "path".to_owned(),
    };
    let play = Playback::new((1..2400).map(line).collect(), 1.0, Direction::Forwards).unwrap();
    let none = Arc::new(Lumen::none(volume.voxels().grid()));
    let logged = plan::as_logged(&play);
    let scene = Scene { steering: Steering::Log(play), ..scene("tentacles") };
    let mut f = FlightApp::new(volume, none, logged, scene).unwrap();
    assert!(f.act(FlightCommand::Reverse).unwrap_err().to_string().contains("replays a log"));
    let mut turned = 0.0;
    for paused in [false, true] {
        f.act(HandCommand::Pause(paused)).unwrap();
        f.act(HandCommand::Turn([1.0, 0.0, 0.0])).unwrap();
        for _ in 0..60 {
            f.step().unwrap();
        }
        // 1.2 rad/s to the right for half a second each time.
        turned += 0.6;
        let right = f.camera::<Pose>().unwrap().attitude.forward.x;
        assert!((right - f64::sin(turned)).abs() < 1e-9, "{right} after {turned} rad");
    }
    f.act(HandCommand::Turn([0.0; 3])).unwrap();
    f.act(HandCommand::Pause(false)).unwrap();
    for _ in 0..200 {
        f.step().unwrap();
    }
    assert!(f.pose().attitude.forward.distance(DVec3::Y) < 1e-12, "then the view is the log's again");
    assert!(place(f.take_log().last().unwrap()) == plan.start);
}

/// The operator rolls an assisted flight by keys and by mouse. Except for the roll, the flight is the same to the last
/// bit. The roll stays when the operator releases control, and the view keeps following the path meanwhile.
#[test]
#[ignore = "slow: four flights of 9 s"]
fn a_roll_is_the_operators_and_stays() {
    let (volume, lumen, plan) = small();
    let lumen = Arc::new(lumen);
    for guide in ["tentacles", "path"] {
        let flown = |rolls: bool| {
            let mut f = FlightApp::new(volume.clone(), Arc::clone(&lumen), plan.clone(), scene(guide)).unwrap();
            let mut log = fly(&mut f, 2.0);
            if rolls {
                f.act(HandCommand::Roll(20.0)).unwrap();
                f.act(HandCommand::Turn([0.0, 0.0, 1.0])).unwrap();
            }
            log.extend(fly(&mut f, 1.0));
            if rolls {
                f.act(HandCommand::Turn([0.0; 3])).unwrap();
            }
            log.extend(fly(&mut f, 6.0));
            log
        };
        let (straight, rolled) = (flown(false), flown(true));
        assert_eq!(straight.len(), rolled.len());
        let vector = DVec3::from_array;
        let (mut swing, mut last) = (0.0f64, 0.0);
        for (a, b) in straight.iter().zip(&rolled) {
            assert_eq!(
                (a.position, a.clearance_mm, a.state),
                (b.position, b.clearance_mm, b.state),
                "{guide}: {}",
                a.t
            );
            let off = vector(a.forward).angle_between(vector(b.forward));
            // A spinning body swings a little while it turns, as a gyroscope does.
            assert!(off < 0.1, "{guide}: at {} s the view is {off} rad off the way", a.t);
            swing = swing.max(off);
            last = off;
        }
        println!("{guide}: the view swings by {swing:.4} rad, and is {last:.1e} rad off in the end");
        assert!(last < 1e-5, "{guide}: {last}");
        // Clockwise about the view: 20°, plus one second at 1.2 rad/s.
        let (a, b) = (straight.last().unwrap(), rolled.last().unwrap());
        let (up, now, forward) = (vector(a.up), vector(b.up), vector(a.forward));
        let roll = up.cross(now).dot(forward).atan2(up.dot(now));
        let asked = 20f64.to_radians() + 1.2;
        // The path bends while the body spins about the view, and some of the spin is lost to that swing.
        println!("{guide}: rolled by {roll:.4} of {asked:.4} rad");
        assert!((roll - asked).abs() < 0.1, "{guide}: {roll} of {asked} rad");
    }
}

/// Recordings of operator input, including old ones, replay to the same log, the same input and the same pictures.
#[test]
#[ignore = "slow: four runs of the program"]
fn roll_and_view_angle_are_recorded_and_replayed() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let old = std::fs::read_to_string("tests/inputs/hand.jsonl").unwrap();
    let new = "{\"tick\":60,\"command\":{\"view_angle\":40.0}}\n{\"tick\":61,\"command\":{\"roll\":-35.0}}\n\
               {\"tick\":70,\"command\":{\"turn\":[0.0,0.0,1.0]}}\n{\"tick\":130,\"command\":{\"turn\":[0.0,0.0,0.0]}}\n";
    std::fs::write(at("in.jsonl"), format!("{new}{old}")).unwrap();
    let fly = |input: &str, n: u32| {
        let (log, kept, film) = (at(&format!("{n}.jsonl")), at(&format!("{n}.in")), at(&format!("{n}/")));
        let args = ["--replay", input, "--log", &log, "--record-input", &kept, "--record", &format!("{film}/")];
        let all = [&["fly", "--headless", "--seconds", "2.5", "--fps", "2", "--size", "64x64"][..], &args].concat();
        run(&all, 0);
        let pictures: Vec<Vec<u8>> = (0..4).map(|k| std::fs::read(format!("{film}/{k:04}.png")).unwrap()).collect();
        (std::fs::read_to_string(log).unwrap(), std::fs::read_to_string(kept).unwrap(), pictures)
    };
    let first = fly(&at("in.jsonl"), 1);
    let again = fly(&at("1.in"), 2);
    assert!(first == again);
    assert!(first.1.starts_with(new), "{}", first.1);
    // Without the view angle the flight is the same, and the pictures after it differ.
    let wide = new.lines().skip(1).map(|l| format!("{l}\n")).collect::<String>();
    std::fs::write(at("wide.jsonl"), format!("{wide}{old}")).unwrap();
    let other = fly(&at("wide.jsonl"), 3);
    assert!(other.0 == first.0 && other.2[0] == first.2[0] && other.2[2] != first.2[2]);
    // Without pictures the view angle has no effect, but it is kept.
    run(&["fly", "--headless", "--seconds", "1", "--replay", &at("in.jsonl"), "--record-input", &at("bare.in")], 0);
    let kept = std::fs::read_to_string(at("bare.in")).unwrap();
    assert!(kept.lines().eq(new.lines().take(3)), "{kept}");
}

/// The view angle changes during the flight: the picture is that of the new angle, whatever the renderer kept of the
/// last frames.
#[test]
fn a_changed_view_angle_is_rendered_as_if_it_had_always_been() {
    let (volume, lumen, plan) = small();
    let lumen = Arc::new(lumen);
    for preset in BUILT_IN.into_iter().take(cases(usize::MAX, 1)) {
        let image = ImageSettings { width: 96, height: 72, preset, ..ImageSettings::default() };
        let scene = Scene { picture: true, image, ..scene("tentacles") };
        let volume = preset.preparation.prepare(volume.shared_voxels(), volume.transfer());
        let mut f = FlightApp::new(volume, Arc::clone(&lumen), plan.clone(), scene).unwrap();
        fly(&mut f, 1.0);
        for asked in [90.0, 60.0, 59.0, 8.0, 120.0, 500.0, -3.0] {
            f.act(FlightCommand::ViewAngle(asked)).unwrap();
            for _ in 0..4 {
                f.step().unwrap();
            }
            f.frame().unwrap();
            let picture = f.camera::<Picture>().unwrap();
            assert_eq!(picture.fov_degrees, asked.clamp(1.0, 170.0));
            let fresh = f.look(96, 72).unwrap();
            let psnr = psnr(&picture.frame, &fresh);
            assert!(psnr > 45.0, "{preset:?} at {asked}°: {psnr} dB");
        }
        f.act(FlightCommand::ViewAngle(f64::NAN)).unwrap();
        assert_eq!(f.camera::<Picture>().unwrap().fov_degrees, 1.0, "what is no number changes nothing");
    }
}
