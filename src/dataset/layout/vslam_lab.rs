//! `vslam-lab`: a sequence of VSLAM-LAB's.
//!
//! The rules are those of <https://github.com/VSLAM-LAB/VSLAM-LAB> at commit `dc5b119` (8 January 2026): `Datasets/DatasetVSLAMLab.py`
//! lists the files that a sequence must have, `DatasetVSLAMLab_calibration.py` the keys of `calibration.yaml`, and
//! `dataset_files/dataset_rgbdtum.py` the columns. There a camera of Kannala and Brandt's is `cam_model: pinhole` with
//! `distortion_type: equid4` (kb4 elsewhere).

use super::{Content, Index, Layout, LayoutModel, Shot, lines, metres};
use crate::dataset::camera::Intrinsics;

/// The layout `vslam-lab`.
pub(super) const MODEL: LayoutModel = LayoutModel {
    name: "vslam-lab",
    summary: "VSLAM-LAB: rgb_0/, depth_0/, rgb.csv, groundtruth.csv, calibration.yaml, metres",
    holds: |camera| matches!(camera, Intrinsics::Perspective { .. } | Intrinsics::Fisheye { .. }),
    make: |_| Box::new(VslamLab),
};

/// Steps of depth in a metre. The folds of a colon differ by millimetres: TUM's 5000 are coarse.
const DEPTH_FACTOR: f64 = 1e5;

struct VslamLab;

impl Layout for VslamLab {
    fn picture(&self, n: usize, _: f64) -> String {
        format!("rgb_0/{n:06}.png")
    }

    fn files(&self, shot: &Shot<'_>) -> Vec<(String, Content)> {
        vec![(depth(shot.n), Content::Grey16(shot.z16(1e3 / DEPTH_FACTOR)))]
    }

    fn lists(&self, index: &Index<'_>) -> Vec<(String, String)> {
        let rgb = lines("ts_rgb_0 (ns),path_rgb_0,ts_depth_0 (ns),path_depth_0\n", index.frames, |f| {
            let ns = nanoseconds(f.seconds);
            format!("{ns},{},{ns},{}", self.picture(f.n, f.seconds), depth(f.n))
        });
        let poses = lines("ts (ns),tx (m),ty (m),tz (m),qx,qy,qz,qw\n", index.frames, |f| {
            format!("{},{}", nanoseconds(f.seconds), metres(&f.pose, ","))
        });
        vec![
            ("rgb.csv".into(), rgb),
            ("groundtruth.csv".into(), poses),
            ("calibration.yaml".into(), calibration(index)),
        ]
    }

    fn told(&self) -> &'static str {
        "The layout is a sequence of VSLAM-LAB's, by its rules of January 2026. Times are nanoseconds.\n\n\
         - `rgb_0/N.png`: the pictures.\n\
         - `depth_0/N.png`: 16 bits, distance along the camera's axis (z-depth), metres × 100000 (`depth_factor`): a step is 0.01 mm, the \
         largest depth 655.35 mm; 0 where there is no wall, where it is farther, and beside or behind a fisheye.\n\
         - `rgb.csv`: time and name of each. A picture and its depth have the same time.\n\
         - `groundtruth.csv`: time, position (metres) and rotation as a quaternion x, y, z, w, from the camera to the world. The world is \
         LPS as above, right-handed; the camera's axes are x right, y down, z forward.\n\
         - `calibration.yaml`: the camera, pixels, the first pixel's centre at (0, 0). A fisheye has `distortion_type: equid4` and the four \
         coefficients of Kannala and Brandt.\n\
         - Files in `truth/` have the same numbers, and mm."
    }
}

fn depth(n: usize) -> String {
    format!("depth_0/{n:06}.png")
}

fn nanoseconds(seconds: f64) -> u64 {
    (seconds * 1e9).round() as u64
}

fn calibration(index: &Index<'_>) -> String {
    let Some(([fx, fy, cx, cy], k)) = index.camera.central(0.0) else { return String::new() };
    let distortion =
        k.map_or(String::new(), |k| format!("     distortion_type: equid4,\n     distortion_coefficients: {k:?},\n"));
    let same = [0, 5, 10, 15];
    let turn: Vec<&str> = (0..16).map(|n| if same.contains(&n) { "1.0" } else { "0.0" }).collect();
    format!(
        "%YAML 1.2\n---\ncameras:\n  - {{cam_name: rgb_0,\n     cam_type: rgb+depth,\n     depth_name: depth_0,\n     cam_model: pinhole,\n\
         {distortion}     focal_length: [{fx:?}, {fy:?}],\n     principal_point: [{cx:?}, {cy:?}],\n     depth_factor: {DEPTH_FACTOR:?},\n     \
         image_dimension: [{}, {}],\n     fps: {:?},\n     T_BS: [{}] # The body is the camera.\n    }}\n",
        index.size[0],
        index.size[1],
        index.fps,
        turn.join(", "),
    )
}
