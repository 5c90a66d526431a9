//! `colvis phantom --second`: the same patient in the other position, and the truth that maps points both ways.

use std::path::Path;

use colvis::phantom::{Position, Truth};
use glam::DVec3;
use serde_json::Value;

use crate::support::run::run;

fn json(path: &str) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// Returns the distance of `p` to a line, mm.
fn off(p: DVec3, line: &[DVec3]) -> f64 {
    let to_piece = |ends: &[DVec3]| {
        let along = ends[1] - ends[0];
        let t = ((p - ends[0]).dot(along) / along.length_squared()).clamp(0.0, 1.0);
        p.distance(ends[0] + along * t)
    };
    line.windows(2).map(to_piece).fold(f64::INFINITY, f64::min)
}

#[test]
#[ignore = "slow: five phantoms, and a line through one"]
fn the_second_position_is_a_scan_whose_truth_maps_points_both_ways() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let with = "folds,polyps,pools,stool,noise";
    let plain = ["phantom", "--size", "small", "--with", with, "--seed", "2", "--slice", "1.8", "--out"];
    run(&[&plain[..], &[&at("alone.nii"), "--truth", &at("alone.json")]].concat(), 0);
    let both = |n: &str, more: &[&str]| {
        let [a, b, t] = ["a.nii", "b.nii", "t.json"].map(|name| at(&format!("{n}{name}")));
        run(&[&plain[..], &[&a, "--second", &b, "--truth", &t], more].concat(), 0);
        [a, b, t].map(|path| std::fs::read(path).unwrap())
    };
    let one = both("1", &["--threads", "1"]);
    assert!(one == both("2", &["--threads", "2", "--twin", &at("twin.nii")]), "on one thread and on two");
    assert!(one[0] == std::fs::read(at("alone.nii")).unwrap(), "the first is the same with and without a second");
    let mut told = json(&at("1t.json"));
    told.as_object_mut().unwrap().remove("second").unwrap();
    assert_eq!(told, json(&at("alone.json")));

    let truth: Truth = serde_json::from_value(json(&at("1t.json"))).unwrap();
    let second = truth.second.as_ref().unwrap();
    assert_eq!((truth.position, second.truth.position), (Position::Supine, Position::Prone));
    assert_eq!(second.truth.polyps.len(), truth.polyps.len());
    let [[from, to]] = second.truth.collapsed[..] else { panic!("{:?}", second.truth.collapsed) };
    assert!((25.0..=50.0).contains(&(to - from)), "{from} to {to} mm");
    assert_eq!(second.along_mm.len(), second.turn_degrees.len());
    assert!(second.along_mm.windows(2).all(|p| p[0][0] < p[1][0] && p[0][1] < p[1][1]), "{:?}", second.along_mm);
    let last = second.along_mm.last().unwrap();
    assert!((last[0] - truth.length_mm).abs() < 1e-9 && (last[1] - second.truth.length_mm).abs() < 1e-9);

    // The line that the program finds in the second position, through what is collapsed, is the one that the pairs lie on.
    let (line, ends) = (at("c.json"), ["--from", "rectum", "--to", "cecum"]);
    run(&["segment", &at("1b.nii"), "--out", &at("mask.nii.gz"), "--picture", &at("b.png")], 0);
    run(&[&["centerline", &at("1b.nii"), "--out", &line], &ends[..]].concat(), 0);
    let found: Vec<DVec3> = serde_json::from_value(json(&line)["points"].clone()).unwrap();
    let length = json(&line)["length_mm"].as_f64().unwrap();
    assert!((length / second.truth.length_mm - 1.0).abs() < 0.1, "{length} mm of {} mm", second.truth.length_mm);
    let axis = &second.truth.centerline;
    let step = second.truth.length_mm / (axis.len() - 1) as f64;
    let mut offs = Vec::new();
    for [_, s] in &second.along_mm {
        // The line ends before the end walls, and is a guess where there is no gas.
        let is_open = !(from - 15.0..=to + 15.0).contains(s);
        if is_open && (25.0..second.truth.length_mm - 25.0).contains(s) {
            offs.push(off(axis[(s / step).round() as usize], &found));
        }
    }
    offs.sort_by(f64::total_cmp);
    println!("off the line: median {:.2} mm, most {:.2} mm", offs[offs.len() / 2], offs[offs.len() - 1]);
    assert!(offs[offs.len() / 2] < 2.0 && offs[offs.len() - 1] < 6.0, "{offs:?}");
    // Rings of points in both positions are about the two axes, on the wall.
    let points = &second.points;
    assert!(points.first.len() == points.second.len() && points.first.len() > 500);
    for (points, line) in [(&points.first, &truth.centerline), (&points.second, axis)] {
        assert!(points.iter().all(|p| (1.5..22.0).contains(&off(*p, line))), "a point is not on the wall");
    }
}

#[test]
fn what_has_no_second_position_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let [out, second] = ["o.nii.gz", "s.nii.gz"].map(at);
    let said = |args: &[&str], status| String::from_utf8_lossy(&run(args, status).stderr).into_owned();
    let phantom = ["phantom", "--size", "small", "--out", &out, "--second"];
    let touching = said(&[&phantom[..], &[&second, "--with", "folds,touching"]].concat(), 2);
    assert!(touching.contains("--second") && touching.contains("limbs that touch"), "{touching}");
    run(&[&phantom[..], &[&out]].concat(), 2);
    run(&[&phantom[..], &[&at("s.txt")]].concat(), 2);
    run(&[&phantom[..], &[&at("none/s.nii")]].concat(), 5);
    // It would be the position of a phantom.
    let into = said(&["phantom", "--into", &at("scan.nii.gz"), "--out", &out, "--second", &second], 2);
    assert!(into.contains("--second") && !Path::new(&out).exists(), "{into}");
}
