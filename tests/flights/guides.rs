//! Guides that plan: the paper's four conditions (section 3) as invariants, the hand-over between guide and operator,
//! replayed logs, and the share of the wall that was seen.

use std::path::Path;

use colvis::app::Scene;
use colvis::app::plan::FlightRequest;
use colvis::components::flight::State;
use colvis::components::guide::{Planned, PotentialField};
use colvis::components::input::{FlightCommand, HandCommand, TimedCommand};
use colvis::components::output::LogLine;
use colvis::math::hash;
use colvis::phantom::{PhantomSettings, Size};
use colvis::space::value;
use glam::DVec3;

use crate::support::flights::{flight, fly, jerk, judge, scan};
use crate::support::logs::{place, read_log};
use crate::support::phantom::phantom;
use crate::support::run::run;
use crate::support::scans::data;

const RADIUS_MM: f64 = 1.5;
const GUIDES: [&str; 2] = ["path", "potential"];

fn scene(guide: &'static str) -> Scene {
    Scene { log: true, ..Scene::guided_by(guide) }
}

fn small(seed: u64) -> PhantomSettings {
    PhantomSettings { size: Size::Small, seed, ..PhantomSettings::default() }
}

/// Conditions 1, 3 and 4: always from the start towards the end along a valid path, as far from the wall as possible,
/// never through it.
#[test]
#[ignore = "slow: flights by every guide through two phantoms, both ways"]
fn automatic_flights_hold_the_papers_conditions() {
    for seed in [1, 2] {
        let (volume, truth) = phantom(&small(seed));
        let mut scan = scan(volume.clone());
        for guide in GUIDES {
            for reverse in [false, true] {
                let request = FlightRequest { reverse, ..FlightRequest::default() };
                let mut f = scan.flight(scene(guide), &request).unwrap();
                let log = fly(&mut f, 180.0);
                let (state, goal) = (f.flight(), f.setup().plan.goal().at);
                assert_eq!(state.state, State::Arrived, "{guide:?} {seed}: {}", state.reason);
                // 1: in every two seconds it gets nearer to the end, measured along the truth's centerline.
                let along = |l: &LogLine| {
                    let d = |i: &usize| truth.centerline[*i].distance_squared(place(l));
                    (0..truth.centerline.len()).min_by(|a, b| d(a).total_cmp(&d(b))).unwrap() as f64
                };
                let sense = if reverse { -1.0 } else { 1.0 };
                for w in log.windows(240).step_by(120) {
                    assert!((along(&w[239]) - along(&w[0])) * sense > 0.0, "{guide:?} at {} s", w[0].t);
                }
                assert!(place(&log[log.len() - 1]).distance(goal) <= f.setup().plan.goal().within_mm);
                assert!(log.iter().all(|l| value(&f.setup().volume, place(l)) < -650.0), "inside the lumen");
                // 3: near the centerline.
                let course = judge(&log, &truth);
                println!(
                    "{guide:?} seed {seed} reverse {reverse}: {course:?} in {:.1} s, jerk {:.0}",
                    log[log.len() - 1].t,
                    jerk(&log)
                );
                // The shortest path, which shapes a potential, cuts corners as far as the wall allows.
                let allowed = if guide == "path" { 0.055 } else { 0.4 };
                assert!(course.passed >= 0.99 && course.offset <= allowed, "{guide:?}: {course:?}");
                // 4: the body never touches the wall.
                assert!(course.clearance_mm >= RADIUS_MM, "{course:?}");
            }
        }
    }
}

/// Conditions 2 and 4: the operator may intervene at any time, wildly, and never perforates. The guide resumes from
/// there and still arrives.
#[test]
#[ignore = "slow: flights by three guides under wild input"]
fn the_operator_may_intervene_at_any_time() {
    let mut scan = scan(phantom(&small(1)).0);
    for guide in ["path", "potential", "tentacles"] {
        let mut f = scan.flight(Scene { operator: true, ..scene(guide) }, &FlightRequest::default()).unwrap();
        let mut timed_commands = Vec::new();
        for n in 0..6u64 {
            let u = |k| hash::uniform(31, 8 * n + k) * 2.0 - 1.0;
            let tick = 200 + 420 * n;
            timed_commands.push(TimedCommand { tick, command: HandCommand::Push([u(0), u(1), u(2)]).into() });
            timed_commands.push(TimedCommand { tick: tick + 120, command: HandCommand::Push([0.0; 3]).into() });
        }
        f.commands.replay(timed_commands.clone());
        let log = fly(&mut f, 240.0);
        assert_eq!(f.flight().state, State::Arrived, "{guide:?}: {}", f.flight().reason);
        assert!(log.iter().all(|l| l.clearance_mm >= RADIUS_MM));
        // Operator input acts at once: within a second the camera is not where it would otherwise be.
        let mut alone = scan.flight(Scene { operator: true, ..scene(guide) }, &FlightRequest::default()).unwrap();
        let free = fly(&mut alone, 4.0);
        assert!(place(&free[320]).distance(place(&log[320])) > 13.0, "{guide:?}");
    }
}

/// Recorded operator input that pushes into the wall, sideways and backwards, looks around, stops and releases control.
#[test]
#[ignore = "slow: flights of 32 s by three guides"]
fn a_recorded_hand_never_perforates_and_the_guide_takes_over_smoothly() {
    let dir = tempfile::tempdir().unwrap();
    for guide in ["tentacles", "path", "potential"] {
        let log = dir.path().join(format!("{guide}.jsonl"));
        let args = ["fly", "--headless", "--seconds", "32", "--guide", guide, "--replay", "tests/inputs/hand.jsonl"];
        run(&[&args[..], &["--log", log.to_str().unwrap()]].concat(), 0);
        let lines = read_log(&log);
        let least = lines.iter().map(|l| l.clearance_mm).fold(f64::INFINITY, f64::min);
        assert!(least >= RADIUS_MM, "{guide}: {least}");
        // Two seconds from the moment when the guide starts to take over again, 0.4 s after the operator released
        // control.
        let jerks: Vec<f64> = [480, 960, 1500, 2040].into_iter().map(|t| jerk(&lines[t + 48..t + 48 + 240])).collect();
        let most = jerks.iter().fold(0.0f64, |a, b| a.max(*b));
        println!("{guide}: least clearance {least:.2} mm, jerk at the hand-over {most:.0} mm/s³ {jerks:.0?}");
        let allowed = match guide {
            "path" => 590.0,
            "potential" => 4200.0,
            _ => 6000.0,
        };
        assert!(most < allowed, "{guide}: {jerks:?}");
    }
}

#[test]
#[ignore = "slow: fields for three guides"]
fn guides_change_in_flight_and_their_fields_come_and_go() {
    let (volume, _) = phantom(&small(1));
    let mut f = flight(volume, Scene { operator: true, ..scene("tentacles") }, &FlightRequest::default());
    let go = |f: &mut colvis::app::FlightApp, steps: usize| (0..steps).for_each(|_| f.step().unwrap());
    go(&mut f, 240);
    assert!(f.setup().fields.walls().is_none() && f.setup().fields.route().is_none());
    f.act(FlightCommand::Guide("path".to_owned())).unwrap();
    assert!(f.camera::<Planned>().is_some() && f.setup().fields.walls().is_none(), "the centerline alone is kept");
    let times = f.setup().fields.times();
    assert!(times.iter().any(|t| t.0 == "centerline_s") && times.iter().any(|t| t.0 == "distance_s"));
    go(&mut f, 360);
    let before = f.camera::<Planned>().unwrap().s_mm;
    f.act(FlightCommand::Guide("potential".to_owned())).unwrap();
    assert!(f.camera::<Planned>().is_none() && f.camera::<PotentialField>().is_some());
    assert!(f.setup().fields.route().is_none() && f.setup().fields.target().is_some());
    go(&mut f, 360);
    f.act(FlightCommand::Guide("manual".to_owned())).unwrap();
    assert!(
        f.setup().fields.walls().is_none()
            && f.setup().fields.target().is_none()
            && f.camera::<PotentialField>().is_none()
    );
    go(&mut f, 60);
    f.act(FlightCommand::Guide("path".to_owned())).unwrap();
    go(&mut f, 240);
    assert!(f.camera::<Planned>().unwrap().s_mm > before + 60.0, "each went on");
    // To a place on the path, and back from there.
    f.act(FlightCommand::Seek(0.5)).unwrap();
    let planned = f.camera::<Planned>().unwrap();
    let half = planned.route.place(planned.route.length_mm() / 2.0);
    assert!(f.pose().position.distance(half) < 1e-6);
    f.act(FlightCommand::Reverse).unwrap();
    go(&mut f, 360);
    let planned = f.camera::<Planned>().unwrap();
    assert!(planned.s_mm > planned.route.length_mm() / 2.0 + 30.0, "flying back: {}", planned.s_mm);
    let log = f.take_log();
    assert!(log.iter().all(|l| l.clearance_mm >= RADIUS_MM));
}

#[test]
#[ignore = "slow: a flight with coverage, and three that play its log"]
fn a_log_is_played_at_any_rate_on_the_same_path() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let mesh = at("seen.ply");
    let covering = ["--coverage", "--coverage-mesh", &mesh];
    run(
        &[&["fly", "--headless", "--guide", "path", "--log", &at("a.jsonl"), "--stats", &at("a.json")], &covering[..]]
            .concat(),
        0,
    );
    let flown = read_log(Path::new(&at("a.jsonl")));
    let path: Vec<DVec3> = flown.iter().map(place).collect();
    for (rate, extra) in [("0.5", &[][..]), ("4", &[]), ("2", &["--reverse"])] {
        let args = ["fly", "--headless", "--play", &at("a.jsonl"), "--rate", rate, "--log", &at("p.jsonl")];
        run(&[&args[..], extra].concat(), 0);
        let played = read_log(Path::new(&at("p.jsonl")));
        let times = flown.len() as f64 / rate.parse::<f64>().unwrap();
        assert!((played.len() as f64 - times).abs() < 1.5, "{} lines at {rate}", played.len());
        let mut n = 0;
        let forward: Vec<DVec3> = if extra.is_empty() {
            played.iter().map(place).collect()
        } else {
            played.iter().rev().map(place).collect()
        };
        for p in forward {
            // The log steps that surround it come in the log's own order.
            let off = |n: usize| {
                let (a, along) = (path[n], path[n + 1] - path[n]);
                let t = ((p - a).dot(along) / along.length_squared().max(1e-30)).clamp(0.0, 1.0);
                (a + along * t).distance(p)
            };
            while n + 2 < path.len() && off(n) > 1e-9 {
                n += 1;
            }
            assert!(off(n) < 1e-9, "{p} at rate {rate}");
        }
        assert!(n + 4 > path.len() || !extra.is_empty());
        assert!(played.iter().all(|l| l.guide == "play"));
    }
    for bad in ["0", "-1", "nan"] {
        run(&["fly", "--headless", "--play", &at("a.jsonl"), "--rate", bad], 2);
    }
    run(&["fly", "--headless", "--play", &at("a.jsonl"), "--guide", "path"], 2);
    run(&["fly", "--headless", "--play", &at("a.json")], 3);
    run(&["fly", "--headless", "--play", &at("missing.jsonl")], 3);
    run(&["fly", "--headless", "--rate", "2"], 2);
    // Coverage is a share, and is larger in both directions.
    let stats: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(at("a.json")).unwrap()).unwrap();
    let [one, both] = ["coverage", "coverage_both_ways"].map(|k| stats[k].as_f64().unwrap());
    println!("coverage {one:.3} one way, {both:.3} both ways");
    assert!(0.5 < one && one < both && both <= 1.0);
    // So is what was watched on the way, of a sample of the wall.
    let live = stats["coverage_live"].as_f64().unwrap();
    println!("coverage while flying {live:.4}, afterwards {one:.4}");
    assert!((live - one).abs() < 0.005, "{live} while flying, {one} afterwards");
    // The mesh tells the same: a number for each face, the last two bytes of its record.
    let ply = std::fs::read(&mesh).unwrap();
    let head = ply.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let text = String::from_utf8_lossy(&ply[..head]).into_owned();
    let count = |element: &str| -> usize {
        let line = text.lines().find_map(|l| l.strip_prefix(element)).unwrap();
        line.trim().parse().unwrap()
    };
    let (vertices, faces) = (count("element vertex"), count("element face"));
    assert_eq!(ply.len(), head + 12 * vertices + 15 * faces);
    let number = |at: usize| f32::from_le_bytes(ply[at..at + 4].try_into().unwrap());
    let vertex = |n: usize| DVec3::from_array([0, 4, 8].map(|b| f64::from(number(head + 12 * n + b))));
    let (mut all, mut seen) = (0.0, 0.0);
    for face in ply[head + 12 * vertices..].chunks(15) {
        let [a, b, c] = [1, 5, 9].map(|at| vertex(u32::from_le_bytes(face[at..at + 4].try_into().unwrap()) as usize));
        let mm2 = 0.5 * (b - a).cross(c - a).length();
        all += mm2;
        seen += if u16::from_le_bytes([face[13], face[14]]) > 0 { mm2 } else { 0.0 };
    }
    assert!((all / stats["wall_mm2"].as_f64().unwrap() - 1.0).abs() < 1e-4 && (seen / all - one).abs() < 1e-4);
    let missed = stats["missed"].as_array().unwrap();
    assert!(
        missed.iter().all(|m| m["area_mm2"].as_f64().unwrap() >= 300.0 && m["look_from"].is_object()),
        "{missed:?}"
    );
    run(&["fly", "--headless", "--seconds", "1", "--coverage-mesh", &at("seen.stl")], 2);
    for part in ["distance_s", "centerline_s"] {
        assert!(stats["prepare"][part].as_f64().unwrap() > 0.0, "{part}: {}", stats["prepare"]);
    }
}

/// Guides that plan fly gas segments that tagged fluid separates as one.
#[test]
#[ignore = "slow: a flight through the whole real scan"]
fn fluid_joins() {
    let Some(scan) = data("ctc_prone.nii.gz") else { return };
    let dir = tempfile::tempdir().unwrap();
    let stats = dir.path().join("s.json");
    let scan = scan.to_str().unwrap();
    let out = run(&["fly", scan, "--headless", "--guide", "path", "--stats", stats.to_str().unwrap()], 0);
    let said = String::from_utf8_lossy(&out.stderr);
    assert!(said.contains("flies through tagged fluid") && said.contains("3 segments become 1"), "{said}");
    let stats: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&stats).unwrap()).unwrap();
    assert_eq!(stats["state"], "arrived");
    assert!(stats["length_mm"].as_f64().unwrap() > 1200.0, "{}", stats["length_mm"]);
    assert_eq!(stats["unflown"].as_array().unwrap().len(), 0);
}

#[test]
fn settings_that_make_no_sense_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    for (n, text) in [
        "plugins = [\"path\"]\n[path]\ncruise_mm_s = 0",
        "plugins = [\"path\"]\n[path]\njerk_mm_s3 = nan",
        "plugins = [\"potential\"]\n[potential]\nwall_energy = -1",
        "plugins = [\"potential\"]\n[potential]\nreach_mm = inf",
        "plugins = [\"potential\", \"path\"]",
    ]
    .into_iter()
    .enumerate()
    {
        let file = dir.path().join(format!("{n}.toml"));
        std::fs::write(&file, text).unwrap();
        run(&["explain", "--headless", "--scene", file.to_str().unwrap()], 2);
    }
}
