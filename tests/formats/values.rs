//! What a value is: HU of oddly stored DICOM values against pydicom, and what is no HU.
//!
//! The first needs a Python with pydicom and numpy, which the environment variable `COLVIS_PEERS` names, and is skipped without it.

use std::path::Path;
use std::process::Command;

use colvis::progress::Progress;
use colvis::volume::{Volume, io};
use glam::{DMat3, DVec3};

use crate::support::dicom::Slice;
use crate::support::reading::load;
use crate::support::series::write_series;
use crate::support::skips::skip;

#[test]
fn hu_of_odd_values_are_those_of_pydicom() {
    let Some(python) = std::env::var_os("COLVIS_PEERS") else {
        return skip("peers", "COLVIS_PEERS names no Python with pydicom");
    };
    let dir = tempfile::tempdir().unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/formats/values.py");
    let output = Command::new(python).arg(script).arg(dir.path()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let cases: serde_json::Value =
        serde_json::from_slice(&std::fs::read(dir.path().join("cases.json")).unwrap()).unwrap();
    let cases = cases.as_array().unwrap();
    let mut wrong = Vec::new();
    for name in cases.iter().map(|c| c["name"].as_str().unwrap()) {
        let bytes = std::fs::read(dir.path().join(format!("{name}.i16"))).unwrap();
        let expected: Vec<i16> = bytes.as_chunks().0.iter().map(|b| i16::from_le_bytes(*b)).collect();
        match load(&dir.path().join(name)) {
            Err(e) => wrong.push(format!("{name}: {e}")),
            Ok(read) => {
                let read = read.volume.data();
                assert_eq!(read.len(), expected.len(), "{name}");
                let differ: Vec<usize> = (0..read.len()).filter(|&n| read[n] != expected[n]).collect();
                if let Some(&n) = differ.first() {
                    let (one, other) = (read[n], expected[n]);
                    wrong.push(format!("{name}: {} voxels, the first ({n}) is {one}, not {other}", differ.len()));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{} of {} cases:\n{}", wrong.len(), cases.len(), wrong.join("\n"));
    assert!(cases.len() >= 22, "the cases without a codec");
}

/// Slices of 32 × 32 voxels of a body with gas, whose HU are 1024 less than the stored values.
fn body() -> Vec<Slice> {
    (0..8u8)
        .map(|k| {
            let stored = |i: usize| match (i % 32, i / 32) {
                (x, y) if x.abs_diff(16) + y.abs_diff(16) < 6 => 24 + (i % 5) as u16,
                (x, y) => 1000 + 3 * (x + y) as u16,
            };
            Slice { rows: 32, cols: 32, pixels: (0..1024).map(stored).collect(), ..Slice::at(2.5 * f64::from(k)) }
        })
        .collect()
}

fn with(edit: impl Fn(Slice) -> Slice) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    write_series(dir.path(), &body().into_iter().map(edit).collect::<Vec<_>>());
    dir
}

fn notes(path: &Path) -> Vec<String> {
    load(path).unwrap().notes
}

#[test]
fn what_is_no_hu_is_refused_and_listed() {
    assert_eq!(notes(with(|s| s).path()), [""; 0]);
    assert_eq!(notes(with(|s| Slice { units: "HU", ..s }).path()), [""; 0]);
    for (term, what) in [("Z_EFF", "effective atomic numbers"), ("MGML", "densities in mg/ml"), ("PCT", "percentages")]
    {
        let dir = with(|s| Slice { units: term, ..s });
        let e = load(dir.path()).unwrap_err();
        assert_eq!(e.why, format!("holds {what} (RescaleType {term}), not HU"));
        assert_eq!(e.kind as u8, 3);
        let (value, told) = io::inspect(dir.path(), &io::LoadOptions::default(), &Progress::new()).unwrap();
        assert_eq!(told, [format!("holds {what} (RescaleType {term}), not HU")]);
        assert_eq!(value["series"][0]["why"], told[0].strip_prefix("holds ").unwrap());
    }
    // Common writers give every image the type US: its values tell.
    let us = |s: Slice| Slice { units: "US", ..s };
    let told = notes(with(us).path());
    assert_eq!(told, ["RescaleType is US (unspecified): its values are treated as HU"]);
    let raw = |s: Slice| Slice { intercept: "0", ..us(s) };
    let e = load(with(raw).path()).unwrap_err();
    assert!(e.why.contains("RescaleType is US") && e.why.contains("too high by about 102"), "{e}");
    let bare = |s: Slice| Slice { intercept: "", slope: "", ..s };
    let e = load(with(bare).path()).unwrap_err();
    assert!(e.why.starts_with("has no RescaleSlope and RescaleIntercept, and its air is near 2"), "{e}");
    let low = |s: Slice| Slice { pixels: s.pixels.iter().map(|p| p.wrapping_sub(1024)).collect(), ..bare(s) };
    let odd = "has no RescaleSlope and RescaleIntercept, and its air is near 2";
    let (_, told) = io::inspect(with(bare).path(), &io::LoadOptions::default(), &Progress::new()).unwrap();
    assert!(told.len() == 1 && told[0].starts_with(odd), "{told:?}");
    assert_eq!(notes(with(low).path()), ["has no RescaleSlope and RescaleIntercept: its values are treated as HU"]);
}

/// A body in a box of air, as a file of any format.
fn save(path: &Path, map: impl Fn(f64) -> f64) {
    let grid = colvis::volume::Grid::new([32, 32, 16], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
    let hu = |i: usize| if (i % 32).abs_diff(16) < 10 { 30.0 + (i % 70) as f64 } else { -1010.0 + (i % 21) as f64 };
    let data = (0..grid.len()).map(|i| map(hu(i)).round() as i16).collect();
    io::save(path, &Volume::new(grid, data), &Progress::new()).unwrap();
}

#[test]
fn values_without_air_are_told_in_every_format() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["a.nii", "a.nii.gz", "a.mha", "a.mhd", "a.nrrd", "a.nhdr"] {
        let path = dir.path().join(name);
        let told = |map: fn(f64) -> f64| {
            save(&path, map);
            notes(&path)
        };
        assert_eq!(told(|v| v), [""; 0], "{name}");
        assert_eq!(
            told(|v| v + 1024.0),
            ["its air is near 24, not -1000 HU: values are too high by about 1024"],
            "{name}"
        );
        let unit = "no voxel near -1000 HU: values lie within 0 and 1, as those of a normalised scan do";
        assert_eq!(told(|v| f64::from(v > 0.0)), [unit], "{name}");
        let grey = "no voxel near -1000 HU: values lie within 0 and 255, as grey levels do";
        assert_eq!(told(|v| (v + 1024.0) / 8.0), [grey], "{name}");
        assert_eq!(told(|v| v.max(-300.0)), ["no voxel near -1000 HU: values lie within -300 and 99"], "{name}");
    }
}

/// Runs the program; returns its status and what it says.
fn said(args: &[&str]) -> (i32, String) {
    let out = Command::new(env!("CARGO_BIN_EXE_colvis")).args(args).output().unwrap();
    (out.status.code().unwrap(), String::from_utf8_lossy(&out.stderr).into_owned())
}

#[test]
fn values_are_blamed_before_the_preparation() {
    let dir = tempfile::tempdir().unwrap();
    let at = |n: &str| dir.path().join(n).to_str().unwrap().to_owned();
    save(Path::new(&at("a.nii")), |v| v + 1024.0);
    for args in [["segment", "m.nii"], ["centerline", "l.csv"], ["cleanse", "c.nii"], ["surface", "s.stl"]] {
        let (status, told) = said(&[args[0], &at("a.nii"), "--out", &at(args[1])]);
        let last = told.lines().last().unwrap();
        assert!(status == 4 && last.contains("its air is near 24, not -1000 HU"), "{args:?}: {told}");
    }
    let (status, told) = said(&["fly", &at("a.nii"), "--headless", "--seconds", "1"]);
    assert!(status == 4 && !told.contains("unprepared"), "{told}");
    assert!(told.lines().last().unwrap().contains("its air is near 24"), "{told}");
}

#[test]
fn options_that_do_not_apply_are_told() {
    let dir = tempfile::tempdir().unwrap();
    let at = |n: &str| dir.path().join(n).to_str().unwrap().to_owned();
    for name in ["a.nii.gz", "a.mha", "a.nrrd"] {
        save(Path::new(&at(name)), |v| v);
        let options = ["--hu", "0,100", "--spacing", "2,2,2", "--series", "3", "--allow-gaps"];
        let (status, told) = said(&[&["info", &at(name)][..], &options].concat());
        assert_eq!(status, 0, "{told}");
        for option in ["--hu", "--spacing", "--series", "--allow-gaps"] {
            assert_eq!(told.matches(&format!("note: {option} is ignored: ")).count(), 1, "{name} {option}: {told}");
        }
    }
    let dicom = with(|s| s);
    let told = said(&["info", dicom.path().to_str().unwrap(), "--hu", "0,100", "--series", "1", "--allow-gaps"]).1;
    assert_eq!(told, "note: --hu is ignored: the scan holds HU\n");
}

#[test]
fn a_mask_has_zeros_outside_and_whole_numbers_inside() {
    let dir = tempfile::tempdir().unwrap();
    let at = |n: &str| dir.path().join(n).to_str().unwrap().to_owned();
    let grid = || colvis::volume::Grid::new([12, 12, 40], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
    let inside = |n: usize| [n % 12, n / 12 % 12].iter().all(|i| (3..9).contains(i)) && (3..37).contains(&(n / 144));
    let write = |name: &str, values: [i16; 2]| {
        let data = (0..grid().len()).map(|n| values[usize::from(inside(n))]).collect();
        io::save(Path::new(&at(name)), &Volume::new(grid(), data), &Progress::new()).unwrap();
    };
    let line = |name: &str| said(&["centerline", "--mask", &at(name), "--out", &at("l.json")]);
    for (values, sound) in [([0, 1], true), ([0, 7], true), ([-1024, 1], false), ([-5, 5], false), ([1, 2], false)] {
        write("m.nii.gz", values);
        let (status, told) = line("m.nii.gz");
        assert_eq!(status, if sound { 0 } else { 3 }, "{values:?}: {told}");
        assert!(sound || told.contains("is not a mask: "), "{told}");
        assert_eq!(said(&["surface", "--mask", &at("m.nii.gz"), "--out", &at("s.stl")]).0, status, "{values:?}");
    }
    // Shares of a voxel.
    let head =
        "NRRD0004\ntype: float\ndimension: 3\nsizes: 12 12 40\nendian: little\nspacings: 1 1 1\nencoding: raw\n\n";
    let voxels = (0..grid().len()).flat_map(|n| if inside(n) { 0.8f32 } else { 0.0 }.to_le_bytes());
    std::fs::write(at("f.nrrd"), head.bytes().chain(voxels).collect::<Vec<_>>()).unwrap();
    let (status, told) = line("f.nrrd");
    assert!(status == 3 && told.contains("of its voxels are not whole numbers"), "{told}");
}
