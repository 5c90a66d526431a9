//! The variants of NRRD and MetaImage headers: each is read as SimpleITK reads it, voxel by voxel and corner by corner, or refused
//! with its reason. `variants.py` writes the files.
//!
//! This needs a Python with SimpleITK and numpy, which the environment variable `COLVIS_PEERS` names. The test is skipped without
//! it.

use crate::support::judged;

/// Variants that are refused, and why. SimpleITK reads those of the first block.
const REFUSED: [(&str, &str); 17] = [
    ("nrrd_hex", "encoding is \"hex\", not raw, gzip or ascii"),
    ("nrrd_bzip2", "encoding is \"bzip2\", not raw, gzip or ascii"),
    ("nrrd_space_left_handed", "its space 3D-left-handed does not tell the patient's left from right"),
    ("nrrd_list", "keeps each slice in a file of its own"),
    ("nrrd_pattern", "keeps each slice in a file of its own"),
    ("mha_list", "keeps each slice in a file of its own"),
    ("mha_pattern", "keeps each slice in a file of its own"),
    ("nrrd_ends_contradict", "spacings has 1 where axis mins and axis maxs give 3.25"),
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
