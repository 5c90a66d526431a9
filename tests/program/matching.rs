//! `colvis match`: two positions of a phantom, a scan with itself, and what cannot be matched.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::support::run::run;

fn read(path: &str) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

fn points(value: &Value) -> Vec<[f64; 3]> {
    serde_json::from_value(value.clone()).unwrap()
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum::<f64>().sqrt()
}

/// The point of a line at a distance along it, mm.
fn place(line: &[[f64; 3]], mm: f64) -> [f64; 3] {
    let mut left = mm;
    for pair in line.windows(2) {
        let length = distance(pair[0], pair[1]);
        if length >= left {
            let share = if length > 0.0 { left / length } else { 0.0 };
            return [0, 1, 2].map(|n| pair[0][n] + (pair[1][n] - pair[0][n]) * share);
        }
        left -= length;
    }
    *line.last().unwrap()
}

/// The distance along a line, mm, of its point nearest to a place.
fn nearest_mm(line: &[[f64; 3]], at: [f64; 3]) -> f64 {
    let mut along = 0.0;
    let mut best = (f64::INFINITY, 0.0);
    for (n, &p) in line.iter().enumerate() {
        along += n.checked_sub(1).map_or(0.0, |before| distance(line[before], p));
        best = if distance(p, at) < best.0 { (distance(p, at), along) } else { best };
    }
    best.1
}

#[test]
fn two_positions_of_a_phantom_are_matched_and_a_scan_is_matched_with_itself() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let (a, b, truth) = (at("a.nii"), at("b.nii"), at("t.json"));
    let parts = "folds,polyps,pools,noise";
    run(
        &[
            "phantom", "--size", "small", "--seed", "21", "--with", parts, "--out", &a, "--second", &b, "--truth",
            &truth,
        ],
        0,
    );
    run(&["match", &a, &b, "--out", &at("m.json"), "--stats", &at("s.json")], 0);
    let (found, truth) = (read(&at("m.json")), read(&truth));
    let pairs: Vec<[f64; 3]> = serde_json::from_value(found["pairs"].clone()).unwrap();
    assert!(pairs.windows(2).all(|w| w[0][0] < w[1][0] && w[0][1] <= w[1][1]), "in order");
    let along: Vec<[f64; 2]> = serde_json::from_value(truth["second"]["along_mm"].clone()).unwrap();
    let collapsed: Vec<[f64; 2]> = serde_json::from_value(truth["second"]["collapsed"].clone()).unwrap();
    let open = |mm: f64| collapsed.iter().all(|[from, to]| mm < from - 10.0 || mm > to + 10.0);
    // The lines of the scans differ from the axes by some millimetres of length.
    let own: Vec<Vec<[f64; 3]>> = [(&a, "a.json"), (&b, "b.json")]
        .map(|(scan, name)| {
            run(&["centerline", scan, "--out", &at(name)], 0);
            points(&read(&at(name))["points"])
        })
        .into();
    let axes = [points(&truth["centerline"]), points(&truth["second"]["centerline"])];
    let mut errors: Vec<f64> = along
        .iter()
        .filter(|[_, b]| open(*b))
        .map(|[a, b]| {
            let [a, b] = [(0, *a), (1, *b)].map(|(n, mm)| nearest_mm(&own[n], place(&axes[n], mm)));
            let near = pairs.iter().min_by(|p, q| (p[0] - a).abs().total_cmp(&(q[0] - a).abs())).unwrap();
            (near[1] + a - near[0] - b).abs()
        })
        .collect();
    errors.sort_by(f64::total_cmp);
    let (median, most) = (errors[errors.len() / 2], errors[errors.len() * 95 / 100]);
    assert!(median < 3.0 && most < 8.0, "median {median} mm, 95 % {most} mm");
    assert!(!found["gaps"]["b"].as_array().unwrap().is_empty(), "a stretch of the second is collapsed");
    assert!(read(&at("s.json"))["prepare"]["match_s"].as_f64() > Some(0.0));

    run(&["match", &a, &a, "--out", &at("same.json"), "--threads", "1"], 0);
    let same: Vec<[f64; 3]> = serde_json::from_value(read(&at("same.json"))["pairs"].clone()).unwrap();
    assert!(same.iter().all(|[a, b, _]| (a - b).abs() < 2.0));
    // The same bytes on any number of threads.
    run(&["match", &a, &b, "--out", &at("one.json"), "--threads", "1"], 0);
    assert!(fs::read(at("one.json")).unwrap() == fs::read(at("m.json")).unwrap());
}

#[test]
fn what_cannot_be_matched_is_told_in_a_line() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let a = at("a.nii");
    run(&["phantom", "--size", "small", "--with", "folds", "--out", &a], 0);
    run(&["match", &a, &at("none.nii"), "--out", &at("m.json")], 3);
    run(&["match", &a, &a, "--out", &at("no/m.json")], 5);
    run(&["match", &a, "--out", &at("m.json")], 2);
    assert!(!Path::new(&at("m.json")).exists());
}
