//! The four centerline methods, selected on the command line and as the planner of a flight.

use std::path::Path;

use glam::DVec3;
use serde_json::Value;

use crate::support::phantom::phantom;
use crate::support::run::run;
use crate::support::scans::data;
use colvis::phantom::{PhantomSettings, Size};
use colvis::progress::Progress;
use colvis::volume::io;

const METHODS: [&str; 4] = ["penalised", "peel-onion", "roadmap", "cell-decomposition"];

fn json(path: &str) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn points(line: &Value) -> Vec<DVec3> {
    serde_json::from_value(line["points"].clone()).unwrap()
}

/// Each method runs from end to end. The distance of its points from the truth distinguishes the methods.
#[test]
#[ignore = "slow: the line of a phantom by each planner"]
fn every_method_finds_the_line_of_a_phantom() {
    let dir = tempfile::tempdir().unwrap();
    let at = |n: &str| dir.path().join(n).to_str().unwrap().to_owned();
    let (volume, truth) = phantom(&PhantomSettings { size: Size::Small, ..PhantomSettings::default() });
    io::save(Path::new(&at("v.nii.gz")), &volume, &Progress::new()).unwrap();
    let nearest = |p: DVec3| truth.centerline.iter().map(|q| q.distance(p)).fold(f64::INFINITY, f64::min);
    let mut lines = Vec::new();
    for method in METHODS {
        let args =
            ["centerline", &at("v.nii.gz"), "--method", method, "--out", &at("c.json"), "--stats", &at("s.json")];
        run(&args, 0);
        let line = points(&json(&at("c.json")));
        let mean = line.iter().map(|&p| nearest(p)).sum::<f64>() / line.len() as f64;
        let most = if method == "penalised" { 0.6 } else { 4.5 };
        assert!(mean < most, "{method}: {mean} mm from the truth in the mean");
        let length = json(&at("s.json"))["length_mm"].as_f64().unwrap();
        assert!(length > 0.95 * truth.length_mm && length < 1.5 * truth.length_mm, "{method}: {length}");
        assert_eq!(json(&at("s.json"))["method"], method);
        lines.push(line);
    }
    for (n, line) in lines.iter().enumerate() {
        assert!(!lines[..n].contains(line), "{} is another's line", METHODS[n]);
    }
    for (short, line, out) in [("peel", 1, "c.csv"), ("cells", 3, "c.mrk.json")] {
        run(&["centerline", &at("v.nii.gz"), "--method", short, "--out", &at(out)], 0);
        run(&["centerline", &at("v.nii.gz"), "--method", short, "--out", &at("e.json")], 0);
        assert_eq!(points(&json(&at("e.json"))), lines[line], "{short} is {}", METHODS[line]);
    }
    run(&["centerline", &at("v.nii.gz"), "--out", &at("d.json")], 0);
    assert_eq!(points(&json(&at("d.json"))), lines[0], "penalised is the default");
}

#[test]
#[ignore = "slow: a flight on the line of each planner"]
fn a_flight_on_each_planners_line_arrives() {
    let dir = tempfile::tempdir().unwrap();
    let at = |n: &str| dir.path().join(n).to_str().unwrap().to_owned();
    let mut lengths = Vec::new();
    for planner in METHODS {
        let scene = format!("plugins = [\"path\", \"watch\"]\n[path]\nplanner = \"{planner}\"\n");
        std::fs::write(at("s.toml"), scene).unwrap();
        run(&["fly", "--headless", "--scene", &at("s.toml"), "--stats", &at("s.json")], 0);
        let stats = json(&at("s.json"));
        assert_eq!(stats["state"], "arrived", "{planner}");
        lengths.push(stats["length_mm"].as_f64().unwrap());
        let out = run(&["explain", "--headless", "--scene", &at("s.toml")], 0);
        let told = String::from_utf8_lossy(&out.stdout).into_owned();
        assert!(told.contains(&format!("planner {planner}")), "{told}");
    }
    assert!((1..4).all(|n| lengths[n] != lengths[0]), "another line is another flight: {lengths:?}");
    std::fs::write(at("s.toml"), "plugins = [\"path\"]\n[path]\nplanner = \"warp\"\n").unwrap();
    run(&["fly", "--headless", "--scene", &at("s.toml")], 2);
}

#[test]
#[ignore = "slow: the real scan by two planners"]
fn the_real_scan_by_the_quick_methods() {
    let Some(scan) = data("ctc_prone.nii.gz") else { return };
    let dir = tempfile::tempdir().unwrap();
    let at = |n: &str| dir.path().join(n).to_str().unwrap().to_owned();
    for method in ["cell-decomposition", "peel-onion"] {
        run(&["centerline", scan.to_str().unwrap(), "--method", method, "--out", &at("c.json")], 0);
        assert!(json(&at("c.json"))["length_mm"].as_f64().unwrap() > 1500.0, "{method}");
    }
}
