//! `colvis`: our own layout.

use serde_json::json;

use super::{Index, Layout, LayoutModel, lines};

/// The layout `colvis`.
pub(super) const MODEL: LayoutModel = LayoutModel {
    name: "colvis",
    summary: "pictures in rgb/, poses.csv and camera.json, mm",
    holds: |_| true,
    make: |_| Box::new(Own),
};

struct Own;

impl Layout for Own {
    fn picture(&self, n: usize, _: f64) -> String {
        format!("rgb/{n:06}.png")
    }

    fn lists(&self, index: &Index<'_>) -> Vec<(String, String)> {
        let head = "frame,seconds,x_mm,y_mm,z_mm,qx,qy,qz,qw\n";
        let poses = lines(head, index.frames, |f| {
            let (p, [x, y, z, w]) = (f.pose.position, f.pose.quaternion());
            format!("{},{:.6},{},{},{},{x},{y},{z},{w}", f.n, f.seconds, p.x, p.y, p.z)
        });
        let camera = json!({
            "camera": index.camera, "width": index.size[0], "height": index.size[1], "frames_per_second": index.fps,
        });
        vec![("poses.csv".into(), poses), ("camera.json".into(), format!("{camera:#}\n"))]
    }

    fn told(&self) -> &'static str {
        "- `rgb/N.png`: the pictures.\n\
         - `poses.csv`: a line for each frame: number, seconds, position (mm) and rotation as a quaternion, from the camera to the world.\n\
         - `camera.json`: the intrinsics, pixels."
    }
}
