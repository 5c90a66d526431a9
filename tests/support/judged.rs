//! Cases that a Python script writes, with the voxels that other programs read from them.

use std::path::Path;
use std::process::Command;

use colvis::error::Result;
use colvis::progress::Progress;
use colvis::volume::io::{self, LoadOptions, Loaded};
use glam::DVec3;
use serde_json::Value;

use super::skips::skip;

/// Runs a script of `tests/formats/`, which writes cases into a folder; `None` without a Python to run it.
pub(crate) fn cases(script: &str, folder: &Path) -> Option<Vec<Value>> {
    let Some(python) = std::env::var_os("COLVIS_PEERS") else {
        skip("peers", "COLVIS_PEERS names no Python with SimpleITK and pydicom");
        return None;
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/formats").join(script);
    let output = Command::new(python).arg(script).arg(folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(serde_json::from_slice(&std::fs::read(folder.join("cases.json")).unwrap()).unwrap())
}

/// Reads the input of a case.
pub(crate) fn read(folder: &Path, case: &Value) -> Result<Loaded> {
    let spacing = serde_json::from_value::<[f64; 3]>(case["spacing"].clone()).ok().map(DVec3::from_array);
    let hu = serde_json::from_value(case["hu"].clone()).ok();
    let options = LoadOptions { spacing, hu, ..LoadOptions::default() };
    io::load(&folder.join(case["path"].as_str().unwrap()), &options, &Progress::new())
}

/// Returns what is wrong with the reading of a case that can be read: voxels, grid, or notes, which must be those of the case.
pub(crate) fn judged(folder: &Path, case: &Value) -> std::result::Result<(), String> {
    let loaded = read(folder, case).map_err(|e| e.to_string())?;
    let grid = loaded.volume.grid();
    let dims: [usize; 3] = serde_json::from_value(case["dims"].clone()).unwrap();
    if grid.dims() != dims {
        return Err(format!("its size is {:?}, not {dims:?}", grid.dims()));
    }
    let bytes = std::fs::read(folder.join(format!("{}.i16", case["name"].as_str().unwrap()))).unwrap();
    let expected: Vec<i16> = bytes.as_chunks().0.iter().map(|b| i16::from_le_bytes(*b)).collect();
    let differ = loaded.volume.data().iter().zip(&expected).filter(|(a, b)| a != b).count();
    if differ > 0 || expected.len() != loaded.volume.data().len() {
        return Err(format!("{differ} voxels differ"));
    }
    if let Ok(to_world) = serde_json::from_value::<Vec<[f64; 3]>>(case["corners"].clone()) {
        let far = DVec3::from_array(dims.map(|n| (n - 1) as f64));
        let ours = [DVec3::ZERO, far * DVec3::X, far * DVec3::Y, far * DVec3::Z].map(|v| grid.world(v));
        if ours.iter().zip(&to_world).any(|(a, b)| a.distance(DVec3::from_array(*b)) > 1e-3) {
            return Err(format!("its corners are {ours:?}, not {to_world:?}"));
        }
    }
    let wanted: Vec<&str> = case["notes"].as_array().unwrap().iter().map(|n| n.as_str().unwrap()).collect();
    let fits = |(note, wanted): (&String, &&str)| note.contains(wanted);
    if loaded.notes.len() != wanted.len() || !loaded.notes.iter().zip(&wanted).all(fits) {
        return Err(format!("notes {:?}, not {wanted:?}", loaded.notes));
    }
    Ok(())
}

/// Judges all cases. Those without voxels must be refused for the reason that `refusals` has beside their name.
pub(crate) fn judge(folder: &Path, cases: &[Value], refusals: &[(&str, &str)]) {
    let mut wrong = Vec::new();
    let mut refused = 0;
    for case in cases {
        let name = case["name"].as_str().unwrap();
        if !case["dims"].is_null() {
            wrong.extend(judged(folder, case).err().map(|why| format!("{name}: {why}")));
            continue;
        }
        refused += 1;
        let why = refusals.iter().find(|r| r.0 == name).map(|r| r.1);
        match read(folder, case) {
            Ok(_) => wrong.push(format!("{name}: it was read")),
            Err(e) if e.kind as i32 == 3 && !e.hint.is_empty() && why.is_some_and(|w| e.to_string().contains(w)) => {}
            Err(e) => wrong.push(format!("{name}: {e}")),
        }
    }
    assert!(wrong.is_empty(), "{} of {}:\n{}", wrong.len(), cases.len(), wrong.join("\n"));
    assert_eq!(refused, refusals.len(), "every refusal has a case");
}
