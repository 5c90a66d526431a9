//! The README of a dataset: everything that a reader would else have to guess.

use super::Source;
use crate::dataset::layout::{Index, Layout};
use crate::dataset::truth::Kind;

/// Returns the text.
pub(super) fn text(source: &Source<'_>, layout: &dyn Layout, index: &Index<'_>) -> String {
    let [width, height] = index.size;
    let told = |name: &str| source.told.get(name).and_then(|v| v.as_str()).unwrap_or_default().to_owned();
    let mut text = format!(
        "# {} frames of {width}×{height} pixels with their ground truth\n\n\
         Made by colvis {} from {} with\n\n    {}\n\nThe same command makes the same bytes, on any number of threads; `sha256sum -c SHA256SUMS` \
         checks them. {}\n\n\
         ## What is meant\n\n\
         - **World**: the scan's, in mm, LPS: x to the patient's left, y to posterior, z to superior; right-handed.\n\
         - **Camera**: x to the right, y down, z forward (right-handed). Poses turn the camera's directions into the world's.\n\
         - **Pixels**: row 0 on top, the first pixel's centre at (0, 0). Each has one ray, through its centre; nothing is interpolated \
         between pixels.\n\
         - **The wall** is where the trilinearly interpolated scan first reaches the middle of the opacity ramp ({} HU) along the ray.\n\n\
         ## Files\n\n{}\n",
        index.frames.len(),
        told("version"),
        told("scan"),
        told("command"),
        told("licence"),
        source.volume.transfer().iso(),
        layout.told(),
    );
    for kind in index.kinds {
        text += of_kind(*kind);
    }
    text += "- `centerline.csv`: the centerline, if there is one: distance along it (mm) and points (mm).\n\
             - `wall.ply`: the wall as a mesh, if there is a colon (mm, LPS, normals into the tissue), with the first frame that sees each face \
             (65535: none); `coverage.csv`: the share of its area seen up to each frame.\n\
             - `dataset.json`: all settings.\n\n";
    for (title, names) in [("Labels", &source.names[0]), ("Parts", &source.names[1])] {
        if index.kinds.contains(&Kind::Labels) && !names.is_empty() {
            let list = names.iter().enumerate().map(|(n, name)| format!("{n} {name}")).collect::<Vec<_>>();
            text += &format!("{title}: {}.\n\n", list.join(", "));
        }
    }
    text += &format!(
        "## The pictures\n\n\
         Linear light of a wall that scatters evenly, with gloss, lit by lamps beside the lens whose light falls with 1/r² and the angle \
         from their axis; times the frame's exposure, plus noise, to the power of 1/{}, 8 bits. Settings: `{}`.\n",
        source.look.sensor.gamma,
        serde_json::to_string(&source.look).unwrap_or_default(),
    );
    text
}

fn of_kind(kind: Kind) -> &'static str {
    match kind {
        Kind::Depth => {
            "- `truth/depth/N.npy`: float32 H×W, distance from the camera along the pixel's ray, mm; `inf` where there is no wall.\n"
        }
        Kind::Z => {
            "- `truth/z/N.npy`: float32 H×W, distance along the camera's axis, mm; `inf` where there is no wall.\n"
        }
        Kind::Normals => {
            "- `truth/normals/N.npy`: float32 H×W×3, the wall's normal in the world, of unit length, towards the gas; NaN where there is no \
             wall. Its product with the ray's direction is negative.\n"
        }
        Kind::Flow => {
            "- `truth/flow-before/N.npy`, `truth/flow-after/N.npy`: float32 H×W×2, by how many pixels to the right and down the pixel's point \
             of the wall is elsewhere in frame N−1, in frame N+1; NaN where there is none, and beyond that picture unless the camera is a pinhole.\n\
             - `truth/unseen/N.png`: 8 bits, bits 0 and 1 for the frame after, bits 2 and 3 for that before: 1 hidden there, 2 outside that \
             picture.\n"
        }
        Kind::Shading => {
            "- `truth/shading/N.npy`: float32 H×W, cos/r² of a lamp at the camera, 1/mm²: the light without colour. Its normal, as that of \
             the pictures, is from differences over two voxels, so that voxels have no edges.\n"
        }
        Kind::Labels => {
            "- `truth/labels/N.png`, `truth/parts/N.png`: 8 bits, what the wall belongs to and the part of the colon (below).\n"
        }
        Kind::Along => {
            "- `truth/along/N.npy`: float32 H×W×3, distance along the centerline from its beginning (mm), distance from it (mm), \
             and angle about it (radians, in frames that do not turn about it; 0 towards the patient's front where it begins).\n"
        }
    }
}
