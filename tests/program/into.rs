//! `colvis phantom --into`: lesions put into a scan, their truth, and what is refused.

use std::path::Path;

use colvis::phantom::TruePolyp;
use colvis::volume::io::{self, LoadOptions};
use glam::DVec3;
use serde_json::Value;

use crate::support::run::run;

fn json(path: &str) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn hu(path: &str) -> Vec<i16> {
    io::load(Path::new(path), &LoadOptions::default(), &colvis::progress::Progress::new())
        .unwrap()
        .volume
        .data()
        .to_vec()
}

/// Runs a command line that fails and returns what it says.
fn said(args: &[&str], status: i32) -> String {
    String::from_utf8_lossy(&run(args, status).stderr).into_owned()
}

#[test]
fn lesions_are_put_into_a_scan_and_the_rest_of_it_stays() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let [scan, out, truth] = ["p.nii.gz", "o.mha", "t.json"].map(at);
    run(&["phantom", "--out", &scan, "--size", "small", "--with", "folds,pools,noise", "--seed", "3"], 0);
    let put = ["phantom", "--into", &scan, "--lesions", "6", "--seed", "5", "--out", &out, "--truth", &truth];
    run(&put, 0);
    let told = json(&truth);
    let polyps: Vec<TruePolyp> = serde_json::from_value(told["polyps"].clone()).unwrap();
    assert!((4..=6).contains(&polyps.len()), "{polyps:?}");
    assert!(polyps.windows(2).all(|p| p[0].along_mm <= p[1].along_mm), "{polyps:?}");
    for p in &polyps {
        assert!(p.diameter_mm > 2.0 && p.height_mm.is_some_and(|h| h > 1.0) && p.volume_mm3.is_some(), "{p:?}");
    }
    let line: Vec<DVec3> = serde_json::from_value(told["centerline"].clone()).unwrap();
    let sums: f64 = line.windows(2).map(|p| p[0].distance(p[1])).sum();
    assert!((sums - told["length_mm"].as_f64().unwrap()).abs() < 2.0, "{sums}");
    assert_eq!(told["radius_mm"].as_array().unwrap().len(), line.len());
    assert!(told["lumen_ml"].as_f64().unwrap() > 50.0 && told["scan"]["tag_hu"].as_f64().is_some(), "{}", told["scan"]);
    let (before, after) = (hu(&scan), hu(&out));
    let changed = before.iter().zip(&after).filter(|v| v.0 != v.1).count();
    assert!(changed > 500 && changed * 20 < before.len(), "{changed} of {}", before.len());

    // The same on one thread, and the same file with a name that tells nothing.
    let again = at("again.mha");
    let mut put = put;
    put[8] = &again;
    run(&[&put[..], &["--threads", "1"]].concat(), 0);
    assert!(std::fs::read(&out).unwrap() == std::fs::read(&again).unwrap());
    assert!(!std::fs::read_to_string(&truth).unwrap().contains("p.nii.gz"));
}

#[test]
fn what_cannot_have_lesions_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let [scan, out] = ["p.nii.gz", "o.nii.gz"].map(at);
    run(&["phantom", "--out", &scan, "--size", "small", "--with", "folds"], 0);
    for more in
        [&["--size", "small"][..], &["--with", "folds"], &["--noise", "3"], &["--twin", &out], &["--lesions", "0"]]
    {
        run(&[&["phantom", "--into", &scan, "--out", &out][..], more].concat(), 2);
    }
    run(&["phantom", "--out", &out, "--lesions", "3"], 2);
    // It would overwrite what it reads.
    assert!(said(&["phantom", "--into", &scan, "--out", &scan], 2).contains("p.nii.gz"));
    run(&["phantom", "--into", &at("none.nii.gz"), "--out", &out], 3);
    assert!(!Path::new(&out).exists());
}

#[test]
#[ignore = "slow: a report on detectors"]
fn a_report_on_a_scan_without_truth_puts_lesions_into_it() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let [scan, out] = ["p.nii.gz", "report"].map(at);
    run(&["phantom", "--out", &scan, "--size", "small", "--with", "folds,noise", "--seed", "4"], 0);
    run(&["report", "candidates", "--quick", "--out", &out, "--scan", &scan], 0);
    let page = std::fs::read_to_string(Path::new(&out).join("report.html")).unwrap();
    assert!(page.contains("upper bounds") && page.contains("Lesions put into p.nii.gz"), "{page}");
    let rows = |name: &str| std::fs::read_to_string(Path::new(&out).join(name)).unwrap().lines().count();
    for name in ["put-in-apart.csv", "put-in-taught.csv", "put-in-apart-candidates.csv"] {
        assert!(rows(name) > 3, "{name}");
    }
}
