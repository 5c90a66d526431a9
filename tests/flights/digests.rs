//! Regression digests of flights and pictures: the positions of the first 500 steps and a picture at their end for each
//! guide, and a picture by each renderer, on the embedded phantom and on a real scan. A change of structure must not
//! change them.
//!
//! After an intended change of behaviour, `COLVIS_REPLACE=1 cargo test --release --test flights digests` rewrites
//! `tests/digests/*.txt`.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use image::RgbImage;

use crate::support::failed::keep;
use crate::support::run::run;
use crate::support::scans::data;

/// The duration of [`STEPS`] at 120 steps a second, seconds.
const SECONDS: &str = "4.1666667";
const STEPS: usize = 500;

/// FNV-1a, 64 bits: small, and the same everywhere.
fn digest(bytes: impl IntoIterator<Item = u8>) -> u64 {
    bytes.into_iter().fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3))
}

/// Returns the digest of a picture, and appends the picture with its name to `pictures`.
fn picture(name: &str, path: &Path, pictures: &mut Pictures) -> u64 {
    let picture = image::open(path).expect("a picture").to_rgb8();
    pictures.push((name.to_owned(), picture.clone()));
    digest(picture.into_raw())
}

/// Named pictures, kept until it is known if all digests match.
type Pictures = Vec<(String, RgbImage)>;

/// Returns the line for a guide: digest of the positions of 500 steps, the last position, digest of the last picture.
fn flown(guide: &str, scan: Option<&str>, folder: &Path, pictures: &mut Pictures) -> String {
    let folder = folder.join(guide);
    let log = folder.join("f.jsonl");
    let (record, log_name) = (format!("{}/", folder.display()), log.display().to_string());
    std::fs::create_dir_all(&folder).unwrap();
    let mut args = vec!["fly"];
    args.extend(scan);
    args.extend(["--headless", "--guide", guide, "--seconds", SECONDS, "--size", "384x384", "--fps", "0.1"]);
    args.extend(["--record", &record, "--log", &log_name]);
    if guide == "manual" {
        args.extend(["--replay", "tests/inputs/hand.jsonl"]);
    }
    run(&args, 0);
    let text = std::fs::read_to_string(&log).unwrap();
    let places: Vec<[f64; 3]> = text
        .lines()
        .map(|l| serde_json::from_str::<serde_json::Value>(l).unwrap()["position"].clone())
        .map(|p| serde_json::from_value(p).unwrap())
        .collect();
    assert_eq!(places.len(), STEPS, "{guide}");
    let positions = digest(places.iter().flatten().flat_map(|x| x.to_le_bytes()));
    let [x, y, z] = places[STEPS - 1];
    let seen = picture(&format!("guide {guide}"), &folder.join("0001.png"), pictures);
    format!("guide {guide}: positions {positions:016x}, ends at {x:.6},{y:.6},{z:.6}, picture {seen:016x}")
}

/// Returns the line for a renderer: digest of the pictures of two poses.
fn rendered(way: [&str; 2], scan: &str, poses: &Path, folder: &Path, pictures: &mut Pictures) -> String {
    let [preset, quality] = way;
    let out = folder.join(format!("{preset}-{quality}"));
    let (poses, folder) = (poses.display().to_string(), out.display().to_string());
    let args = ["render", scan, "--poses", &poses, "--out", &folder, "--size", "160x128"];
    run(&[&args[..], &["--preset", preset, "--quality", quality]].concat(), 0);
    let name = |n| format!("preset {preset} quality {quality} {n}");
    let seen = [0, 1].map(|n| picture(&name(n), &out.join(format!("{n:04}.png")), pictures));
    format!("preset {preset}, quality {quality}: pictures {:016x} {:016x}", seen[0], seen[1])
}

fn check(name: &str, scan: Option<&Path>) {
    let dir = tempfile::tempdir().unwrap();
    let named = scan.map(|s| s.display().to_string());
    let (mut now, mut pictures) = (String::new(), Pictures::new());
    for guide in ["tentacles", "potential", "path", "manual"] {
        writeln!(now, "{}", flown(guide, named.as_deref(), dir.path(), &mut pictures)).unwrap();
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
        run(&["phantom", "--out", &phantom, "--size", "small"], 0);
        phantom
    });
    for preset in ["default", "colvis", "lean"] {
        for quality in ["high", "low", "adaptive"] {
            writeln!(now, "{}", rendered([preset, quality], &scan, &poses, dir.path(), &mut pictures)).unwrap();
        }
    }
    writeln!(now, "{}", rendered(["default", "reference"], &scan, &poses, dir.path(), &mut pictures)).unwrap();
    let file = PathBuf::from("tests/digests").join(format!("{name}.txt"));
    if std::env::var_os("COLVIS_REPLACE").is_some() {
        std::fs::write(&file, &now).unwrap();
        return;
    }
    let before = std::fs::read_to_string(&file).unwrap_or_default();
    let differs: Vec<String> =
        before.lines().zip(now.lines()).filter(|(a, b)| a != b).map(|(a, b)| format!("  was {a}\n  is  {b}")).collect();
    if before != now {
        let others = pictures.iter().filter(|(_, p)| !before.contains(&format!("{:016x}", digest(p.as_raw().clone()))));
        for (which, picture) in others {
            println!(
                "{name}, {which}: the picture as it is now: {}",
                keep(&format!("{name} {which}"), picture).display()
            );
        }
    }
    assert!(
        before == now,
        "{name}: flights or pictures changed:\n{}\nif that is meant: COLVIS_REPLACE=1 cargo test --release --test flights digests",
        differs.join("\n")
    );
}

#[test]
fn the_phantom_is_flown_and_seen_as_before() {
    check("phantom", None);
}

#[test]
#[ignore = "slow: the real scan, by every guide and every renderer"]
fn the_scan_is_flown_and_seen_as_before() {
    let Some(scan) = data("ctc_prone.nii.gz") else { return };
    check("ctc_prone", Some(&scan));
}
