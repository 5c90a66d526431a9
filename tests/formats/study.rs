//! A folder with several series: their list, the choice among them, and no word about the patient.

use std::path::Path;
use std::process::{Command, Output};

use crate::support::dicom::Slice;
use crate::support::reading::load;
use crate::support::series::write_series;
use crate::support::study::{SECRETS, capture, localizer, report, supine, write_rest, write_study};
use colvis::progress::Progress;
use colvis::volume::io::{self, LoadOptions};
use serde_json::{Value, json};

/// Runs the program on a study and returns its output, which must not name a patient.
fn run(folder: &Path, args: &[&str], status: i32) -> Output {
    let out = Command::new(env!("CARGO_BIN_EXE_colvis")).args(args).current_dir(folder).output().unwrap();
    let said = format!("{}{}", String::from_utf8_lossy(&out.stdout), String::from_utf8_lossy(&out.stderr));
    assert_eq!(out.status.code(), Some(status), "{args:?}: {said}");
    let lower = said.to_lowercase();
    assert!(SECRETS.iter().all(|s| !lower.contains(s)), "{args:?} names a patient: {said}");
    out
}

fn study() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    std::fs::create_dir(dir.path().join("study")).unwrap();
    write_study(&dir.path().join("study"));
    dir
}

fn choose(n: usize) -> LoadOptions {
    LoadOptions { series: Some(n), ..LoadOptions::default() }
}

#[test]
fn a_list_comes_before_one_short_line_of_error() {
    let dir = study();
    for args in [&["info", "study"][..], &["segment", "study", "--out", "m.nii.gz"]] {
        let out = run(dir.path(), args, 3);
        assert!(out.stdout.is_empty());
        let said = String::from_utf8(out.stderr).unwrap();
        let lines: Vec<&str> = said.lines().collect();
        let expected = [
            "note: 1  CT   2 slices  0.50×0.75×2.50 mm  supine  -        patient 1  Topogram (cannot be opened: a localizer)",
            "note: 2  CT  12 slices  0.50×0.75×2.50 mm  supine  axial    patient 1  Colon supine, … … (same patient as 3)",
            "note: 3  CT  11 slices  0.50×0.75×2.50 mm  prone   axial    patient 1  Colon prone (same patient as 2, 4)",
            "note: 4  CT  10 slices  0.50×0.75×3.00 mm  supine  coronal  patient 1  Coronal (same patient as 3)",
            "note: 5  CT   1 slice   -                  supine  -        patient 1  Screen (cannot be opened: a secondary capture)",
            "note: 6  CT  14 slices  0.50×0.75×2.50 mm  supine  axial    patient 2  Abdomen",
            "note: 7  SR   0 slices  -                  supine  -        patient 1  Dose report (cannot be opened: no image)",
            "error: study: holds 7 series, 4 of them CT, and none has far more slices; choose one with --series N",
        ];
        let squeezed = |l: &str| l.split_whitespace().collect::<Vec<_>>().join(" ");
        assert_eq!(lines.iter().map(|l| squeezed(l)).collect::<Vec<_>>(), expected.map(squeezed), "{said}");
        // The columns are aligned.
        let column = |l: &&str| l.find("patient ").map(|at| l[..at].chars().count());
        assert!(lines[..7].iter().all(|l| column(l) == column(&lines[0])), "{said}");
    }
}

#[test]
fn info_lists_every_series_beside_the_chosen_one() {
    let dir = study();
    let out = run(dir.path(), &["info", "study", "--series", "3"], 0);
    let info: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!((&info["dims"][2], &info["patient_position"]), (&json!(11), &json!("HFP")));
    let series = info["series"].as_array().unwrap();
    let expected = json!({
        "series": 3, "number": 3, "modality": "CT", "slices": 11, "columns": 6, "rows": 4, "spacing_mm": [0.5, 0.75, 2.5],
        "position": "prone", "description": "Colon prone", "patient": 1, "study": 1, "plane": "axial", "usable": true,
        "why": null, "pair": [2, 4], "chosen": true,
    });
    assert_eq!((series.len(), &series[2]), (7, &expected));
    let of = |key: &str| series.iter().map(|s| s[key].clone()).collect::<Vec<_>>();
    assert_eq!(json!(of("pair")), json!([[], [3], [2, 4], [3], [], [], []]));
    assert_eq!(json!(of("patient")), json!([1, 1, 1, 1, 1, 2, 1]));
    assert_eq!(json!(of("study")), json!([1, 1, 1, 1, 1, 2, 1]));
    assert_eq!(json!(of("plane")), json!([null, "axial", "axial", "coronal", null, "axial", null]));
    assert_eq!(json!(of("usable")), json!([false, true, true, true, false, true, false]));
    assert_eq!(series[6]["why"], "no image");
}

#[test]
fn only_a_volume_of_ct_can_be_chosen() {
    let dir = study();
    let path = dir.path().join("study");
    for (n, slices) in [(2, 12), (3, 11), (4, 10), (6, 14)] {
        let volume = io::load(&path, &choose(n), &Progress::new()).unwrap().volume;
        assert_eq!(volume.grid().dims()[2], slices, "series {n}");
    }
    for (n, why) in [(1, "a localizer"), (5, "contains colours"), (7, "modality is SR"), (8, "has no series 8")] {
        let e = io::load(&path, &choose(n), &Progress::new()).unwrap_err();
        assert!(e.why.contains(why) && e.kind as i32 == 3, "series {n}: {e}");
    }
}

#[test]
fn what_is_no_scan_does_not_break_the_choice() {
    let dir = tempfile::tempdir().unwrap();
    for (name, slices) in [("a", localizer()), ("b", capture()), ("c", report()), ("d", supine())] {
        std::fs::create_dir(dir.path().join(name)).unwrap();
        write_series(&dir.path().join(name), &slices);
    }
    write_rest(dir.path());
    let loaded = load(dir.path()).unwrap();
    assert_eq!(loaded.volume.grid().dims()[2], 12);
    assert_eq!(loaded.notes, ["series 2 of 4 was taken, the CT series with the most slices (12, supine)"]);
    // Damaged files of other series, and one whose series nobody knows.
    let prone: Vec<Vec<u8>> =
        (0..3).map(|k| Slice { series: "3".to_owned(), ..Slice::at(f64::from(k)) }.bytes()).collect();
    let end = prone[0].windows(4).position(|w| w == b"\x28\0\x10\0").unwrap();
    std::fs::write(dir.path().join("cut.dcm"), &prone[0][..end + 5]).unwrap();
    std::fs::write(dir.path().join("empty.dcm"), &prone[1][..200]).unwrap();
    let loaded = load(dir.path()).unwrap();
    assert_eq!(loaded.volume.grid().dims()[2], 12);
    assert!(loaded.notes.iter().any(|n| n.contains("left out unreadable files (1), the first: ")));
    // A damaged slice of the scan itself is an error.
    let path = dir.path().join("d").join("4.dcm");
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() - 5]).unwrap();
    assert!(load(dir.path()).unwrap_err().why.contains("ends early"));
}

#[test]
fn one_series_uid_for_two_patients_is_two_series() {
    let dir = tempfile::tempdir().unwrap();
    let other = |k| Slice { patient: ["Roe^Richard", "HIDDEN9"], ..Slice::at(f64::from(k)) };
    let slices: Vec<Slice> = (0..4).map(|k| Slice::at(f64::from(k))).chain((0..4).map(other)).collect();
    write_series(dir.path(), &slices);
    let e = load(dir.path()).unwrap_err();
    assert_eq!(e.choices.len(), 2, "{e}");
    assert!(e.choices[0].contains("patient 1") && e.choices[1].contains("patient 2"), "{:?}", e.choices);
}

#[test]
fn every_series_that_can_be_decoded_has_a_picture() {
    let dir = study();
    let study = io::study(&dir.path().join("study"), 72, &Progress::new()).unwrap();
    assert_eq!((study.series.len(), study.usual), (7, None));
    let sizes: Vec<_> = study.pictures.iter().map(|p| p.as_ref().map(|p| (p.width, p.height, p.grey.len()))).collect();
    // Six columns of 0.5 mm and four rows of 0.75 mm.
    let size = Some((72, 72, 72 * 72));
    assert_eq!(sizes, [size, size, size, size, None, size, None]);
    // The slice in the middle of twelve is at 15 mm: 360 to 383 HU more than that at 0.
    let first = 1000.0 + 24.0 * 15.0 - 1024.0;
    let grey = study.pictures[1].as_ref().unwrap().grey[0];
    assert_eq!(grey, (255.0 * (first + 1000.0) / 2000.0_f64).round() as u8);
    let nifti = dir.path().join("a.nii");
    io::save(
        &nifti,
        &io::load(&dir.path().join("study"), &choose(2), &Progress::new()).unwrap().volume,
        &Progress::new(),
    )
    .unwrap();
    assert!(io::study(&nifti, 72, &Progress::new()).unwrap().series.is_empty());
}
