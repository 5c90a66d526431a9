//! The README of a dataset: everything that a reader would else have to guess.

use super::Source;
use crate::dataset::layout::{Index, Layout};
use crate::dataset::look::{BASE, Look, Mucosa, Sensor};
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
    if let Some(deformation) = source.deformation {
        text += "- `truth/scene-flow/N.npy`: float32 H×W×3, by how much the tissue of the pixel's point has moved by frame N+1, world, mm: the \
                 colon breathes and waves pass along it, slowly, and the camera moves with the tissue around it. Flow counts it in. Labels and \
                 places are those of the tissue. At the first frame nothing has moved.\n";
        text += &format!("- `wall.ply` is the wall of the scan as it was taken. {}.\n", deformation.told());
    }
    text += "- `exposure.csv`: what the linear light of each frame is multiplied with (below).\n";
    if source.look.linear {
        text += "- `linear/N.exr`: float32, linear light before exposure and noise, 1/mm²: R, G, B, and gloss, which each of them has more \
                 than the wall scatters.\n";
    }
    if source.look.linear && source.look.mucosa != Mucosa::Off {
        text += "- `albedo/N.png`: 16 bits, the wall's colour, linear: the share of red, green and blue light that it scatters, times 65535; 0 \
                 where there is no wall.\n";
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
    text + &of_pictures(&source.look)
}

/// Tells how the pictures came to be, so that they can be inverted.
fn of_pictures(look: &Look) -> String {
    let Sensor { gamma, shot, read, exposure } = &look.sensor;
    let lamps = look.lights_mm.iter().map(|[x, y]| format!("{x} mm to the right of the lens and {y} mm above it"));
    let colour = match look.mucosa {
        Mucosa::Off => format!("{BASE:?} (red, green, blue) everywhere"),
        _ => {
            "fixed to the wall: patches, vessels, and residue where the scan has 150 HU or more 1.5 mm behind the wall"
                .to_owned()
        }
    };
    format!(
        "## The pictures\n\n\
         The light of a pixel is `L = a · E + g`: the wall's colour `a` ({colour}), the light `E` that falls on it, and gloss `g`. Each of the \
         {} lamps adds `1/{} · cos(n, l) · cos(f, −l)^{} / r²` to `E` if both cosines are positive: `r` is the distance from the lamp to the \
         wall, mm, `l` the direction from the wall to it, `n` the smooth normal (that of `truth/shading`), `f` the camera's axis. The lamps \
         are {}. {} Gloss is Blinn and Phong's, of reflectance {} and power {}, on a surface with bumps of mucus that nothing else shows. \
         Light that goes from wall to wall is left out.\n\n\
         A picture's numbers are `255 · min(x, 1)^(1/{gamma})`, rounded, with `x = L · exposure + noise`. The exposure ({}) is in \
         `exposure.csv`. The noise is normal, each pixel and colour by itself, with variance `{shot}² · min(L · exposure, 1) + {read}²`. All \
         pixels are read at once. Where no number is 255 and there is no noise, `L = (number / 255)^{gamma} / exposure`.\n\n\
         Settings: `{}`.\n",
        look.lights_mm.len(),
        look.lights_mm.len(),
        look.cone,
        lamps.collect::<Vec<_>>().join(", and "),
        if look.shadows { "The wall casts shadows." } else { "There are no shadows." },
        look.gloss,
        look.polish,
        exposure.map_or(
            "chosen for each frame, so that 90 % of the lit pixels have less than 0.8 of red".to_owned(),
            |x| format!("always {x}")
        ),
        serde_json::to_string(look).unwrap_or_default(),
    )
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
