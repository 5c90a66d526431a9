//! `colvis case`: the report of a reading and its files for other programs.

use std::path::{Path, PathBuf};
use std::process::Command;

use colvis::progress::Progress;
use colvis::volume::io::{self, LoadOptions};
use serde_json::{Value, json};

use crate::support::run::run;
use crate::support::skips::skip;

fn read(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

/// A phantom's scan and the findings of somebody who has found its polyps.
pub(crate) struct Read {
    folder: tempfile::TempDir,
    polyps: Vec<Value>,
}

impl Read {
    pub(crate) fn new(with: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let [scan, truth] = ["scan.nii.gz", "truth.json"].map(|name| folder.path().join(name));
        let [scan, truth] = [&scan, &truth].map(|p| p.to_str().unwrap());
        run(&["phantom", "--size", "small", "--with", with, "--seed", "3", "--out", scan, "--truth", truth], 0);
        let polyps = read(Path::new(truth))["polyps"].as_array().unwrap().clone();
        Self { folder, polyps }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn text(&self, name: &str) -> String {
        self.path(name).to_str().unwrap().to_owned()
    }

    /// Writes the findings, as a program that knows little else does. Returns them.
    pub(crate) fn findings(&self) -> Value {
        let info: Value = serde_json::from_slice(&run(&["info", &self.text("scan.nii.gz")], 0).stdout).unwrap();
        let finding =
            |(n, p): (usize, &Value)| json!({ "id": n + 1, "place": p["position"], "note": format!("<b>{n}</b>") });
        let findings: Vec<Value> = self.polyps.iter().take(3).enumerate().map(finding).collect();
        let outside = json!([{ "place": self.polyps[0]["position"], "category": "E3", "text": "a cyst & more" }]);
        let answers = json!([{ "rank": 1, "position": self.polyps[0]["position"], "answer": "yes", "note": "seen" }]);
        let quality = json!([{ "segment": "sigmoid", "seconds": 75.0, "coverage": 0.5 }]);
        let all = json!({
            "version": 1, "scan": info["content"], "second": null, "findings": findings, "outside": outside, "answers": answers,
            "quality": quality, "distances": [], "kinds": [],
        });
        std::fs::write(self.path("findings.json"), all.to_string()).unwrap();
        all
    }

    pub(crate) fn case(&self, more: &[&str], status: i32) -> std::process::Output {
        let (scan, findings, out) = (self.text("scan.nii.gz"), self.text("findings.json"), self.text("case"));
        let args = ["case", &scan, "--findings", &findings, "--out", &out];
        run(&[&args[..], more].concat(), status)
    }
}

#[test]
fn a_reading_becomes_a_page_and_files_for_other_programs() {
    let case = Read::new("folds,polyps,fluid,noise");
    let given = case.findings();
    let stats = case.text("stats.json");
    case.case(&["--stats", &stats], 0);
    let out = case.path("case");
    let html = std::fs::read_to_string(out.join("report.html")).unwrap();
    assert!(html.starts_with("<!DOCTYPE html>") && html.trim_end().ends_with("</html>"));
    for outside in ["src=\"", "href=\"http", "<script", "@import", "<b>0</b>"] {
        assert!(!html.contains(outside), "{outside}");
    }
    // Without the pictures, whose letters are arbitrary.
    let words: String = html.split("base64,").map(|part| part.split_once('"').map_or(part, |(_, rest)| rest)).collect();
    for told in [
        "&lt;b&gt;0&lt;/b&gt;",
        "E3",
        "a cyst &amp; more",
        "Not for diagnosis",
        "1:15",
        "50 %",
        "As entered",
        "a polyp</td>",
    ] {
        let told = told.replace("As entered", "as entered");
        assert!(words.contains(&told), "{told}");
    }
    assert!(!words.contains("NaN") && !words.contains("inf "));
    // Three pictures of each finding, and three with the tag; and the map.
    assert_eq!(html.matches("<image ").count(), 3 * 6 + 1);

    let written = read(&out.join("findings.json"));
    let stats = read(Path::new(&stats));
    assert_eq!(written["scan"], given["scan"]);
    let mut large = 0;
    for (n, (finding, polyp)) in written["findings"].as_array().unwrap().iter().zip(&case.polyps).enumerate() {
        assert_eq!(finding["place"], given["findings"][n]["place"]);
        assert!(finding["view"]["fov_degrees"].is_number() && finding["along_mm"].is_number(), "{finding}");
        assert!(finding["segment"].is_string(), "{finding}");
        let (mm, truth) = (finding["diameter_mm"].as_f64(), polyp["diameter_mm"].as_f64().unwrap());
        assert!(mm.is_none_or(|mm| (mm - truth).abs() < 2.5), "{mm:?} of {truth}");
        large += usize::from(mm.is_some_and(|mm| mm.round() >= 6.0));
    }
    assert!(large > 0);
    let category = stats["category"].as_str().unwrap();
    assert!(["C0", "C2a", "C3"].contains(&category) && html.contains(&format!("<strong>{category}</strong>")));
    assert_eq!(stats["quality"].as_array().unwrap().len(), 8);

    let marks = read(&out.join("findings.mrk.json"));
    let points = marks["markups"][0]["controlPoints"].as_array().unwrap();
    for (point, finding) in points.iter().zip(given["findings"].as_array().unwrap()) {
        assert_eq!(point["position"], finding["place"]);
    }
    let line = read(&out.join("centerline.mrk.json"));
    assert!(line["markups"][0]["controlPoints"].as_array().unwrap().len() > 300);

    // The labels are those of `segment`, with names.
    let mask = case.text("mask.nii.gz");
    run(&["segment", &case.text("scan.nii.gz"), "--out", &mask], 0);
    let load = |path: &Path| io::load_mask(path, &LoadOptions::default(), &Progress::new()).unwrap().volume;
    let (mask, labels) = (load(Path::new(&mask)), load(&out.join("lumen.seg.nrrd")));
    assert!(mask.data().iter().zip(labels.data()).all(|(m, l)| (*m != 0) == (*l != 0)));
    assert!((1..=8).all(|label| labels.data().contains(&label)));
    let head = std::fs::read(out.join("lumen.seg.nrrd")).unwrap();
    let head = String::from_utf8_lossy(&head[..4000]).into_owned();
    assert!(head.contains("Segment0_Name:=rectum\n") && head.contains("Segment7_Name:=cecum\n"), "{head}");
    judged_by_another_reader(&out.join("lumen.seg.nrrd"), labels.data().iter().map(|l| i64::from(*l)).sum());

    // A scan that nobody has read says so.
    assert!(!html.contains("No reading is noted"));
    let unread = json!({ "version": 1, "scan": given["scan"], "findings": [] }).to_string();
    std::fs::write(case.path("findings.json"), unread).unwrap();
    case.case(&[], 0);
    assert!(std::fs::read_to_string(out.join("report.html")).unwrap().contains("No reading is noted"));
    std::fs::write(case.path("findings.json"), given.to_string()).unwrap();
    case.case(&[], 0);

    // The same again, byte by byte, and in another scheme.
    let before: Vec<Vec<u8>> = files(&out);
    case.case(&["--threads", "1"], 0);
    assert_eq!(files(&out), before);
    case.case(&["--scheme", "england"], 0);
    assert!(std::fs::read_to_string(out.join("report.html")).unwrap().contains("NHS England"));
}

/// Returns the files of a report.
fn files(folder: &Path) -> Vec<Vec<u8>> {
    let mut names: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    names.sort();
    assert_eq!(names.len(), 5, "{names:?}");
    names.iter().map(|path| std::fs::read(path).unwrap()).collect()
}

/// SimpleITK reads the same labels.
fn judged_by_another_reader(path: &Path, sum: i64) {
    let Some(python) = std::env::var_os("COLVIS_PEERS") else {
        return skip("peers", "COLVIS_PEERS names no Python with SimpleITK");
    };
    let script = "import sys, SimpleITK as s; i = s.ReadImage(sys.argv[1]); print(int(s.GetArrayFromImage(i).astype('int64').sum()), i.GetMetaData('Segment0_Name'))";
    let output = Command::new(python).args(["-c", script]).arg(path).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(String::from_utf8_lossy(&output.stdout).trim(), format!("{sum} rectum"));
}

#[test]
fn findings_of_another_scan_and_files_that_are_none_are_refused_and_nothing_is_written() {
    let case = Read::new("folds,polyps");
    let good = case.findings();
    let changed = |key: &str, to: Value| {
        let mut all = good.clone();
        all[key] = to;
        all.to_string()
    };
    let hash = format!("sha256:{}", "0".repeat(64));
    for (text, told) in [
        (changed("scan", json!(hash)), "belongs to another scan"),
        (changed("scan", json!("00ff")), "not the hash of a scan"),
        (changed("version", json!(9)), "has version 9"),
        (changed("findings", json!([{ "place": [1, 2] }])), "invalid"),
        (changed("findings", json!([{ "place": [9000, 0, 0] }])), "outside the scan"),
        ("{".to_owned(), "EOF"),
    ] {
        std::fs::write(case.path("findings.json"), text).unwrap();
        let output = case.case(&[], 3);
        let said = String::from_utf8_lossy(&output.stderr);
        let errors: Vec<&str> = said.lines().filter(|l| l.starts_with("error: ")).collect();
        assert!(errors.len() == 1 && errors[0].contains(told), "{told}: {said}");
        let is_empty = std::fs::read_dir(case.path("case")).map_or(true, |mut files| files.next().is_none());
        assert!(is_empty, "{told}");
    }
    std::fs::write(case.path("findings.json"), good.to_string()).unwrap();
    case.case(&["--scheme", "mine"], 2);
    std::fs::remove_file(case.path("findings.json")).unwrap();
    case.case(&[], 3);
}

#[test]
#[ignore = "slow: 3D Slicer"]
fn slicer_reads_findings_centerline_and_segments() {
    let Some(python) = std::env::var_os("COLVIS_SLICER").filter(|path| Path::new(path).exists()) else {
        return skip("slicer", "COLVIS_SLICER names no Python with slicer-core");
    };
    let case = Read::new("folds,polyps,fluid");
    case.findings();
    case.case(&[], 0);
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/program/case_slicer.py");
    let output = Command::new(python).arg(script).arg(case.path("case")).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(String::from_utf8_lossy(&output.stdout).lines().last(), Some("ok"), "{said}");
}

/// Whenever it is stopped, the report is the one before or the new one, never a part of it.
#[cfg(unix)]
#[test]
#[ignore = "slow: eighteen reports"]
fn a_report_that_is_interrupted_or_killed_leaves_the_one_before_whole() {
    use std::time::{Duration, Instant};
    let case = Read::new("folds,polyps");
    case.findings();
    let dicom: &[&str] = if cfg!(feature = "dicom") { &["--dicom"] } else { &[] };
    case.case(dicom, 0);
    let out = case.path("case");
    let all = || {
        let entries = std::fs::read_dir(&out).unwrap().map(|e| e.unwrap().path());
        // What was being written when it was killed is hidden, and goes with the next report.
        let is_shown = |p: &PathBuf| !p.file_name().unwrap().to_str().unwrap().starts_with('.');
        let mut paths: Vec<PathBuf> = entries.filter(is_shown).collect();
        paths.sort();
        paths.into_iter().map(|p| (p.clone(), std::fs::read(p).unwrap())).collect::<Vec<_>>()
    };
    let before = all();
    let begun = Instant::now();
    case.case(&[dicom, &["--scheme", "england"]].concat(), 0);
    let (took, after) = (begun.elapsed(), all());
    assert_ne!(before, after);
    let (mut kept, mut written) = (0, 0);
    for n in 0..16 {
        case.case(dicom, 0);
        assert_eq!(all(), before);
        let (scan, findings, folder) = (case.text("scan.nii.gz"), case.text("findings.json"), case.text("case"));
        let mut child = crate::support::program::colvis()
            .args(["case", &scan, "--findings", &findings, "--out", &folder, "--scheme", "england"])
            .args(dicom)
            .stderr(std::process::Stdio::null())
            .spawn()
            .unwrap();
        // Most of them while files are written, at the end.
        std::thread::sleep(took.mul_f64(0.55 + 0.03 * f64::from(n)) + Duration::from_millis(1));
        if n % 2 == 0 {
            child.kill().unwrap();
        } else {
            let id = child.id().to_string();
            Command::new("kill").args(["-INT", &id]).status().unwrap();
        }
        child.wait().unwrap();
        let left = all();
        assert!(left == before || left == after, "{n}: {:?}", left.iter().map(|f| &f.0).collect::<Vec<_>>());
        kept += usize::from(left == before);
        written += usize::from(left == after);
    }
    println!("{kept} of the report before, {written} new ones");
}
