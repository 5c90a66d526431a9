//! `colvis cleanse` and `--cleanse`: what they write, and what they refuse.

use std::path::Path;

use serde_json::Value;

use colvis::progress::Progress;
use colvis::volume::Volume;
use colvis::volume::io::{self, LoadOptions};

use crate::support::run::run;

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn load(path: &Path) -> Volume {
    io::load(path, &LoadOptions::default(), &Progress::new()).unwrap().volume
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// Writes a phantom with tag, and the same without.
fn phantom(folder: &Path, with: &str) -> [std::path::PathBuf; 2] {
    let [scan, twin] = ["scan.nii", "twin.nii"].map(|name| folder.join(name));
    run(&["phantom", "--out", text(&scan), "--size", "small", "--with", with, "--twin", text(&twin), "--seed", "2"], 0);
    [scan, twin]
}

#[test]
#[ignore = "slow: phantoms with tag"]
fn a_cleansed_scan_is_close_to_the_one_without_tag_on_any_number_of_threads() {
    let dir = tempfile::tempdir().unwrap();
    let [scan, twin] = phantom(dir.path(), "folds,pools,films,stool,noise");
    let [clean, again, stats] = ["clean.nii", "again.nii", "stats.json"].map(|name| dir.path().join(name));
    let out = run(&["cleanse", text(&scan), "--out", text(&clean), "--stats", text(&stats), "--threads", "1"], 0);
    assert!(String::from_utf8_lossy(&out.stderr).contains("ml of tagged fluid and stool"));
    run(&["cleanse", text(&scan), "--out", text(&again), "--threads", "2"], 0);
    assert!(std::fs::read(&clean).unwrap() == std::fs::read(&again).unwrap(), "other bytes with two threads");
    let stats = json(&stats);
    assert!(stats["prepare"]["cleanse_s"].as_f64().unwrap() > 0.0);
    let pools = stats["pools"].as_array().unwrap();
    let sum: f64 = pools.iter().map(|p| p["ml"].as_f64().unwrap()).sum();
    let replaced = stats["replaced_ml"].as_f64().unwrap();
    assert!(!pools.is_empty() && (replaced - sum - stats["residue_ml"].as_f64().unwrap()).abs() < 1e-9, "{stats}");
    for pool in pools.iter().filter(|p| p["ml"].as_f64().unwrap() > 1.0) {
        assert!((380.0..520.0).contains(&pool["tag_hu"].as_f64().unwrap()), "{pool}");
        let level = pool["level_mm"].as_array().unwrap();
        // A supine patient's levels face the ceiling: −y.
        assert!(level[1][1].as_f64().unwrap() < -0.99, "{pool}");
    }
    let [scan, twin, clean] = [&scan, &twin, &clean].map(|p| load(p));
    assert_eq!(clean.grid(), scan.grid());
    let tagged = (0..scan.data().len()).filter(|&n| scan.data()[n] > twin.data()[n] + 300).collect::<Vec<_>>();
    let left = tagged.iter().filter(|&&n| clean.data()[n] > twin.data()[n] + 300).count();
    assert!(tagged.len() > 20_000 && left * 10 < tagged.len(), "{left} of {} voxels still have tag", tagged.len());
    // Bone is as bright, but it is not near.
    let bright = |v: &Volume| tagged.iter().filter(|&&n| v.data()[n] > 350).count();
    assert!(bright(&clean) * 20 < bright(&scan), "{} of {} bright voxels", bright(&clean), bright(&scan));
}

#[test]
#[ignore = "slow: phantoms"]
fn a_scan_without_tag_stays_as_it_is_and_one_without_a_colon_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let [_, twin] = phantom(dir.path(), "folds,pools");
    let [clean, none] = ["clean.nii", "none.nii"].map(|name| dir.path().join(name));
    let out = run(&["cleanse", text(&twin), "--out", text(&clean)], 0);
    assert!(
        String::from_utf8_lossy(&out.stderr)
            .contains("the colon contains no tagged fluid or stool: the scan is unchanged")
    );
    assert!(load(&clean).data() == load(&twin).data());
    let volume = load(&twin);
    io::save(&none, &Volume::new(volume.grid().clone(), vec![40; volume.data().len()]), &Progress::new()).unwrap();
    let other = dir.path().join("other.nii");
    let out = run(&["cleanse", text(&none), "--out", text(&other)], 4);
    assert!(String::from_utf8_lossy(&out.stderr).contains("no gas of a colon") && !other.exists());
    run(&["cleanse", text(&twin), "--out", text(&dir.path().join("x.txt"))], 2);
    run(&["cleanse", text(&twin), "--out", text(&twin)], 2);
}

#[test]
#[ignore = "slow: phantoms with tag"]
fn commands_take_the_scan_as_cleanse_writes_it() {
    let dir = tempfile::tempdir().unwrap();
    let [scan, _] = phantom(dir.path(), "folds,pools");
    let [clean, mask, same, stats] = ["clean.nii", "mask.nii", "same.nii", "s.json"].map(|name| dir.path().join(name));
    run(&["cleanse", text(&scan), "--out", text(&clean)], 0);
    run(&["segment", text(&scan), "--cleanse", "--out", text(&mask), "--stats", text(&stats)], 0);
    run(&["segment", text(&clean), "--out", text(&same)], 0);
    assert!(std::fs::read(&mask).unwrap() == std::fs::read(&same).unwrap());
    let stats = json(&stats);
    let [lumen, fluid] = ["lumen_ml", "fluid_ml"].map(|name| stats[name].as_f64().unwrap());
    assert!(fluid < 0.02 * lumen, "{fluid} ml of fluid in {lumen} ml");
    assert!(stats["prepare"]["cleanse_s"].as_f64().unwrap() > 0.0, "{stats}");
    let line = dir.path().join("line.json");
    let out = run(&["centerline", "--mask", text(&mask), "--cleanse", "--out", text(&line)], 0);
    assert!(String::from_utf8_lossy(&out.stderr).contains("--cleanse is ignored: a mask has no HU"));
    let log = dir.path().join("log.jsonl");
    let flight = ["fly", text(&scan), "--headless", "--cleanse", "--guide", "path", "--seconds", "2"];
    let out = run(&[&flight[..], &["--log", text(&log)]].concat(), 0);
    assert!(String::from_utf8_lossy(&out.stderr).contains("ml of tagged fluid and stool") && log.exists());
}

#[test]
#[ignore = "slow: phantoms with tag"]
fn explain_tells_what_was_cleansed_and_why_nothing_was() {
    let dir = tempfile::tempdir().unwrap();
    let [scan, twin] = phantom(dir.path(), "folds,pools");
    let told = |input: &Path, guide: &str, more: &[&str]| {
        let out = run(&[&["explain", text(input), "--guide", guide, "--headless", "--json"], more].concat(), 0);
        serde_json::from_slice::<Value>(&out.stdout).unwrap()
    };
    let left_out = |told: &Value| {
        let parts = told["left_out"].as_array().unwrap();
        parts.iter().find(|p| p["part"] == "cleansing").map(|p| p["why"].as_str().unwrap().to_owned())
    };
    for (guide, more) in [("path", &[][..]), ("tentacles", &["--cleanse"])] {
        let flown = told(&scan, guide, more);
        assert!(flown["cleansed"]["text"].as_str().unwrap().contains("of tagged fluid and stool"), "{flown}");
        assert!(flown["cleansed"]["seconds"].as_f64().unwrap() > 0.0 && left_out(&flown).is_none());
        let kept = flown["built"].as_array().unwrap().iter().find(|p| p["part"] == "values before cleansing").unwrap();
        assert!(kept["bytes"].as_u64().unwrap() > 10_000);
    }
    let plain = told(&scan, "tentacles", &[]);
    assert!(plain["cleansed"].is_null() && left_out(&plain).unwrap().contains("does not fly through fluid"));
    assert!(left_out(&told(&twin, "path", &[])).unwrap().contains("no tag"));
    let printed = run(&["explain", text(&scan), "--guide", "path", "--headless"], 0);
    assert!(String::from_utf8_lossy(&printed.stdout).contains("cleansed:\n  removed "));
}
