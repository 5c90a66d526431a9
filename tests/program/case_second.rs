//! `colvis case --second`: what of the findings is in the patient's other position.

use std::fs;

use glam::DVec3;
use serde_json::{Value, json};

use crate::support::run::run;

/// A polyp is expected within this of where it is, mm: about the error of the match along the colon and about it.
const EXPECTED_MM: f64 = 12.0;

fn read(path: &str) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

fn place(value: &Value) -> DVec3 {
    serde_json::from_value(value.clone()).unwrap()
}

#[test]
fn a_finding_is_told_in_both_positions_and_expected_where_it_was_not_marked() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let (a, b, t) = (at("a.nii"), at("b.nii"), at("t.json"));
    let size = ["--size", "small", "--seed", "21", "--with", "folds,polyps,pools,noise"];
    run(&[&["phantom", "--out", &a, "--second", &b, "--truth", &t], &size[..]].concat(), 0);
    let truth = read(&t);
    let [here, there] =
        [&truth["polyps"], &truth["second"]["polyps"]].map(|list| list.as_array().unwrap().iter().collect::<Vec<_>>());
    assert!(here.len() >= 3 && here.len() == there.len());
    let hash = |scan: &str| {
        let info: Value = serde_json::from_slice(&run(&["info", scan], 0).stdout).unwrap();
        info["content"].as_str().unwrap().to_owned()
    };
    let scan = hash(&a);
    let finding = |n: usize, other: Value| json!({"id": n, "place": here[n]["position"], "other": other});
    let findings = json!({"version": 1, "scan": scan, "second": null, "findings": [
        finding(0, there[0]["position"].clone()),
        finding(1, Value::Null),
        finding(2, Value::Null),
    ]});
    fs::write(at("f.json"), findings.to_string()).unwrap();
    let case = |second: &str, out: &str, status: i32| {
        let out = run(&["case", &a, "--second", second, "--findings", &at("f.json"), "--out", &at(out)], status);
        String::from_utf8(out.stderr).unwrap()
    };
    case(&b, "report", 0);
    let told = read(&at("report/findings.json"));
    assert_eq!(told["second"], json!(hash(&b)));
    // Only what was marked there is a markup there.
    let marked = &read(&at("report/second.mrk.json"))["markups"][0]["controlPoints"];
    assert_eq!(marked.as_array().unwrap().len(), 1);
    assert!(place(&marked[0]["position"]).distance(place(&there[0]["position"])) < 1e-6);
    let page = fs::read_to_string(at("report/report.html")).unwrap();
    let expected: Vec<DVec3> = page
        .split("<p>Second position: not marked; expected")
        .skip(1)
        .map(|rest| {
            let at = rest.split("At ").nth(1).unwrap().split(" mm there").next().unwrap();
            let xyz: Vec<f64> = at.split(", ").map(|x| x.parse().unwrap()).collect();
            DVec3::new(xyz[0], xyz[1], xyz[2])
        })
        .collect();
    assert_eq!(expected.len(), 2);
    for (place_there, polyp) in expected.iter().zip(&there[1..]) {
        let away = place_there.distance(place(&polyp["position"]));
        assert!(away < EXPECTED_MM, "{away:.1} mm away");
    }
    assert!(page.contains("Second position: marked,") && page.contains("Quality by segment, second position"));

    // Findings that name another second scan, and a second scan that is none.
    let mut other = findings;
    other["second"] = json!(format!("sha256:{}", "0".repeat(64)));
    fs::write(at("f.json"), other.to_string()).unwrap();
    assert!(case(&b, "none", 3).contains("names another second scan"));
    assert!(!dir.path().join("none").exists());
    case(&at("gone.nii"), "none", 3);
}

#[cfg(feature = "dicom")]
#[test]
fn another_patient_is_refused_unless_forced() {
    use crate::support::dicom::Slice;

    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    for (name, patient) in [("a", "1"), ("b", "2")] {
        fs::create_dir(at(name)).unwrap();
        for z in 0..4 {
            let slice = Slice { patient: ["Doe", patient], ..Slice::at(f64::from(z)) };
            fs::write(dir.path().join(name).join(format!("{z}.dcm")), slice.bytes()).unwrap();
        }
    }
    let findings = json!({"version": 1, "scan": format!("sha256:{}", "0".repeat(64)), "findings": []});
    fs::write(at("f.json"), findings.to_string()).unwrap();
    let case = |more: &[&str]| {
        let (a, b, f, out) = (at("a"), at("b"), at("f.json"), at("out"));
        let out = run(&[&["case", &a, "--second", &b, "--findings", &f, "--out", &out], more].concat(), 3);
        String::from_utf8(out.stderr).unwrap()
    };
    assert!(case(&[]).contains("another patient"));
    // Forced, the next fault is told.
    assert!(case(&["--force"]).contains("belongs to another scan"));
}
