//! Headers as they come: elements that are not needed do not keep a scan from being read, and damage in what is needed does.
//! `headers.py` writes the files, and their voxels as pydicom or SimpleITK read them.
//!
//! This needs a Python with SimpleITK, pydicom and numpy, which the environment variable `COLVIS_PEERS` names. The tests are
//! skipped without it.

use crate::support::judged;

/// Headers that are refused, and why.
const REFUSED: [(&str, &str); 12] = [
    ("rows_without_vr", "is damaged at byte "),
    ("spacing_too_long", "has no BitsAllocated"),
    ("modality_beyond_the_file", "ends early, inside its header"),
    ("rubbish_between", "(no value representation)"),
    ("position_lost", "(no value representation)"),
    ("cut_in_the_header", "ends early, inside its header"),
    ("frames_negative", "NumberOfFrames is \"-1\", not 1 to 100000"),
    ("frames_words", "NumberOfFrames is \"many\", not 1 to 100000"),
    ("syntax_missing_compressed", "names no transfer syntax, and its pixel data is compressed"),
    ("fragment_cut", "its pixel data ends early"),
    ("fragments_cut_between", "its pixel data ends early"),
    ("pixels_cut", "its pixel data ends early: "),
];

#[test]
fn what_is_not_needed_refuses_no_scan() {
    let dir = tempfile::tempdir().unwrap();
    let Some(cases) = judged::cases("headers.py", dir.path()) else { return };
    assert!(cases.len() >= 40, "{}", cases.len());
    judged::judge(dir.path(), &cases, &REFUSED);
}
