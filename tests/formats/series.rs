//! What a series is: passes under one series UID, copies of slices, and the index of a medium. Other programs say what each pass
//! holds; `series.py` writes the cases.
//!
//! This needs a Python with SimpleITK, pydicom and numpy, which the environment variable `COLVIS_PEERS` names. The tests that need
//! it are skipped without it.

use std::path::Path;
use std::process::Command;

use crate::support::dicom::{self, Slice};
use crate::support::reading::load;
use crate::support::series::write_series;
use crate::support::skips::skip;
use colvis::progress::Progress;
use colvis::volume::io::{self, LoadOptions, Loaded};
use serde_json::Value;

fn cases(folder: &Path) -> Option<Vec<Value>> {
    let Some(python) = std::env::var_os("COLVIS_PEERS") else {
        skip("peers", "COLVIS_PEERS names no Python with SimpleITK and pydicom");
        return None;
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/formats/series.py");
    let output = Command::new(python).arg(script).arg(folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(serde_json::from_slice(&std::fs::read(folder.join("cases.json")).unwrap()).unwrap())
}

fn read(path: &Path, series: Option<usize>) -> colvis::error::Result<Loaded> {
    io::load(path, &LoadOptions { series, ..LoadOptions::default() }, &Progress::new())
}

/// A pass as another program reads it.
struct Expected {
    words: String,
    position: String,
    dims: [usize; 3],
    voxels: Vec<i16>,
}

fn expected(folder: &Path, name: &str, passes: &[Value]) -> Vec<Expected> {
    let one = |(k, p): (usize, &Value)| {
        let bytes = std::fs::read(folder.join(format!("{name}.{k}.i16"))).unwrap();
        Expected {
            words: p["words"].as_str().unwrap().to_owned(),
            position: p["position"].as_str().unwrap().to_owned(),
            dims: serde_json::from_value(p["dims"].clone()).unwrap(),
            voxels: bytes.chunks_exact(2).map(|b| i16::from_le_bytes([b[0], b[1]])).collect(),
        }
    };
    passes.iter().enumerate().map(one).collect()
}

/// Returns what is wrong with the reading of a case.
fn judged(folder: &Path, case: &Value) -> Result<(), String> {
    let (name, path) = (case["name"].as_str().unwrap(), folder.join(case["path"].as_str().unwrap()));
    if let Some(why) = case["refused"].as_str() {
        return refused(&path, why);
    }
    if let Some(slots) = case["slots"].as_u64() {
        return lacking(&path, slots as usize, case["missing"].as_u64().unwrap() as usize);
    }
    let all = expected(folder, name, case["passes"].as_array().unwrap());
    if let [only] = &all[..] {
        let loaded = read(&path, None).map_err(|e| e.to_string())?;
        same(&loaded, only)?;
        let notes = &loaded.notes;
        match case["note"].as_str() {
            Some(note) if !notes.iter().any(|n| n.contains(note)) => {
                return Err(format!("{note:?} is not in {notes:?}"));
            }
            None if !notes.is_empty() => return Err(format!("notes: {notes:?}")),
            _ => {}
        }
        let position = loaded.volume.header_position().map(|p| p.name());
        if position != Some(&only.position) {
            return Err(format!("its position is {position:?}"));
        }
    }
    let study = io::study(&path, 8, &Progress::new()).map_err(|e| e.to_string())?.series;
    let list = if study.is_empty() { Vec::new() } else { io::study::table(&study) };
    if all.len() > 1 && study.len() != all.len() {
        return Err(format!("{} passes are listed: {list:?}", study.len()));
    }
    let mut left: Vec<&Expected> = all.iter().collect();
    for series in &study {
        let loaded = read(&path, Some(series.number)).map_err(|e| format!("series {}: {e}", series.number))?;
        let fits = |e: &Expected| {
            same(&loaded, e).is_ok()
                && series.position() == Some(&e.position)
                && told(series.description.as_str(), e, case)
        };
        let at = left.iter().position(|e| fits(e));
        match at {
            Some(at) if at == 0 || !case["unordered"].is_null() => drop(left.remove(at)),
            _ => return Err(format!("series {} is another: {list:?}", series.number)),
        }
        if case["plane"].as_str().is_some_and(|p| series.plane != Some(p)) {
            return Err(format!("plane {:?}", series.plane));
        }
    }
    let info = io::info(&path, &LoadOptions { series: Some(all.len()), ..LoadOptions::default() }, &Progress::new());
    let listed = info.map_err(|e| e.to_string())?["series"].as_array().map(Vec::len);
    if listed != Some(all.len()) {
        return Err(format!("info lists {listed:?}"));
    }
    if all.len() > 1 && all.iter().all(|e| 2 * e.dims[2] > all[0].dims[2]) {
        let e = read(&path, None).map(|_| "it was opened").unwrap_err();
        if e.choices != list {
            return Err(format!("choices {:?} of {e}", e.choices));
        }
    }
    Ok(())
}

/// True if the list tells what the case tells. Without an order of their own, numbered passes may be listed in any.
fn told(description: &str, e: &Expected, case: &Value) -> bool {
    let bare = |s: &str| if case["unordered"].is_null() { s.to_owned() } else { s.replace(char::is_numeric, "") };
    bare(description) == bare(&e.words)
}

fn same(loaded: &Loaded, e: &Expected) -> Result<(), String> {
    let dims = loaded.volume.grid().dims();
    if dims != e.dims {
        return Err(format!("its size is {dims:?}, not {:?}", e.dims));
    }
    let differ = loaded.volume.data().iter().zip(&e.voxels).filter(|(a, b)| a != b).count();
    if differ > 0 { Err(format!("{differ} voxels differ")) } else { Ok(()) }
}

/// One pass of `slots` positions without some slices is refused for its gaps, and whole where they are allowed.
fn lacking(path: &Path, slots: usize, missing: usize) -> Result<(), String> {
    match read(path, None) {
        Err(e)
            if e.to_string().contains(&format!("slices are missing: {}", if missing < 3 { "1 after" } else { "" })) => {
        }
        Err(e) => return Err(e.to_string()),
        Ok(_) => return Err("it was opened".to_owned()),
    }
    let options = LoadOptions { allow_gaps: true, ..LoadOptions::default() };
    let loaded = io::load(path, &options, &Progress::new()).map_err(|e| e.to_string())?;
    let dims = loaded.volume.grid().dims();
    if dims[2] != slots { Err(format!("it has {} slices", dims[2])) } else { Ok(()) }
}

fn refused(path: &Path, why: &str) -> Result<(), String> {
    for allow_gaps in [false, true] {
        let options = LoadOptions { allow_gaps, ..LoadOptions::default() };
        let Err(e) = io::load(path, &options, &Progress::new()) else { return Err("it was opened".to_owned()) };
        let said = e.to_string();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let once = said.matches(&*name).count() <= 1;
        if e.kind as i32 != 3 || !said.contains(why) || said.contains("allow-gaps") || path.is_file() && !once {
            return Err(said);
        }
    }
    Ok(())
}

#[test]
#[ignore = "slow: 150 folders of series"]
fn every_pass_is_a_series_of_its_own() {
    let dir = tempfile::tempdir().unwrap();
    let Some(cases) = cases(dir.path()) else { return };
    assert!(cases.len() > 150, "{}", cases.len());
    let wrong: Vec<String> = (cases.iter())
        .filter_map(|case| judged(dir.path(), case).err().map(|why| format!("{}: {why}", case["name"])))
        .collect();
    assert!(wrong.is_empty(), "{} of {}:\n{}", wrong.len(), cases.len(), wrong.join("\n"));
}

/// Returns `n` slices from `start`, 2.5 mm apart, in one series.
fn pass(n: usize, start: f64, change: impl Fn(Slice) -> Slice) -> Vec<Slice> {
    (0..n).map(|k| change(Slice::at(start + 2.5 * ((7 * k) % n) as f64))).collect()
}

fn refusal(slices: &[Slice]) -> colvis::error::Error {
    let dir = tempfile::tempdir().unwrap();
    write_series(dir.path(), slices);
    load(dir.path()).unwrap_err()
}

#[test]
fn supine_and_prone_under_one_uid_are_never_one_volume() {
    for start in [0.0, 1.25, 30.0, 40.0] {
        let prone = |s| Slice { patient_position: "HFP", ..s };
        let e = refusal(&[pass(12, 0.0, |s| s), pass(12, start, prone)].concat());
        let line = |n: usize, position: &str, other: usize| {
            format!("{n}  CT  12 slices  0.50×0.75×2.50 mm  {position}  axial  patient 1  - (same patient as {other})")
        };
        assert_eq!(e.choices, [line(1, "supine", 2), line(2, "prone ", 1)], "{start}: {e}");
    }
}

#[test]
fn passes_that_no_header_tells_apart_are_refused() {
    let other = |s: Slice| Slice { pixels: s.pixels.iter().map(|p| p + 1).collect(), ..s };
    let e = refusal(&[pass(12, 0.0, |s| s), pass(12, 0.7, other)].concat());
    assert!(e.why.starts_with("its slices are spaced like those of two or more passes"), "{e}");
    assert_eq!(e.hint, "export each pass as its own series");
    let e = refusal(&[pass(12, 0.0, |s| s), pass(12, 0.0, other)].concat());
    assert!(
        e.why.starts_with("12 of its slices have the same position as another but different values (first: "),
        "{e}"
    );
}

#[test]
fn a_copy_in_another_transfer_syntax_is_passed_over() {
    for syntax in [dicom::RLE, dicom::BIG, dicom::DEFLATED, dicom::JPEG_LOSSLESS, dicom::JPEG_LS] {
        let dir = tempfile::tempdir().unwrap();
        write_series(dir.path(), &[pass(11, 0.0, |s| s), pass(11, 0.0, |s| Slice { syntax, ..s })].concat());
        let loaded = load(dir.path()).unwrap();
        assert_eq!(loaded.volume.grid().dims()[2], 11, "{syntax}");
        assert_eq!(loaded.notes.len(), 1, "{:?}", loaded.notes);
        assert!(loaded.notes[0].starts_with("11 slices are duplicates of others and were left out, the first: "));
    }
}
