//! `colvis dataset`: truth that others can check, the same bytes however they came to be, and what is refused.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::{Value, json};

use crate::support::run::run;
use crate::support::skips::skip;

/// A folder for datasets.
struct Room(tempfile::TempDir);

impl Room {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn at(&self, name: &str) -> String {
        self.0.path().join(name).to_str().unwrap().to_owned()
    }

    fn write(&self, name: &str, value: &Value) -> String {
        fs::write(self.0.path().join(name), value.to_string()).unwrap();
        self.at(name)
    }

    /// Writes the dataset of a short flight through the embedded phantom.
    fn flown(&self, name: &str, more: &[&str]) -> PathBuf {
        let out = self.at(name);
        let line = ["dataset", "--out", &out, "--seconds", "1", "--fps", "4", "--size", "96x80"];
        run(&[&line, more].concat(), 0);
        PathBuf::from(out)
    }
}

/// Returns what all files of a folder hold, by their names.
fn bytes(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let (mut out, mut left) = (BTreeMap::new(), vec![folder.to_owned()]);
    while let Some(at) = left.pop() {
        for entry in fs::read_dir(&at).unwrap().map(|e| e.unwrap().path()) {
            if entry.is_dir() {
                left.push(entry);
            } else {
                out.insert(entry.strip_prefix(folder).unwrap().to_owned(), fs::read(&entry).unwrap());
            }
        }
    }
    out
}

/// Lets Python judge a dataset by its README.
fn judged(folder: &Path) {
    let Ok(python) = std::env::var("COLVIS_PEERS") else {
        return skip("peers", "COLVIS_PEERS names no Python with numpy and pillow");
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/program/dataset.py");
    let output = Command::new(python).arg(script).arg(folder).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(said.starts_with("ok"), "{said}{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn truth_holds_by_code_that_shares_nothing_with_ours() {
    let room = Room::new();
    judged(&room.flown("pinhole", &[]));
    judged(&room.flown("wide", &["--camera", "fisheye", "--fov", "170"]));
    judged(&room.flown("linear", &["--linear", "--noise", "0", "--mucosa", "strong", "--gamma", "2", "--lights", "1"]));
    // Tissue that breathes: the same, by the way that it goes.
    let breathing = room.flown("breathing", &["--deform", "3"]);
    judged(&breathing);
    let moved = |n: usize| fs::read(breathing.join(format!("truth/scene-flow/{n:06}.npy"))).unwrap();
    assert!(moved(0) != moved(1) && !breathing.join("truth/scene-flow/000003.npy").exists());
    // A calibrated fisheye, off its middle, at places of a flight.
    let poses = fs::read_to_string(room.at("pinhole/poses.csv")).unwrap();
    let poses: Vec<Value> = poses
        .lines()
        .skip(1)
        .map(|line| {
            let p: Vec<f64> = line.split(',').map(|x| x.parse().unwrap()).collect();
            let turn = glam::DQuat::from_xyzw(p[5], p[6], p[7], p[8]);
            let [forward, up] = [glam::DVec3::Z, glam::DVec3::NEG_Y].map(|axis| (turn * axis).to_array());
            json!({"position": [p[2], p[3], p[4]], "forward": forward, "up": up})
        })
        .collect();
    let camera =
        json!({"model": "fisheye", "fx": 52.0, "fy": 50.0, "cx": 49.0, "cy": 38.5, "k": [-0.06, 0.01, -0.002, 0.0001]});
    let file = room.write("poses.json", &json!({"camera": camera, "poses": poses}));
    let out = room.at("calibrated");
    run(&["dataset", "--poses", &file, "--out", &out, "--size", "96x80"], 0);
    judged(Path::new(&out));
}

#[test]
fn the_bytes_are_the_same_on_any_number_of_threads_and_after_a_run_was_cut_short() {
    let room = Room::new();
    let kinds = ["--truth", "depth,normals,flow,shading"];
    let flown = |name: &str, threads: &str| bytes(&room.flown(name, &[&kinds[..], &["--threads", threads]].concat()));
    let whole = flown("whole", "2");
    assert!(whole == flown("alone", "1"));
    // What a run leaves that is killed: some frames, one without its picture, and a file half written.
    let part = PathBuf::from(room.at("again.part"));
    for (name, bytes) in &whole {
        let is_list = name.components().count() == 1 && name != Path::new("dataset.json");
        let is_late = ["000002", "000003"].iter().any(|n| name.to_string_lossy().contains(n));
        if !is_list && (!is_late || name == Path::new("truth/depth/000002.npy")) {
            let path = part.join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, bytes).unwrap();
        }
    }
    fs::write(part.join("truth/depth/000002.npy"), b"half").unwrap();
    // Exposures are kept by themselves until all are there.
    let exposures = String::from_utf8(whole[Path::new("exposure.csv")].clone()).unwrap();
    fs::create_dir_all(part.join("exposure")).unwrap();
    for line in exposures.lines().skip(1).take(2) {
        let (n, factor) = line.split_once(',').unwrap();
        fs::write(part.join(format!("exposure/{:06}.txt", n.parse::<usize>().unwrap())), factor).unwrap();
    }
    let stats = room.at("stats.json");
    let again = room.flown("again", &[&kinds[..], &["--stats", &stats]].concat());
    assert!(whole == bytes(&again));
    let stats: Value = serde_json::from_slice(&fs::read(&stats).unwrap()).unwrap();
    assert_eq!(stats["datasets"][0]["measured"], whole.keys().filter(|n| n.starts_with("rgb")).count() - 2);
    assert!(!part.exists());
    // Once more does nothing; another dataset is refused there, and leaves it as it is.
    assert!(whole == flown("again", "2"));
    let out = room.at("again");
    run(&["dataset", "--out", &out, "--seconds", "1", "--fps", "2", "--size", "96x80"], 2);
    assert!(whole == bytes(Path::new(&out)));
}

#[test]
fn each_phantom_has_its_folder() {
    let room = Room::new();
    let (out, stats) = (room.at("many"), room.at("stats.json"));
    let line = ["dataset", "--phantoms", "3..4", "--out", &out, "--seconds", "0.5", "--fps", "4", "--size", "48x48"];
    run(&[&line[..], &["--truth", "depth,labels", "--stats", &stats]].concat(), 0);
    let stats: Value = serde_json::from_slice(&fs::read(&stats).unwrap()).unwrap();
    assert_eq!(stats["datasets"].as_array().unwrap().len(), 2);
    let read = |n: u32| bytes(&Path::new(&out).join(format!("phantom-{n:04}")));
    let (a, b) = (read(3), read(4));
    assert!(a.len() == b.len() && a != b);
    let folders = ["truth/depth", "truth/labels", "truth/parts"];
    assert!(a.keys().filter(|name| name.starts_with("truth")).all(|name| folders.iter().any(|f| name.starts_with(f))));
}

#[test]
fn what_makes_no_dataset_is_told_and_leaves_no_folder() {
    let room = Room::new();
    let pose = |at: [f64; 3]| json!({"position": at, "forward": [0, 1, 0], "up": [0, 0, 1]});
    let buried = room.write("buried.json", &json!({"poses": [pose([0.0, 0.0, 0.0])]}));
    let folding = json!({"model": "fisheye", "fx": 50, "fy": 50, "cx": 40, "cy": 40, "k": [-9e9, 0, 0, 0]});
    let folding = room.write("folding.json", &json!({"camera": folding, "poses": [pose([0.0, 0.0, 0.0])]}));
    let none = room.write("none.json", &json!({"poses": []}));
    let out = room.at("out");
    for (more, status) in [
        (&["--poses", &buried][..], 3),
        (&["--poses", &folding], 2),
        (&["--poses", &none], 2),
        (&["--poses", "nowhere.json"], 3),
        (&["--size", "0x40"], 2),
        (&["--layout", "mine"], 2),
        (&["--truth", "depth,colour"], 2),
        (&["--phantoms", "5..2"], 2),
        (&["--deform", "9"], 2),
        (&["--mucosa", "blue"], 2),
        (&["--lights", "3"], 2),
        (&["--exposure", "0"], 2),
        (&["--exposure", "bright"], 2),
        (&["--gamma", "0.5"], 2),
        (&["--noise", "-1"], 2),
        (&["--noise", "nan"], 2),
        (&["--seconds", "0"], 2),
        (&["--fps", "1e9"], 2),
        (&["--poses", &none, "--guide", "path"], 2),
    ] {
        run(&[&["dataset", "--out", &out][..], more].concat(), status);
        assert!(!Path::new(&out).exists() && !Path::new(&format!("{out}.part")).exists(), "{more:?}");
    }
    // Something else is there.
    fs::create_dir(&out).unwrap();
    fs::write(Path::new(&out).join("notes.txt"), "mine").unwrap();
    run(&["dataset", "--out", &out, "--seconds", "1"], 2);
    assert_eq!(bytes(Path::new(&out)).len(), 1);
}
