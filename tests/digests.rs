//! Flights and pictures as they were: positions of the first 500 steps and a picture at their end, for each guide, and a
//! picture by each renderer, on the embedded phantom and on a real scan. What changes the structure must not change them.
//!
//! `COLVIS_REPLACE=1 cargo test --release --test digests` writes `tests/digests/*.txt` anew, where a change of behaviour is meant.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Steps that are flown: so many seconds at 120 a second.
const SECONDS: &str = "4.1666667";
const STEPS: usize = 500;

/// FNV-1a, 64 bits: small, and the same everywhere.
fn digest(bytes: impl IntoIterator<Item = u8>) -> u64 {
    bytes.into_iter().fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3))
}

fn colvis(args: &[&str]) {
    let out = Command::new(env!("CARGO_BIN_EXE_colvis")).args(args).output().expect("the program can be run");
    assert!(out.status.success(), "colvis {args:?}: {}", String::from_utf8_lossy(&out.stderr));
}

fn picture(path: &Path) -> u64 {
    digest(image::open(path).expect("a picture").to_rgb8().into_raw())
}

/// A line for a guide: digest of the positions of 500 steps, the last position, digest of the last picture.
fn flown(guide: &str, scan: Option<&str>, folder: &Path) -> String {
    let folder = folder.join(guide);
    let log = folder.join("f.jsonl");
    let (pictures, log_name) = (format!("{}/", folder.display()), log.display().to_string());
    std::fs::create_dir_all(&folder).unwrap();
    let mut args = vec!["fly"];
    args.extend(scan);
    args.extend(["--headless", "--guide", guide, "--seconds", SECONDS, "--size", "384x384", "--fps", "0.1"]);
    args.extend(["--record", &pictures, "--log", &log_name]);
    if guide == "manual" {
        args.extend(["--replay", "tests/inputs/hand.jsonl"]);
    }
    colvis(&args);
    let text = std::fs::read_to_string(&log).unwrap();
    let places: Vec<[f64; 3]> = text
        .lines()
        .map(|l| serde_json::from_str::<serde_json::Value>(l).unwrap()["position"].clone())
        .map(|p| serde_json::from_value(p).unwrap())
        .collect();
    assert_eq!(places.len(), STEPS, "{guide}");
    let positions = digest(places.iter().flatten().flat_map(|x| x.to_le_bytes()));
    let [x, y, z] = places[STEPS - 1];
    let seen = picture(&folder.join("0001.png"));
    format!("guide {guide}: positions {positions:016x}, ends at {x:.6},{y:.6},{z:.6}, picture {seen:016x}")
}

/// A line for a way to render: digest of the pictures of two poses.
fn rendered(preset: &str, quality: &str, scan: &str, poses: &Path, folder: &Path) -> String {
    let out = folder.join(format!("{preset}-{quality}"));
    let (poses, folder) = (poses.display().to_string(), out.display().to_string());
    colvis(&[
        "render",
        scan,
        "--poses",
        &poses,
        "--out",
        &folder,
        "--size",
        "160x128",
        "--preset",
        preset,
        "--quality",
        quality,
    ]);
    let seen = [0, 1].map(|n| picture(&out.join(format!("{n:04}.png"))));
    format!("preset {preset}, quality {quality}: pictures {:016x} {:016x}", seen[0], seen[1])
}

fn check(name: &str, scan: Option<&Path>) {
    let dir = tempfile::tempdir().unwrap();
    let named = scan.map(|s| s.display().to_string());
    let mut now = String::new();
    for guide in ["tentacles", "potential", "path", "manual"] {
        writeln!(now, "{}", flown(guide, named.as_deref(), dir.path())).unwrap();
    }
    // Poses of the flight by tentacles, some frames apart as in a flight.
    let log = std::fs::read_to_string(dir.path().join("tentacles").join("f.jsonl")).unwrap();
    let pose = |n: usize| {
        let line: serde_json::Value = serde_json::from_str(log.lines().nth(n).unwrap()).unwrap();
        serde_json::json!({"position": line["position"], "forward": line["forward"], "up": line["up"]})
    };
    let poses = dir.path().join("poses.json");
    std::fs::write(&poses, serde_json::json!({"fov_degrees": 90, "poses": [pose(240), pose(246)]}).to_string())
        .unwrap();
    let scan = named.unwrap_or_else(|| {
        let phantom = dir.path().join("phantom.mha").display().to_string();
        colvis(&["phantom", "--out", &phantom, "--size", "small"]);
        phantom
    });
    for preset in ["default", "colvis", "lean"] {
        for quality in ["high", "low", "adaptive"] {
            writeln!(now, "{}", rendered(preset, quality, &scan, &poses, dir.path())).unwrap();
        }
    }
    writeln!(now, "{}", rendered("default", "reference", &scan, &poses, dir.path())).unwrap();
    let file = PathBuf::from("tests/digests").join(format!("{name}.txt"));
    if std::env::var_os("COLVIS_REPLACE").is_some() {
        std::fs::write(&file, &now).unwrap();
        return;
    }
    let before = std::fs::read_to_string(&file).unwrap_or_default();
    let differs: Vec<String> =
        before.lines().zip(now.lines()).filter(|(a, b)| a != b).map(|(a, b)| format!("  was {a}\n  is  {b}")).collect();
    assert!(
        before == now,
        "{name}: flights or pictures changed:\n{}\nif that is meant: COLVIS_REPLACE=1 cargo test --release --test digests",
        differs.join("\n")
    );
}

#[test]
fn the_phantom_is_flown_and_seen_as_before() {
    check("phantom", None);
}

#[test]
fn the_scan_is_flown_and_seen_as_before() {
    let folder = std::env::var_os("COLVIS_TEST_DATA").map_or_else(|| PathBuf::from("../shared/data"), PathBuf::from);
    let scan = folder.join("ctc_prone.nii.gz");
    if !scan.exists() {
        eprintln!("skipped: there is no {}", scan.display());
        return;
    }
    check("ctc_prone", Some(&scan));
}
