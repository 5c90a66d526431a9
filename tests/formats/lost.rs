//! Folders as they come: whatever is passed over is told, and no slice is lost in silence. `lost.py` writes the folders, and the
//! voxels of what is left as pydicom and Pillow's format, PNG, hold them.
//!
//! This needs a Python with SimpleITK, pydicom and numpy, which the environment variable `COLVIS_PEERS` names. The test is skipped
//! without it.

use crate::support::judged;

/// Folders that are refused, and why.
const REFUSED: [(&str, &str); 12] = [
    ("middle_empty", "slices are missing: 1 after slice 8 (1 file is empty and was skipped: IM0009.dcm)"),
    (
        "middle_gz",
        "slices are missing: 1 after slice 8 (1 slice is compressed with gzip and was skipped (unpack it): IM0009.dcm.gz)",
    ),
    ("cut_header", "IM0019.dcm: ends early, inside its header"),
    ("png_empty", "s0009.png: is empty"),
    ("png_jpeg", "s0009.png: is named like a slice but is not a PNG"),
    ("png_garbage", "s0009.png: is named like a slice but is not a PNG"),
    ("png_cut", "s0009.png: is a damaged PNG"),
    ("png_gap", "png_gap: 1 slice is missing between s0008.png and s0010.png"),
    ("png_gap_two", "png_gap_two: 2 slices are missing between s0008.png and s0011.png"),
    ("png_other_ending", "png_other_ending: 1 slice is missing between s0008.png and s0010.png"),
    ("png_twice", "s09.png: has the same number as s0009.png"),
    ("png_gap_steps", "png_gap_steps: 1 slice is missing between s0006.png and s0010.png"),
];

#[test]
fn what_is_passed_over_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let Some(mut cases) = judged::cases("lost.py", dir.path()) else { return };
    // Grey levels that stay as they are, are told to be no HU.
    for case in cases.iter_mut().filter(|c| !c["hu"].is_null() && !c["dims"].is_null()) {
        case["notes"].as_array_mut().unwrap().push("no voxel near -1000 HU: values lie within 0 and 255".into());
    }
    judged::judge(dir.path(), &cases, &REFUSED);
}

/// Folders that this user may not look into; the superuser may look into all.
#[cfg(unix)]
#[test]
fn unreadable_folders_are_told() {
    use std::os::unix::fs::PermissionsExt;
    let dir = tempfile::tempdir().unwrap();
    let slices: Vec<_> = (0..5).map(|k| crate::support::dicom::Slice::at(f64::from(k))).collect();
    crate::support::series::write_series(dir.path(), &slices);
    let closed = dir.path().join("closed");
    std::fs::create_dir(&closed).unwrap();
    std::fs::set_permissions(&closed, std::fs::Permissions::from_mode(0o000)).unwrap();
    if std::fs::read_dir(&closed).is_err() {
        let loaded = crate::support::reading::load(dir.path()).unwrap();
        assert_eq!(loaded.notes, ["1 folder cannot be read and was skipped: closed"]);
    }
    std::fs::set_permissions(&closed, std::fs::Permissions::from_mode(0o700)).unwrap();
}
