//! `nerfstudio`: pictures and `transforms.json`.
//!
//! The rules are those of nerfstudio at commit `50e0e3c` (July 2025), its page "Data conventions" and its code where the page is silent or
//! differs: rays go through (x + 0.5, y + 0.5) of pixel (x, y), and depth along the axis is turned into distance by the length of a
//! direction before it is normalised, which is 1 for a fisheye: for that the files hold the distance itself. By default it multiplies
//! depth with 0.001 to come to the unit of the poses, which the page takes for metres. With millimetres as steps, a colon would have
//! twenty of them across. Its scale is free: the unit is 10 mm here, a step 0.01 mm.

use serde_json::json;

use super::{Content, Index, Layout, LayoutModel, Shot};
use crate::dataset::camera::Intrinsics;

/// The layout `nerfstudio`.
pub(super) const MODEL: LayoutModel = LayoutModel {
    name: "nerfstudio",
    summary: "nerfstudio: images/, depths/, transforms.json, units of 10 mm",
    holds: |camera| matches!(camera, Intrinsics::Perspective { .. } | Intrinsics::Fisheye { .. }),
    make: |camera| Box::new(Nerfstudio { is_fisheye: matches!(camera, Intrinsics::Fisheye { .. }) }),
};

/// The unit of the poses, mm.
const UNIT_MM: f64 = 10.0;
/// A step of depth, as a share of the unit: what nerfstudio takes unless it is asked otherwise.
const STEP: f64 = 1e-3;

struct Nerfstudio {
    is_fisheye: bool,
}

impl Layout for Nerfstudio {
    fn picture(&self, n: usize, _: f64) -> String {
        format!("images/{n:06}.png")
    }

    fn files(&self, shot: &Shot<'_>) -> Vec<(String, Content)> {
        let step_mm = STEP * UNIT_MM;
        let steps = if self.is_fisheye { shot.ray16(step_mm) } else { shot.z16(step_mm) };
        vec![(depth(shot.n), Content::Grey16(steps))]
    }

    fn lists(&self, index: &Index<'_>) -> Vec<(String, String)> {
        let Some(([fx, fy, cx, cy], k)) = index.camera.central(0.5) else { return Vec::new() };
        let frames = index.frames.iter().map(|f| {
            // From x right, y down, z forward to x right, y up, z back.
            let rows = f.pose.rows(UNIT_MM.recip()).map(|[x, y, z, p]| [x, 0.0 - y, 0.0 - z, p]);
            json!({
                "file_path": self.picture(f.n, f.seconds), "depth_file_path": depth(f.n), "transform_matrix": rows,
            })
        });
        let mut all = json!({
            "camera_model": if k.is_some() { "OPENCV_FISHEYE" } else { "OPENCV" },
            "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy, "w": index.size[0], "h": index.size[1],
            "depth_unit_scale_factor": STEP,
            "frames": frames.collect::<Vec<_>>(),
        });
        for (n, k) in k.unwrap_or_default().iter().enumerate() {
            all[format!("k{}", n + 1)] = json!(k);
        }
        vec![("transforms.json".into(), format!("{all:#}\n"))]
    }

    fn told(&self) -> &'static str {
        "The layout is nerfstudio's.\n\n\
         - `images/N.png`: the pictures.\n\
         - `transforms.json`: the camera and its poses. A pose is the 4×4 matrix from the camera to the world, row by row; **its unit is \
         10 mm**. The world is LPS as above, right-handed; the camera's axes are OpenGL's: x right, y up, z back (right-handed). Pixels: \
         here the first pixel's centre is at (0.5, 0.5), as nerfstudio and COLMAP have it. k1 to k4 of a fisheye are those of Kannala and \
         Brandt.\n\
         - `depths/N.png`: 16 bits, 1000 steps a unit (`depth_unit_scale_factor` is 0.001, nerfstudio's default): a step is 0.01 mm, the \
         largest depth 655.35 mm; 0 where there is no wall, or it is farther. Along the camera's axis (z-depth) for a pinhole camera, along \
         the pixel's ray for a fisheye, as nerfstudio takes them with `is_euclidean_depth` false.\n\
         - Files in `truth/` have the same numbers, and mm."
    }
}

fn depth(n: usize) -> String {
    format!("depths/{n:06}.png")
}
