//! `colmap`: pictures and a sparse model as text.
//!
//! The rules are those of COLMAP's page "Output Format", of version 4: the first pixel's centre is at (0.5, 0.5), poses are from the world
//! to the camera, quaternions begin with w, each picture has two lines, and numbers begin at 1. COLMAP has no rays beside or behind a
//! camera: points are left out of pictures that see them there.

use std::fmt::Write;

use glam::DVec3;

use super::{Index, Layout, LayoutModel};
use crate::dataset::camera::Intrinsics;

/// The layout `colmap`.
pub(super) const MODEL: LayoutModel = LayoutModel {
    name: "colmap",
    summary: "COLMAP: images/ and sparse/0/ as text, with points and their tracks, mm",
    holds: |camera| matches!(camera, Intrinsics::Perspective { .. } | Intrinsics::Fisheye { .. }),
    make: |_| Box::new(Colmap),
};

/// Points of the wall for each frame, at most.
const POINTS: usize = 300;
/// A point that is less far along a camera's axis, as a share of its distance, is left out of that picture.
const BESIDE: f64 = 0.02;

struct Colmap;

/// What a point's line says: its place, its colour, and the frames with the points' numbers there.
type Track = (DVec3, [u8; 3], Vec<(usize, usize)>);

impl Layout for Colmap {
    fn picture(&self, n: usize, _: f64) -> String {
        format!("images/{n:06}.png")
    }

    fn points(&self) -> usize {
        POINTS
    }

    fn lists(&self, index: &Index<'_>) -> Vec<(String, String)> {
        let mut seen: Vec<Vec<([f64; 2], usize)>> = vec![Vec::new(); index.frames.len()];
        let mut tracks: Vec<Track> = Vec::new();
        for point in index.points {
            let before = |n: usize| {
                let way = point.place - index.frames[n].pose.position;
                way.dot(index.frames[n].pose.to_world.z_axis) > BESIDE * way.length()
            };
            let places: Vec<_> = point.seen.iter().filter(|(n, _)| before(*n)).collect();
            if places.len() < 2 {
                continue;
            }
            let track = places.iter().map(|(n, at)| {
                seen[*n].push((*at, tracks.len() + 1));
                (*n, seen[*n].len() - 1)
            });
            let track = track.collect();
            tracks.push((point.place, point.colour, track));
        }
        vec![
            ("sparse/0/cameras.txt".into(), cameras(index)),
            ("sparse/0/images.txt".into(), images(self, index, &seen)),
            ("sparse/0/points3D.txt".into(), points(&tracks)),
        ]
    }

    fn told(&self) -> &'static str {
        "The layout is COLMAP's: pictures and a sparse model as text, with known poses and points. Its unit is mm.\n\n\
         - `images/N.png`: the pictures.\n\
         - `sparse/0/cameras.txt`: the camera, PINHOLE or OPENCV_FISHEYE (Kannala and Brandt's), pixels. Here the first pixel's centre is at \
         (0.5, 0.5), as COLMAP has it.\n\
         - `sparse/0/images.txt`: for each picture its number from 1, its rotation as a quaternion w, x, y, z and its translation (mm), \
         **from the world to the camera**, its camera and name; then its points: x, y in pixels and the number in `points3D.txt`. The world \
         is LPS as above, right-handed; the camera's axes are x right, y down, z forward.\n\
         - `sparse/0/points3D.txt`: points of the wall (mm) with the colour of the pixel that first shows them, their error (0: they are \
         exact), and the pictures and points that see them. Each is seen by two frames or more that are at most three apart from the one \
         that it was chosen in.\n\
         - Depth is in `truth/` only, whose files have the pictures' numbers, and mm."
    }
}

fn cameras(index: &Index<'_>) -> String {
    let [width, height] = index.size;
    let Some(([fx, fy, cx, cy], k)) = index.camera.central(0.5) else { return String::new() };
    let (model, k) = k.map_or(("PINHOLE", String::new()), |k| {
        ("OPENCV_FISHEYE", k.iter().map(|k| format!(" {k}")).collect::<String>())
    });
    format!(
        "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n# Number of cameras: 1\n\
         1 {model} {width} {height} {fx} {fy} {cx} {cy}{k}\n"
    )
}

fn images(layout: &Colmap, index: &Index<'_>, seen: &[Vec<([f64; 2], usize)>]) -> String {
    let all: usize = seen.iter().map(Vec::len).sum();
    let mut text = format!(
        "# Image list with two lines of data per image:\n\
         #   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n\
         #   POINTS2D[] as (X, Y, POINT3D_ID)\n\
         # Number of images: {}, mean observations per image: {}\n",
        index.frames.len(),
        all as f64 / index.frames.len().max(1) as f64,
    );
    for (frame, seen) in index.frames.iter().zip(seen) {
        let [x, y, z, w] = frame.pose.quaternion();
        let t = frame.pose.to_world.transpose() * -frame.pose.position;
        let picture = layout.picture(frame.n, frame.seconds);
        let name = picture.strip_prefix("images/").unwrap_or(&picture);
        let _ = writeln!(text, "{} {w} {} {} {} {} {} {} 1 {name}", frame.n + 1, -x, -y, -z, t.x, t.y, t.z);
        let points: Vec<String> = seen.iter().map(|([u, v], n)| format!("{u:.6} {v:.6} {n}")).collect();
        text += &points.join(" ");
        text.push('\n');
    }
    text
}

fn points(tracks: &[Track]) -> String {
    let mut text = "# 3D point list with one line of data per point:\n\
                    #   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n"
        .to_owned();
    let _ = writeln!(text, "# Number of points: {}", tracks.len());
    for (n, (p, [r, g, b], track)) in tracks.iter().enumerate() {
        let _ = write!(text, "{} {} {} {} {r} {g} {b} 0", n + 1, p.x, p.y, p.z);
        for (frame, k) in track {
            let _ = write!(text, " {} {k}", frame + 1);
        }
        text.push('\n');
    }
    text
}
