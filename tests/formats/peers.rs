//! Our files opened by other programs, and theirs by us: the same voxels at the same world coordinates.
//!
//! This needs a Python with SimpleITK, nibabel, pydicom and numpy, which the environment variable `COLVIS_PEERS` names.
//! The tests are skipped without it.

use std::path::Path;
use std::process::Command;

use colvis::progress::Progress;
use colvis::volume::{Volume, io};
use glam::{DMat3, DQuat, DVec3};

use crate::support::reading::load;
use crate::support::skips::skip;
use crate::support::volumes::ramp;

fn python(action: &str, folder: &Path) -> bool {
    let Some(python) = std::env::var_os("COLVIS_PEERS") else {
        skip("peers", "COLVIS_PEERS names no Python with SimpleITK, nibabel and pydicom");
        return false;
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peers/peers.py");
    let output = Command::new(python).arg(script).arg(action).arg(folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    true
}

/// Returns volumes on an oblique grid and on its mirror image.
fn volumes() -> [Volume; 3] {
    let turn = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -0.2, 2.0));
    let mirror = DMat3::from_cols(turn.x_axis, -turn.y_axis, turn.z_axis);
    [DMat3::IDENTITY, turn, mirror]
        .map(|d| ramp([65, 43, 14], DVec3::new(0.7, 0.8, 2.5), DVec3::new(-100.0, 50.5, -700.25), d))
}

fn expected(folder: &Path, volume: &Volume) {
    let g = volume.grid();
    let facts = serde_json::json!({
        "dims": g.dims(),
        "spacing_mm": g.spacing().to_array(),
        "origin_mm": g.origin().to_array(),
        "direction": g.direction().transpose().to_cols_array(),
    });
    std::fs::write(folder.join("expected.json"), facts.to_string()).unwrap();
}

#[test]
#[ignore = "slow: starts a Python with three other readers"]
fn others_read_what_we_write() {
    for volume in volumes() {
        let dir = tempfile::tempdir().unwrap();
        expected(dir.path(), &volume);
        for name in ["a.nii", "a.nii.gz", "a.mha", "a.mhd", "a.nrrd", "a.nhdr"] {
            io::save(&dir.path().join(name), &volume, &Progress::new()).unwrap();
        }
        let labels: Vec<u8> = volume.data().iter().map(|v| v.rem_euclid(3) as u8).collect();
        io::save_mask(&dir.path().join("mask.nii.gz"), volume.grid(), &labels, &Progress::new()).unwrap();
        if !python("check", dir.path()) {
            return;
        }
    }
}

#[test]
#[ignore = "slow: starts a Python with three other readers"]
fn we_read_what_others_write() {
    for volume in volumes() {
        let dir = tempfile::tempdir().unwrap();
        expected(dir.path(), &volume);
        if !python("write", dir.path()) {
            return;
        }
        let mut names = vec!["s.nii", "s.nii.gz", "s.mha", "s.mhd", "s.nrrd", "s.nhdr"];
        names.extend(["nNifti1Image.nii.gz", "nNifti2Image.nii.gz", "nNifti1Pair.hdr"]);
        if cfg!(feature = "dicom") && volume.grid().direction().determinant() > 0.0 {
            names.extend(["dicom_itk", "dicom_pydicom", "enhanced.dcm"]);
        }
        for name in names {
            let read = load(&dir.path().join(name)).unwrap().volume;
            assert!(read.data() == volume.data(), "{name}");
            let far = DVec3::from_array(volume.grid().dims().map(|n| (n - 1) as f64));
            for corner in [DVec3::ZERO, DVec3::new(far.x, 0.0, 0.0), DVec3::new(0.0, 0.0, far.z), far] {
                let (a, b) = (read.grid().world(corner), volume.grid().world(corner));
                assert!((a - b).length() < 2e-3, "{name}: {a} and {b}");
            }
        }
    }
}
