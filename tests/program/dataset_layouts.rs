//! The layouts of `colvis dataset`, judged by those who read them, and by the same frames in the layout `colvis`.

use std::path::Path;
use std::process::Command;

use serde_json::json;

use crate::support::run::run;
use crate::support::skips::skip;

/// Lets Python judge; prints what it measured.
fn judged(args: &[&str]) {
    let Ok(python) = std::env::var("COLVIS_PEERS") else {
        return skip("peers", "COLVIS_PEERS names no Python with evo and pycolmap");
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/program/dataset_layouts.py");
    let output = Command::new(python).arg(script).args(args).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(said.starts_with("ok"), "{args:?}: {said}{}", String::from_utf8_lossy(&output.stderr));
    println!("{}: {said}", args[0]);
}

/// Writes the frames of a short flight in the layout `colvis` and in others, which are judged.
fn compared(camera: &[&str], layouts: &[&str]) {
    let room = tempfile::tempdir().unwrap();
    let made = |layout: &str, kinds: &str| {
        let out = room.path().join(layout).to_str().unwrap().to_owned();
        let line =
            ["dataset", "--out", &out, "--seconds", "0.3", "--fps", "15", "--size", "112x80", "--layout", layout];
        run(&[&line[..], camera, &["--truth", kinds]].concat(), 0);
        out
    };
    let own = made("colvis", "depth,z,flow");
    for layout in layouts {
        judged(&[layout, &own, &made(layout, "depth")]);
    }
}

#[test]
fn readers_of_each_layout_find_the_frames_of_a_pinhole_camera() {
    compared(&[], &["tum", "colmap", "nerfstudio", "vslam-lab"]);
}

#[test]
fn readers_find_the_frames_of_a_fisheye() {
    // The corners look backwards.
    compared(&["--camera", "fisheye", "--fov", "150"], &["colmap", "nerfstudio", "vslam-lab"]);
}

#[test]
fn the_true_pose_makes_pictures_agree_best() {
    let room = tempfile::tempdir().unwrap();
    // The flight's last step ends before its time.
    for (name, fps, seconds, camera) in
        [("pinhole", "15", "0.202", &[][..]), ("fisheye", "30", "0.102", &["--camera", "fisheye", "--fov", "140"])]
    {
        let out = room.path().join(name).to_str().unwrap().to_owned();
        let line = ["dataset", "--out", &out, "--seconds", seconds, "--fps", fps, "--size", "160x128"];
        run(&[&line[..], camera, &["--truth", "depth,normals,flow"]].concat(), 0);
        judged(&["photometric", &out]);
    }
}

#[test]
fn a_camera_without_a_place_is_told_before_any_work() {
    let room = tempfile::tempdir().unwrap();
    let at = |name: &str| room.path().join(name).to_str().unwrap().to_owned();
    let camera = json!({"model": "scaramuzza", "a": [40, -8e-4, 0, 0], "cx": 40, "cy": 40, "stretch": [1, 0, 0]});
    let poses = json!({"camera": camera, "poses": [{"position": [0, 0, 0], "forward": [0, 1, 0], "up": [0, 0, 1]}]});
    std::fs::write(at("poses.json"), poses.to_string()).unwrap();
    let (poses, out) = (at("poses.json"), at("out"));
    for (layout, camera, others) in [
        ("tum", &["--camera", "panorama"][..], "colvis"),
        ("tum", &["--camera", "fisheye"], "colvis or colmap or nerfstudio or vslam-lab"),
        ("colmap", &["--camera", "panorama"], "colvis"),
        ("nerfstudio", &["--poses", &poses, "--size", "80x80"], "colvis"),
        ("vslam-lab", &["--poses", &poses, "--size", "80x80"], "colvis"),
    ] {
        // The scan is not there, and not asked for.
        let said = run(&[&["dataset", "nowhere.nii", "--out", &out, "--layout", layout][..], camera].concat(), 2);
        let said = String::from_utf8_lossy(&said.stderr).into_owned();
        assert!(said.contains("has no place for") && said.contains(others), "{said}");
        assert!(!Path::new(&out).exists());
    }
}
