//! Same input, same bytes: for any number of threads, and for recorded operator input.

use std::path::Path;

use colvis::app::Scene;
use colvis::app::plan::FlightRequest;
use colvis::components::input::{FlightCommand, HandCommand, TimedCommand};
use colvis::math::hash;
use colvis::phantom::{PhantomSettings, Size};

use crate::support::flights::flight;
use crate::support::phantom::phantom;
use crate::support::program::colvis;

/// Returns all files of a folder by name, with their bytes.
fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut all: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.is_file())
        .map(|p| (p.file_name().unwrap().to_string_lossy().into_owned(), std::fs::read(&p).unwrap()))
        .collect();
    all.sort();
    all
}

#[test]
#[ignore = "slow: two recordings by the program"]
fn one_thread_and_two_fly_and_draw_the_same() {
    let outputs = ["1", "2"].map(|threads| {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
        let status = colvis()
            .args(["fly", "--headless", "--seconds", "6", "--fps", "2", "--size", "160x120", "--threads", threads])
            .args(["--log", &at("f.jsonl"), "--record", &at("images/")])
            .status()
            .unwrap();
        assert!(status.success());
        let (log, images) = (files(dir.path()), files(&dir.path().join("images")));
        assert_eq!(images.len(), 13, "an image each half second, and the last place");
        (log, images)
    });
    assert_eq!(outputs[0].0, outputs[1].0, "log");
    assert_eq!(outputs[0].1, outputs[1].1, "images");
}

#[test]
#[ignore = "slow: four flights with coverage"]
fn guides_that_plan_fly_the_same_on_one_thread_and_two() {
    for guide in ["path", "potential"] {
        let logs = ["1", "2"].map(|threads| {
            let dir = tempfile::tempdir().unwrap();
            let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
            let args = ["fly", "--headless", "--guide", guide, "--seconds", "12", "--coverage", "--threads", threads];
            let status =
                colvis().args(args).args(["--log", &at("f.jsonl"), "--stats", &at("s.json")]).status().unwrap();
            assert!(status.success());
            let stats: serde_json::Value = serde_json::from_slice(&std::fs::read(at("s.json")).unwrap()).unwrap();
            (std::fs::read(at("f.jsonl")).unwrap(), stats["coverage"].clone(), stats["coverage_both_ways"].clone())
        });
        assert!(logs[0] == logs[1], "{guide}");
    }
}

#[test]
#[ignore = "slow: two recordings by the program"]
fn detail_follows_the_need_without_a_clock() {
    let outputs = ["1", "2"].map(|threads| {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
        let args = ["fly", "--headless", "--quality", "adaptive", "--seconds", "2", "--fps", "4", "--size", "320x240"];
        let status = colvis().args(args).args(["--threads", threads, "--record", &at("images/")]).status().unwrap();
        assert!(status.success());
        files(&dir.path().join("images"))
    });
    assert_eq!(outputs[0].len(), 9);
    assert!(outputs[0] == outputs[1], "images");
}

/// Wild operator input of every kind: the same input gives the same flight, and never a perforation.
#[test]
#[ignore = "slow: two flights of 30 s under wild input"]
fn a_wild_operator_is_repeated_and_never_perforates() {
    let (volume, _) = phantom(&PhantomSettings { size: Size::Small, ..PhantomSettings::default() });
    let mut timed_commands = Vec::new();
    for n in 0..400u64 {
        let u = |k| hash::uniform(11, n * 16 + k) * 2.0 - 1.0;
        let command = match hash::bits(5, n) % 10 {
            0..=4 => HandCommand::Push([u(0), u(1), u(2) * 9.0]).into(),
            5 => HandCommand::Turn([u(3), u(4), u(5)]).into(),
            6 => HandCommand::Look([u(6) * 200.0, u(7) * 200.0]).into(),
            7 => HandCommand::Speed(u(8) * 20.0).into(),
            8 => FlightCommand::Guide(if u(9) > 0.0 { "manual" } else { "tentacles" }.to_owned()).into(),
            _ => match hash::bits(6, n) % 3 {
                0 => FlightCommand::Reverse.into(),
                1 => HandCommand::Pause(u(10) > 0.7).into(),
                _ => HandCommand::Push([f64::NAN, 1.0, f64::INFINITY]).into(),
            },
        };
        timed_commands.push(TimedCommand { tick: n * 9, command });
    }
    let scene = Scene { log: true, operator: true, ..Scene::default() };
    let logs = [0, 1].map(|_| {
        let mut f = flight(volume.clone(), scene.clone(), &FlightRequest::default());
        f.commands.start();
        f.commands.replay(timed_commands.clone());
        let mut log = Vec::new();
        // Continue even after the guide has called for help or has arrived.
        for _ in 0..3600 {
            f.step().unwrap();
            log.append(&mut f.take_log());
        }
        assert!(f.commands.recorded().len() > 250, "the operator acted");
        log
    });
    assert_eq!(logs[0], logs[1]);
    let moved: f64 = logs[0].iter().map(|l| glam::DVec3::from_array(l.velocity).length() / 120.0).sum();
    assert!(moved > 700.0, "it got about: {moved} mm");
    for line in &logs[0] {
        assert!(line.clearance_mm >= 1.5, "{line:?}");
        assert!(line.position.iter().chain(&line.forward).chain(&line.up).all(|x| x.is_finite()));
    }
}

#[test]
#[ignore = "slow: two runs of the program"]
fn recorded_input_is_repeated_by_the_program() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let input = "{\"tick\":60,\"command\":{\"push\":[1,0,0.5]}}\n{\"tick\":120,\"command\":{\"push\":[0,0,0]}}\n\
                 {\"tick\":200,\"command\":{\"guide\":\"manual\"}}\n{\"tick\":260,\"command\":\"reverse\"}\n";
    std::fs::write(at("in.jsonl"), input).unwrap();
    let fly = |replay: &str, log: &str, keep: &str| {
        let s = colvis()
            .args(["fly", "--headless", "--seconds", "4", "--replay", &at(replay), "--log", &at(log)])
            .args(["--record-input", &at(keep)])
            .status()
            .unwrap();
        assert!(s.success());
    };
    fly("in.jsonl", "a.jsonl", "kept.jsonl");
    fly("kept.jsonl", "b.jsonl", "again.jsonl");
    let read = |n: &str| std::fs::read_to_string(at(n)).unwrap();
    assert_eq!(read("a.jsonl"), read("b.jsonl"));
    assert_eq!(read("kept.jsonl"), read("again.jsonl"));
    assert!(read("a.jsonl").contains("\"guide\":\"manual\"") && read("a.jsonl").lines().count() == 480);
    assert!(read("a.jsonl").trim_end().ends_with("\"state\":\"ended\",\"guide\":\"manual\"}"));
}
