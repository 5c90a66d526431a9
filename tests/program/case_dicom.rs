//! The DICOM objects of `colvis case`, read by independent judges; and whose scan its files tell.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::case::Read;
use crate::support::checks::cases;
use crate::support::run::run;
use crate::support::scan_study::write_scan;
use crate::support::skips::skip;
use colvis::progress::Progress;
use colvis::volume::io::{self, LoadOptions};

/// What the headers of a study tell of the patient.
const SECRETS: [&str; 6] = ["Featherstone", "Marjoribanks", "SECRET7", "19500102", "1950-01-02", "1.2.826.0.1.99"];
/// Runs a judge; `None` if it is not here.
fn judge(program: &str, args: &[&str]) -> Option<Output> {
    match Command::new(program).args(args).output() {
        Ok(output) => Some(output),
        Err(_) => {
            skip("judges", &format!("{program} is not here"));
            None
        }
    }
}

fn said(output: &Output) -> String {
    [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text).into_owned()).concat()
}

/// Returns the objects of a report.
fn objects(report: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(report).unwrap().map(|e| e.unwrap().path());
    let mut list: Vec<PathBuf> = entries.filter(|p| p.extension().is_some_and(|e| e == "dcm")).collect();
    list.sort();
    list
}

/// `dciodvfy`, `dsrdump` and Python's readers have nothing against a report's objects.
fn judged(report: &Path, mask: &str, study: &str, has_identity: bool) {
    for path in objects(report) {
        let path = path.to_str().unwrap();
        let Some(output) = judge("dciodvfy", &["-new", path]) else { break };
        let said = said(&output);
        assert!(said.lines().all(|l| !l.starts_with("Error")), "{path}: {said}");
    }
    let file = report.join("report.dcm");
    if let Some(output) = judge("dsrdump", &[file.to_str().unwrap()]) {
        assert!(output.status.success() && said(&output).contains("Comprehensive 3D SR"), "{}", said(&output));
    }
    let Ok(python) = std::env::var("COLVIS_PEERS") else {
        return skip("peers", "COLVIS_PEERS names no Python with highdicom and pydicom");
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/program/case_dicom.py");
    let identity = if has_identity { "yes" } else { "no" };
    let args = [script.to_str().unwrap(), report.to_str().unwrap(), mask, study, identity];
    let output = judge(&python, &args).unwrap();
    assert_eq!(String::from_utf8_lossy(&output.stdout).trim(), "ok", "{}", said(&output));
}

/// Returns the files of a folder that hold one of the patient's secrets.
fn telling(folder: &Path) -> Vec<String> {
    let mut list = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let bytes = std::fs::read(&path).unwrap();
        let holds = |secret: &&str| bytes.windows(secret.len()).any(|w| w.eq_ignore_ascii_case(secret.as_bytes()));
        list.extend(SECRETS.iter().filter(|s| holds(s)).map(|s| format!("{}: {s}", path.display())));
    }
    list
}

#[test]
fn a_dicom_study_becomes_objects_that_others_read_and_only_asked_for_says_whose_it_is() {
    let case = Read::new("folds,polyps,fluid,noise");
    case.findings();
    let volume = io::load(&case.path("scan.nii.gz"), &LoadOptions::default(), &Progress::new()).unwrap().volume;
    let (mask, findings) = (case.text("mask.nii.gz"), case.text("findings.json"));
    run(&["segment", &case.text("scan.nii.gz"), "--out", &mask], 0);
    let positions = [("FFP", [false, true]), ("HFS", [false, false]), ("HFP", [true, true]), ("FFS", [true, false])];
    for (position, turned) in positions.into_iter().take(cases(4, 1)) {
        let (folder, report) = (case.path(position), case.path(&format!("{position}-report")));
        write_scan(&volume, turned, position, &folder);
        let [study, out] = [&folder, &report].map(|p| p.to_str().unwrap());
        let args = ["case", study, "--findings", &findings, "--out", out, "--dicom"];
        run(&[&args[..], &["--identity"]].concat(), 0);
        judged(&report, &mask, study, true);
        let told = telling(&report);
        // The page, too, but not what other programs get.
        assert!(told.iter().any(|t| t.contains("report.html: SECRET7")) && told.iter().all(|t| !t.contains(".json")));
        if position == positions[0].0 {
            let stats = report.join("stats.json");
            let output = run(&[&args[..], &["--stats", stats.to_str().unwrap()]].concat(), 0);
            judged(&report, &mask, study, false);
            assert_eq!(telling(&report), [""; 0]);
            let said = said(&output);
            assert!(SECRETS.iter().all(|secret| !said.contains(secret)), "{said}");
        }
    }
}

#[test]
#[ignore = "slow: judges of 6 seconds and more"]
fn templates_are_met_and_segments_become_images() {
    let case = Read::new("folds,polyps");
    case.findings();
    let volume = io::load(&case.path("scan.nii.gz"), &LoadOptions::default(), &Progress::new()).unwrap().volume;
    write_scan(&volume, [true, true], "HFP", &case.path("study"));
    let (study, findings, out) = (case.text("study"), case.text("findings.json"), case.text("case"));
    run(&["case", &study, "--findings", &findings, "--out", &out, "--dicom", "--identity"], 0);
    let report = case.path("case");
    let file = |name: &str| report.join(name).to_str().unwrap().to_owned();
    // The rules are larger than what Java takes for safe.
    let limits = ["ExprOp", "ExprGrp", "TotalOp"].map(|what| format!("-Djdk.xml.xpath{what}Limit=0"));
    let jar = "/usr/share/java/pixelmed.jar";
    let report_file = file("report.dcm");
    let args = [&limits[0], &limits[1], &limits[2], "-cp", jar, "com.pixelmed.validate.DicomSRValidator", &report_file];
    if !Path::new(jar).exists() {
        return skip("judges", "libpixelmed-java is not here");
    }
    let Some(output) = judge("java", &args) else { return };
    let told = said(&output);
    assert!(told.contains("Found Root Template TID_1500") && !told.contains("Error"), "{told}");

    let Some(python) = std::env::var_os("COLVIS_PEERS") else {
        return skip("peers", "COLVIS_PEERS names no Python with dcmqi");
    };
    let tool = |name: &str| Path::new(&python).with_file_name(name).to_str().unwrap().to_owned();
    let meta = case.text("sr.json");
    let Some(output) = judge(&tool("tid1500reader"), &["--inputDICOM", &report_file, "--outputMetadata", &meta]) else {
        return;
    };
    assert!(output.status.success(), "{}", said(&output));
    let meta: serde_json::Value = serde_json::from_slice(&std::fs::read(meta).unwrap()).unwrap();
    assert_eq!(meta["Measurements"].as_array().unwrap().len(), 4);
    assert_eq!(meta["Measurements"][0]["TrackingIdentifier"], "finding 1");
    let images = case.text("images");
    std::fs::create_dir(&images).unwrap();
    let args = ["--inputDICOM", &file("segments.dcm"), "--outputDirectory", &images, "--outputType", "nii"];
    let output = judge(&tool("segimage2itkimage"), &args).unwrap();
    assert!(output.status.success() && Path::new(&images).join("1.nii.gz").exists(), "{}", said(&output));
}

#[test]
fn without_a_header_that_tells_there_is_no_identity() {
    let case = Read::new("folds,polyps");
    case.findings();
    let output = case.case(&["--identity"], 0);
    assert!(String::from_utf8_lossy(&output.stderr).contains("does not tell whose scan it is"), "{}", said(&output));
    let page = std::fs::read_to_string(case.path("case/report.html")).unwrap();
    assert!(page.contains("Without name or number of the patient"));
}
