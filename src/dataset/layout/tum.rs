//! `tum`: as the TUM RGB-D benchmark has it (Sturm et al., IROS 2012).
//!
//! The rules are those of the benchmark's page "File Formats": depth is z-depth, 5000 steps a metre, 0 for none; poses are those of the
//! colour camera in the world. Each list begins with three lines of comment, which some readers skip by number. The benchmark has no file
//! for the camera: `calibration.txt` is that of ETH3D's benchmark for SLAM, whose sequences have the same lists.

use super::{Content, Index, Layout, LayoutModel, Shot, lines, metres};
use crate::dataset::camera::Intrinsics;

/// The layout `tum`.
pub(super) const MODEL: LayoutModel = LayoutModel {
    name: "tum",
    summary: "TUM RGB-D: rgb/, depth/, rgb.txt, depth.txt, groundtruth.txt, metres",
    holds: |camera| matches!(camera, Intrinsics::Perspective { .. }),
    make: |_| Box::new(Tum),
};

/// A step of depth, mm: 5000 a metre.
const STEP_MM: f64 = 0.2;

struct Tum;

impl Layout for Tum {
    fn picture(&self, _: usize, seconds: f64) -> String {
        format!("rgb/{seconds:.6}.png")
    }

    fn files(&self, shot: &Shot<'_>) -> Vec<(String, Content)> {
        vec![(depth(shot.seconds), Content::Grey16(shot.z16(STEP_MM)))]
    }

    fn lists(&self, index: &Index<'_>) -> Vec<(String, String)> {
        let rgb = lines("# color images\n# file: rgb.txt\n# timestamp filename\n", index.frames, |f| {
            format!("{:.6} {}", f.seconds, self.picture(f.n, f.seconds))
        });
        let depths = lines("# depth maps\n# file: depth.txt\n# timestamp filename\n", index.frames, |f| {
            format!("{:.6} {}", f.seconds, depth(f.seconds))
        });
        let head = "# ground truth trajectory\n# file: groundtruth.txt\n# timestamp tx ty tz qx qy qz qw\n";
        let poses = lines(head, index.frames, |f| format!("{:.6} {}", f.seconds, metres(&f.pose, " ")));
        let mut out = vec![("rgb.txt".into(), rgb), ("depth.txt".into(), depths), ("groundtruth.txt".into(), poses)];
        if let Some(([fx, fy, cx, cy], _)) = index.camera.central(0.0) {
            out.push(("calibration.txt".into(), format!("{fx} {fy} {cx} {cy}\n")));
        }
        out
    }

    fn told(&self) -> &'static str {
        "The layout is that of the TUM RGB-D benchmark. Times are seconds.\n\n\
         - `rgb/SECONDS.png`: the pictures.\n\
         - `depth/SECONDS.png`: 16 bits, distance along the camera's axis (z-depth), 5000 steps a metre: a step is 0.2 mm, the largest \
         depth 13.107 m; 0 where there is no wall, or it is farther.\n\
         - `rgb.txt`, `depth.txt`: time and name of each. A picture and its depth have the same time.\n\
         - `groundtruth.txt`: time, position (metres) and rotation as a quaternion x, y, z, w, from the camera to the world. The world is \
         LPS as above, right-handed; the camera's axes are x right, y down, z forward.\n\
         - `calibration.txt`: fx, fy, cx, cy of the pinhole camera, pixels; the first pixel's centre is at (0, 0).\n\
         - Files in `truth/` have the frames' numbers, in the order of `rgb.txt`, and mm."
    }
}

fn depth(seconds: f64) -> String {
    format!("depth/{seconds:.6}.png")
}
