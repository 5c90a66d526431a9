//! The variants of NRRD and MetaImage headers: each is read as SimpleITK reads it, voxel by voxel and corner by corner, or refused
//! with its reason. `variants.py` writes the files.
//!
//! This needs a Python with SimpleITK and numpy, which the environment variable `COLVIS_PEERS` names. The test is skipped without
//! it.

use std::process::Command;

use colvis::progress::Progress;
use colvis::volume::{Grid, io};
use glam::{DMat3, DVec3};

use crate::support::judged;
use crate::support::skips::skip;

/// Variants that are refused, and why. SimpleITK reads those of the first block.
const REFUSED: [(&str, &str); 17] = [
    ("nrrd_hex", "encoding is \"hex\", not raw, gzip or ascii"),
    ("nrrd_bzip2", "encoding is \"bzip2\", not raw, gzip or ascii"),
    ("nrrd_space_left_handed", "its space 3D-left-handed does not distinguish the patient's left from right"),
    ("nrrd_list", "keeps each slice in its own file"),
    ("nrrd_pattern", "keeps each slice in its own file"),
    ("mha_list", "keeps each slice in its own file"),
    ("mha_pattern", "keeps each slice in its own file"),
    ("nrrd_ends_contradict", "spacings has 1, but axis mins and axis maxs give 3.25"),
    ("nrrd_vector", "has more than one value for each voxel"),
    ("mha_vector", "ElementNumberOfChannels is \"3\", not 1"),
    // Neither reads these.
    ("nrrd_space_rai", "space is \"RAI\", not left-posterior-superior"),
    ("nrrd_space_time", "its space LPST has a time axis"),
    ("nrrd_mins_nan", "axis mins is \"10 nan 30\", not a number for each axis"),
    ("nrrd_short", "ends early"),
    ("mha_short", "ends early"),
    ("mha_no_type", "its header has no ElementType"),
    ("mha_spacing_zero", "ElementSpacing has spacing 0"),
];

#[test]
fn headers_of_every_kind_are_read_as_itk_reads_them() {
    let dir = tempfile::tempdir().unwrap();
    let Some(cases) = judged::cases("variants.py", dir.path()) else { return };
    assert!(cases.len() >= 60, "{}", cases.len());
    judged::judge(dir.path(), &cases, &REFUSED);
}

/// A mask on the grid of a tilted gantry: a note tells of the format that ITK does not read, and of no other.
#[test]
#[ignore = "slow: starts a Python with SimpleITK for each case"]
fn a_format_that_others_cannot_read_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let tilt = DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::new(0.0, 0.3, 0.95).normalize());
    for (direction, sheared) in [(tilt, true), (DMat3::from_rotation_x(0.3), false)] {
        let grid = Grid::new([4, 3, 2], DVec3::new(0.7, 0.7, 1.0), DVec3::new(1.0, 2.0, 3.0), direction).unwrap();
        for name in ["m.nii.gz", "m.nii", "m.nrrd", "m.nhdr", "m.mha", "m.mhd"] {
            let path = dir.path().join(name);
            io::save_mask(&path, &grid, &[1; 24], &Progress::new()).unwrap();
            let note = io::written_note(&path, &grid);
            assert_eq!(note.is_some(), sheared && name.contains(".nii"), "{name}: {note:?}");
            let Some(python) = std::env::var_os("COLVIS_PEERS") else {
                skip("peers", "COLVIS_PEERS names no Python with SimpleITK");
                continue;
            };
            let code = "import sys, SimpleITK; SimpleITK.ReadImage(sys.argv[1])";
            let output = Command::new(python).args(["-c", code]).arg(&path).output().unwrap();
            assert_eq!(output.status.success(), note.is_none(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
        }
    }
}
